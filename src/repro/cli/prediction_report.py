"""What task=predict prints about a log and its predictions."""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from repro.logs.consistency import inconsistencies, note_on_blur, note_on_rare
from repro.logs.options import WindowSettings
from repro.logs.readings import note_on_range, note_on_repeats
from repro.logs.scan_log import ScanLog
from repro.logs.times import between_scans_s
from repro.maps.statistics import TITLES, Statistics
from repro.prediction.agreement import COMPARISONS, LOSSES
from repro.prediction.moving import MOVERS

Row = dict[str, Any]  # of windows.csv; one that was left out has its number, if it has one, its time and the reason
JUMP_M, JUMP_M_S = 0.5, 10.0  # way and speed beyond which two poses are no motion of a robot


def describe(log: ScanLog, settings: WindowSettings, reach_m: float) -> list[str]:
    """Print what a log has, and what its user should know about it.

    Args:
        reach_m: range of the lidar in training [m], see `Predictor.reach_m`.

    Returns:
        what does not fit together, see `consistency`.
    """
    first, last = (math.degrees(log.angles[end]) for end in (0, -1))
    often = f"{1 / between_scans_s(log.stamps):.1f} per second" if settings.spacing == "time" else "spaced by distance"
    print(f"{len(log)} scans of {len(log.angles)} beams from {first:.0f} to {last:.0f} degrees, {often}")
    if settings.spacing == "time":
        _describe_jumps(log, settings)
    invalid = np.isnan(log.ranges).mean()
    if invalid:
        print(f"invalid: {invalid:.1%} of the readings (NaN, zero, below the minimum): neither a hit nor free space")
    for note in log.notes:
        print(f"warning: {note}", flush=True)
    for reason, count in log.skipped.items():
        print(f"skipped: {count} scans {reason}", flush=True)
    wrong = inconsistencies(log, settings)
    notes = [note_on_range(log.range_max_m, reach_m), note_on_repeats(log.ranges), note_on_rare(log.stamps, settings)]
    for note in filter(None, [*notes, None if wrong else note_on_blur(log, settings)]):
        print(note, flush=True)
    for message in wrong:
        print(f"warning: {message}", flush=True)
    return wrong


def _describe_jumps(log: ScanLog, settings: WindowSettings) -> None:
    steps_m = np.linalg.norm(np.diff(log.poses[:, :2], axis=0), axis=1)
    jumps = np.flatnonzero(steps_m > np.maximum(JUMP_M, JUMP_M_S * np.abs(np.diff(log.stamps))))
    if len(jumps):
        when = time_in(log, settings, log.stamps[jumps[0] + 1])
        where = f"the first by {steps_m[jumps[0]]:.1f} m at {when}"
        print(f"warning: the poses jump {len(jumps)} times, {where}: windows across a jump have wrong maps")


def warn_of(rows: list[Row], statistics: Statistics | None, *, is_consistent: bool) -> None:
    """Print one warning for each statistic of the scans that is outside the training data in some window.

    Args:
        is_consistent: scans and poses fit together, so that other weights or more training may help.
    """
    if statistics is None:
        print("warning: the weights have no statistics of their training data, so the log is not compared with it")
        return
    outside = [row["outside_training"].split() for row in rows]
    for name in statistics.names:
        values = [row[name] for row, names in zip(rows, outside, strict=True) if name in names]
        if not values:
            continue
        low, high = statistics.range_of(name)
        print(
            f"warning: {TITLES.get(name, name)}: {_spread(min(values), max(values))} in {len(values)} of "
            f"{len(rows)} windows, {_spread(low, high)} in the training"
        )
        if name == "fov_deg" and max(values) > high:
            print(f"  prediction.fov_deg={high:.0f} crops the log, task=adapt learns from what it sees beside that")
    if any(outside) and is_consistent:
        print("  the network has not learned from such scans: the comparison below tells how good its maps are here;")
        print("  other weights, or task=adapt with your logs, may be better (docs/robot.md#networks)")


def _spread(low: float, high: float) -> str:
    return f"{low:.3g}" + (f" to {high:.3g}" if high > low else "")


def say_left_out(left_out: list[Row], when: Callable[[float], str]) -> None:
    """Print how many windows were left out, and the first reason."""
    if left_out:
        first = left_out[0]
        where = f"window {first['window']} at {when(first['stamp'])}: " if "window" in first else ""
        print(f"left out: {len(left_out)} windows or parts, such as {where}{first['left_out']}", flush=True)
        print("  windows.csv has all reasons in its column left_out", flush=True)


def time_in(log: ScanLog, settings: WindowSettings, stamp: float) -> str:
    """Return a time of a log, counted from its first scan, in words."""
    since = stamp - log.stamps[0]
    return f"scan {since + 1:.0f}" if settings.spacing == "distance" else f"{since:.1f} s"


def line_of(row: Mapping[str, Any], when: str) -> str:
    """Return what is printed about a window, given its row of windows.csv and its time."""
    movers = "; something moves" if row["moving_pixels"] else ""
    shares = f"{row['obstacle_share']:.1%} obstacles, {row['unknown_share']:.0%} unknown"
    return f"window {row['window']} at {when}: {shares}{movers}{compared(row)}"


def compared(losses: Mapping[str, Any]) -> str:
    """Return the log loss of a map beside that of the last hits, for each kind of scan that can be compared."""
    text = ""
    for prefix, title in COMPARISONS.items():
        ours, others = (losses.get(f"{prefix}_{name}", math.nan) for name in LOSSES)
        if math.isfinite(ours):
            better = "better" if ours < others else "worse"
            text += f"; {title}: log loss {ours:.3f}, {better} than {others:.3f} of the last hits"
    return text


def summarize(rows: list[Row], *, is_consistent: bool) -> None:
    """Print the mean log loss of the maps on scans that their network did not receive, and why to doubt the maps.

    Args:
        is_consistent: scans and poses fit together; else the log loss tells nothing.
    """
    values: dict[str, list[float]] = defaultdict(list)
    for name, value in (item for row in rows for item in row.items()):
        if name.endswith("log_loss") and math.isfinite(value):
            values[name].append(value)
    means = {name: math.fsum(losses) / len(losses) for name, losses in values.items()}
    print(f"{len(rows)} windows, mean{compared(means) or ': no other scan to compare with'}")
    count = sum(row["moving_pixels"] > 0 for row in rows)
    if count:
        print(f"warning: {MOVERS} ({count} of {len(rows)} windows, orange in the figures: docs/robot.md#what-moves)")
    if not is_consistent:
        print("warning: scans and poses do not fit together, see above: the maps are probably wrong, which their log")
        print("  losses do not show")
