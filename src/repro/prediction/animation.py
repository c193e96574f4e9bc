"""The animation of a log, from the figures of its windows."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

MAX_FRAMES = 600  # of which all are in memory while the file is written
WIDTH, COLORS = 900, 128
FRAME_MS, LAST_MS = 100, 1000


def write_animation(path: Path, figures: Sequence[Path]) -> int:
    """Write the figures of the windows as a GIF of ten frames per second; of more than `MAX_FRAMES`, as many evenly.

    Args:
        path: the file to write.
        figures: images of the same size, at least one.

    Returns:
        the number of frames.
    """
    count = min(len(figures), MAX_FRAMES)
    chosen = [figures[number] for number in np.linspace(0, len(figures) - 1, count).round().astype(int)]
    first, *others = _frames(chosen)
    durations = [FRAME_MS] * (count - 1) + [LAST_MS]
    first.save(path, save_all=True, append_images=others, duration=durations, loop=0, optimize=False)
    return count


def _frames(figures: Sequence[Path]) -> Iterator[Image.Image]:
    """Yield the figures at the width of the animation, in few colors."""
    for figure in figures:
        with Image.open(figure) as content:
            height = round(content.height * WIDTH / content.width)
            small = content.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        yield small.quantize(COLORS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
