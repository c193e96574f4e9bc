"""What task=predict prints about a log and its predictions."""

import math

import numpy as np
import pandas as pd

from repro.maps.statistics import TITLES, Statistics
from repro.prediction.agreement import COMPARISONS, SHARES
from repro.prediction.logs import ScanLog
from repro.prediction.readings import note_on_range, note_on_repeats
from repro.prediction.sharpness import sharper_convention
from repro.prediction.times import WindowSettings

JUMP_M_S = 30.0  # speed beyond which two poses are no motion of a robot


def describe(log: ScanLog, settings: WindowSettings, reach_m: float) -> None:
    """Print what a log has, and what its user should know about it.

    Args:
        log: the log.
        settings: the windows that are cut from it.
        reach_m: range of the lidar in training [m], see `Predictor.reach_m`.
    """
    first, last = (math.degrees(log.angles[end]) for end in (0, -1))
    gaps = np.diff(log.stamps)
    rate = 1 / np.median(gaps[gaps > 0])
    often = f"{rate:.1f} per second" if settings.spacing == "time" else "spaced by distance"
    print(f"{len(log)} scans of {len(log.angles)} beams from {first:.0f} to {last:.0f} degrees, {often}")
    if settings.spacing == "time":
        _describe_jumps(log)
    invalid = np.isnan(log.ranges).mean()
    if invalid:
        print(f"invalid: {invalid:.1%} of the readings (NaN, zero, below the minimum): neither a hit nor free space")
    for note in log.notes:
        print(f"warning: {note}", flush=True)
    for reason, count in log.skipped.items():
        print(f"skipped: {count} scans {reason}", flush=True)
    notes = note_on_range(log.range_max_m, reach_m), note_on_repeats(log.ranges), sharper_convention(log, settings)
    for note in filter(None, notes):
        print(note, flush=True)


def _describe_jumps(log: ScanLog) -> None:
    steps_m = np.linalg.norm(np.diff(log.poses[:, :2], axis=0), axis=1)
    jumps = np.flatnonzero(steps_m > JUMP_M_S * np.abs(np.diff(log.stamps)))
    if len(jumps):
        where = f"the first by {steps_m[jumps[0]]:.1f} m at {log.stamps[jumps[0] + 1]:.2f} s"
        print(f"warning: the poses jump {len(jumps)} times, {where}: windows across a jump have wrong maps")


def warn_of(table: pd.DataFrame, statistics: Statistics | None) -> None:
    """Print one warning for each statistic of the scans that is outside the training data in some window."""
    if statistics is None:
        print("warning: the weights have no statistics of their training data, so the log is not compared with it")
        return
    for name in statistics.names:
        is_outside = table["outside_training"].str.split().map(lambda names, name=name: name in names)
        if is_outside.any():
            low, high = statistics.range_of(name)
            values = table.loc[is_outside, name]
            spread = f"{values.min():.3g}" + (f" to {values.max():.3g}" if values.max() > values.min() else "")
            known = f"{low:.3g}" + (f" to {high:.3g}" if high > low else "")
            print(
                f"warning: {TITLES.get(name, name)}: {spread} in {is_outside.sum()} of {len(table)} windows, {known} "
                f"in the {statistics.windows} windows of the training"
            )
            is_wider = table["outside_training"].str.contains("fov_deg").any()  # and therefore sees more
            if name == "fov_deg" and values.max() > high:
                print(f"  prediction.fov_deg={high:.0f} crops the log, task=adapt learns from what it sees beside that")
            if name == "occupied_share" and values.max() > high and not is_wider:
                print("  wrong poses smear the hits: check columns, units, sign and times of the poses in a figure")


def say_left_out(left_out: pd.DataFrame) -> None:
    """Print how many windows were left out, and the first reason."""
    if len(left_out):
        first = left_out.iloc[0]
        where = "" if pd.isna(first["window"]) else f"window {first['window']} at {first['stamp']:.2f} s: "
        print(f"left out: {len(left_out)} windows or parts, such as {where}{first['left_out']}", flush=True)
        print("  windows.csv has all reasons in its column left_out", flush=True)


def percent(share: float) -> str:
    """Return a share in percent; `none` if there is nothing that it could be a share of."""
    return "none" if math.isnan(share) else f"{share:.0%}"


def summarize(table: pd.DataFrame) -> None:
    """Print the mean agreement of the maps with the scans that their network did not receive."""
    print(f"{len(table)} windows; mean shares:")
    for prefix, title in COMPARISONS.items():
        columns = [prefix + name for name in SHARES]
        if set(columns) <= set(table):
            hits, passed = map(percent, table[columns].mean())
            print(f"  {title}: {hits} of the hits on obstacles, {passed} of the passed pixels free")
