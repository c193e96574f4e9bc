"""One HTML page with the figures of a log and a slider, which needs no other file."""

import base64
import html
import json
from collections.abc import Sequence
from pathlib import Path

PAGE = """<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
body {{ font: 16px/1.4 sans-serif; margin: 1em auto; max-width: 1400px; padding: 0 0.5em; }}
div {{ overflow-x: auto; }}
img {{ width: 100%; min-width: 44rem; }}
form {{ display: flex; gap: 0.5em; }}
input {{ flex: 1; }}
</style>
<h1>{title}</h1>
<p>White is free, dark an obstacle, light blue is where no beam has been.</p>
<form><button type="button">Play</button><input type="range" min="0" max="{last}" value="0" aria-label="window"></form>
<p id="caption"></p>
<div><img alt="hits, predicted map, and what other scans show"></div>
<script>
const frames = {frames};
const slider = document.querySelector("input"), button = document.querySelector("button");
let timer = 0;
function show() {{
  document.querySelector("img").src = "data:image/png;base64," + frames[slider.value][0];
  document.getElementById("caption").textContent = frames[slider.value][1];
}}
function stop() {{ clearInterval(timer); timer = 0; button.textContent = "Play"; }}
slider.oninput = () => {{ stop(); show(); }};
button.onclick = () => {{
  if (timer) return stop();
  button.textContent = "Stop";
  timer = setInterval(() => {{ slider.value = (+slider.value + 1) % frames.length; show(); }}, 500);
}};
show();
</script>
</html>
"""


def page_of(title: str, figures: Sequence[tuple[Path, str]]) -> str:
    """Return a page that shows figures one at a time.

    Args:
        figures: PNG files and their captions, in order; at least one.
    """
    frames = [(base64.b64encode(path.read_bytes()).decode(), caption) for path, caption in figures]
    text = json.dumps(frames).replace("<", "\\u003c")  # no end of the script within it
    return PAGE.format(title=html.escape(title), last=len(frames) - 1, frames=text)
