"""The browser demo: one self-contained HTML file that runs networks in worlds of the study.

The page consists of `assets/`: ES modules without a build step, which are joined into one script of the page and one of
its worker, and worlds.json, which `demo.worlds` writes. ONNX Runtime Web and the networks are embedded as base64 of
gzip.
"""

import base64
import gzip
import json
import re
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

from repro.demo.networks import DemoNetwork
from repro.demo.runtime import VERSION, WebRuntime
from repro.system.errors import InputError

ASSETS = Path(str(files("repro.demo"))) / "assets"
PAGE, WORKER = ("world.js", "drawing.js", "main.js"), ("visibility.js", "encodings.js", "worker.js")


def render(networks: list[DemoNetwork], runtime: WebRuntime) -> str:
    """Return the page.

    Args:
        networks: the networks to choose from; the first is selected.
        runtime: ONNX Runtime Web.

    Raises:
        InputError: a network was trained for other maps or windows than those of the worlds.
    """
    worlds = json.loads(_asset("worlds.json"))
    for network in networks:
        _check_network(network, worlds)
    settings = {
        **worlds,
        "networks": [_described(network) for network in networks],
        **{"runtime": runtime.script, "wasm": _pack(runtime.wasm), "worker": joined(*WORKER)},
    }
    shown = {
        "style": _asset("style.css"),
        "script": joined(*PAGE),
        "settings": json.dumps(settings).replace("<", "\\u003c"),  # may stand in a script element
        "seconds": f"{worlds['steps'] * worlds['stepMs'] / 1000:g}",
        "runtime": VERSION,
    }
    return re.sub(r"{{ (\w+) }}", lambda match: shown[match[1]], _asset("index.html"))


def joined(*names: str) -> str:
    """Join JavaScript modules, each after those that it imports, into one script."""
    return "".join(re.sub(r"^(import .*\n|export )", "", _asset(name), flags=re.MULTILINE) for name in names)


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _described(network: DemoNetwork) -> dict[str, Any]:
    encoding = {"name": network.predictor.encoding.name, "parameters": vars(network.predictor.encoding)}
    grid = asdict(network.predictor.grid)
    return {"title": network.title, "encoding": encoding, "grid": grid, "weights": _pack(network.onnx)}


def _check_network(network: DemoNetwork, worlds: dict[str, Any]) -> None:
    """Check that a network predicts maps of the worlds, from windows of the page."""
    predictor = network.predictor
    found, expected = (
        f"maps of {size_m:g} m from {count} steps of {step_s:g} s"
        for size_m, count, step_s in (
            (predictor.grid.size_m, predictor.steps, predictor.step_s),
            (worlds["sizeM"], worlds["steps"], worlds["stepMs"] / 1000),
        )
    )
    if found != expected:
        raise InputError(f"demo.networks: {network.title} predicts {found}, this page needs {expected}")


def _pack(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
