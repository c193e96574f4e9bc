"""Count in how many logs a fault of the input is found, see `repro.logs.consistency`.

    python -m reproduce.real.spoiled LOG [LOG ...] [--target DIRECTORY]

spoils logs of driving robots, see `reproduce.real`, in the ways in which the input of a user may be wrong. The checks
get the first scans of a log, of somewhat more than two windows, with all beams and with a view of 90 degrees. Faults
that are not found may be noted, since hits are rarely near others. The target, by default outputs/real, gets
spoiled.csv and its origin.
"""

import argparse
import math
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from repro.logs.consistency import inconsistencies, note_on_blur
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.networks.predictor import load_predictor
from repro.runs.provenance import environment
from repro.system.errors import InputError
from repro.system.files import sha256, write_json, write_text
from reproduce.calls import reported
from reproduce.real.logs import VIEW, is_standing, log_of

TARGET = Path(__file__).parents[2] / "outputs" / "real"
START = 2.2  # windows
TURNS_DEG = (5, 10, 15, 20, 30, 45, 90, 180)


def main() -> None:
    """Spoil the logs, count and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--target", type=Path, default=TARGET)
    arguments = parser.parse_args()
    if standing := [str(path) for path in arguments.logs if is_standing(path)]:
        raise InputError(f"expected logs of driving robots, got {', '.join(standing)}")
    predictor, rows = load_predictor("indoor"), defaultdict[str, Counter[str]](Counter)
    for path in arguments.logs:
        log, settings = log_of(path, predictor)
        for start in starts(log, settings):
            for name, spoiled in [("none", start), *faults(start)]:
                found = bool(inconsistencies(spoiled, settings))
                noted = not found and note_on_blur(spoiled, settings) is not None
                rows[name].update(logs=1, found=found, noted=noted)
        print(path.name, flush=True)
    table = pd.DataFrame(rows).T.rename_axis("fault").reset_index()
    arguments.target.mkdir(parents=True, exist_ok=True)
    write_text(arguments.target / "spoiled.csv", table.to_csv(index=False))
    sums = {path.name: sha256(path) for path in arguments.logs}
    write_json(arguments.target / "spoiled.json", environment() | {"logs": sums})
    print(table.to_string(index=False))


def starts(log: ScanLog, settings: WindowSettings) -> Iterator[ScanLog]:
    """Yield the first scans of a log, with all beams and with the view of the networks."""
    end = int(np.searchsorted(log.stamps, log.stamps[0] + START * settings.duration_s))
    start = replace(log, stamps=log.stamps[:end], ranges=log.ranges[:end], poses=log.poses[:end])
    yield from (start, start.crop(VIEW.fov_rad))


def faults(log: ScanLog) -> Iterator[tuple[str, ScanLog]]:
    """Yield logs that are spoiled in one way each."""
    poses, ranges = log.poses, log.ranges
    turned = {f"lidar turned by {turn} degrees": poses + np.array([0, 0, math.radians(turn)]) for turn in TURNS_DEG}
    changed = {
        **turned,
        "headings of the opposite sign": poses * [1, 1, -1],
        "constant headings": poses * [1, 1, 0],
        "sine of half the heading as heading": np.column_stack([poses[:, :2], np.sin(poses[:, 2] / 2)]),
        "x and y exchanged": poses[:, [1, 0, 2]],
        "heading, x, y as columns": poses[:, [2, 0, 1]],
        "positions in mm": poses * [1000, 1000, 1],
        "positions twice as far": poses * [2, 2, 1],
        "constant poses": np.repeat(poses[:1], len(log), axis=0),
    }
    yield from ((name, replace(log, poses=spoiled)) for name, spoiled in changed.items())
    yield "beams in the reverse order", replace(log, ranges=ranges[:, ::-1])
    yield "half the field of view", replace(log, angles=log.angles / 2)
    yield "ranges 10 % too long", replace(log, ranges=ranges * np.float32(1.1))
    yield "constant readings", replace(log, ranges=np.repeat(ranges[:1], len(log), axis=0))
    yield "each scan five times", replace(log, ranges=ranges[np.arange(len(log)) // 5 * 5])


if __name__ == "__main__":
    reported(main)
