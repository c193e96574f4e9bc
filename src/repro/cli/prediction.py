"""task=predict: maps from a log of your own robot."""

import math
import re
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from tqdm import tqdm

from repro.cli.inputs import find
from repro.cli.jobs import Job
from repro.cli.logs import name_of
from repro.cli.settings import Prediction
from repro.maps.statistics import TITLES, Statistics, measure
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.agreement import COMPARISONS, SHARES, compare
from repro.prediction.animation import write_animation
from repro.prediction.logs import ScanLog
from repro.prediction.output import draw, read_maps, window_number, write_map, write_probabilities
from repro.prediction.readers import read_log
from repro.prediction.readings import note_on_range, note_on_repeats
from repro.prediction.windows import Window, cut
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, replacing_directory, write_json, write_text

Row = dict[str, float | str]
JUMP_M_S = 30.0  # speed beyond which two poses are no motion of a robot
COMPARED_M = 30.0  # most of the maximum range in the comparison with the next scan, as in training
WRITTEN = r"window-\d+\.\w+|windows\.csv|source\.json|animation\.gif"  # files of a directory, beside <its name>.mcap


def predict_log(job: Job) -> None:
    """Predict the map at the end of every window of a log.

    Raises:
        ValueError: the log or the weights cannot be used, or no window of the log can.
    """
    settings = job.call.prediction
    assert job.call.scans, "validated"
    path = Path(job.call.scans)
    target = job.outputs.path / "predictions" / name_of(path)
    _check_target(target, path, Path(settings.weights))
    weights = find("prediction.weights", settings.weights)
    print(f"network: {settings.weights}", flush=True)
    predictor = load_predictor(weights)
    steps, step_s = _window(settings, predictor)
    log = _log(path, step_s, settings)
    for message in _notes(log, predictor):
        print(message, flush=True)
    predictor, range_max_m = predictor.with_range(log.range_max_m), min(log.range_max_m, COMPARED_M)
    mcap = _mcap(log) if settings.mcap else None
    target.parent.mkdir(parents=True, exist_ok=True)
    grid = predictor.grid
    options = {"stride_s": settings.stride_s, "center": settings.center, "size_m": grid.size_m}
    windows = cut(log, steps=steps, step_s=step_s, **options)  # type: ignore[arg-type]
    with lock(target.parent, f".{target.name}.lock"), replacing_directory(target) as new:
        clear_leftovers(target.parent, keep=new, of=target.name)
        rows, left_out = _predict_all(windows, predictor, new, range_max_m)
        if not rows:
            raise InputError(f"{path}: none of its {left_out} windows or parts can be used, see above")
        if settings.animate:
            write_animation(new / "animation.gif", sorted(new.glob("window-*.png"), key=window_number))
        if mcap:
            mcap.write_mcap(new / f"{target.name}.mcap", log, read_maps(new), range_max_m)
        write_json(new / "source.json", {"log": str(path), "weights": settings.weights})
        write_text(new / "windows.csv", pd.DataFrame(rows).to_csv(index=False, float_format="%.4f"))
    _warn(pd.DataFrame(rows), predictor.statistics)
    _summarize(rows, target)


def _check_target(target: Path, *sources: Path) -> None:
    """Check that replacing a directory deletes neither what is read nor anything but earlier predictions.

    Raises:
        ValueError: it would.
    """
    for source in sources:
        if source.resolve().is_relative_to(target.resolve()):
            raise InputError(f"{source} is in {target}, which the prediction replaces: move it, or set outputs=")
    others = [target] if target.exists() and not target.is_dir() else target.glob("*")
    written = re.compile(rf"{WRITTEN}|{re.escape(target.name)}\.mcap")
    foreign = [path.name for path in others if not path.is_file() or not written.fullmatch(path.name)]
    if foreign:
        raise InputError(
            f"{target} has files that are no prediction, such as {sorted(foreign)[0]}: move them, or set outputs="
        )


def _window(settings: Prediction, predictor: Predictor) -> tuple[int, float]:
    """Return steps and time of a step [s] of the windows; those of the training unless others are chosen.

    Raises:
        ValueError: the map of the window would move, and the network has learned fixed obstacles.
    """
    try:
        predictor.check_center(settings.center)
    except InputError as error:
        raise InputError(f"prediction.center: {error}") from error
    steps, step_s = predictor.window(settings.steps, settings.step_s)
    if (steps, step_s) != predictor.window():
        known = f"{predictor.steps} steps of {predictor.step_s:g} s"
        print(f"warning: windows of {steps} steps of {step_s:g} s, the network was trained with {known}")
    return steps, step_s


def _log(path: Path, step_s: float, settings: Prediction) -> ScanLog:
    """Read and describe a log."""
    log = read_log(path, step_s / 2, (settings.scan_topic, settings.odometry_topic))
    log = log.crop(math.radians(settings.fov_deg)) if settings.fov_deg else log
    log = log.with_range(settings.range_max_m) if settings.range_max_m else log
    _describe(log)
    return log


def _notes(log: ScanLog, predictor: Predictor) -> list[str]:
    """Return what the user should know about the maximum range of a log."""
    notes = [note_on_range(log.range_max_m, predictor.reach_m), note_on_repeats(log.ranges)]
    return [note for note in notes if note]


def _mcap(log: ScanLog) -> ModuleType:
    """Return the module that writes MCAP files, after a check that it can write this log."""
    try:
        from repro.prediction import mcap
    except ModuleNotFoundError as error:
        raise InputError("prediction.mcap=true needs the package rosbags: pip install rosbags") from error
    mcap.check_times(log)
    return mcap


def _predict_all(
    windows: Iterable[Window | str], predictor: Predictor, directory: Path, range_max_m: float
) -> tuple[list[Row], int]:
    """Predict the windows; print the reasons for which some are left out, each once, and return rows and their number.

    Raises:
        ValueError: of a library; those about a window leave it out.
    """
    rows: list[Row] = []
    left_out: dict[str, list[str]] = {}
    for window in tqdm(windows, unit="window", disable=None):
        if isinstance(window, str):
            left_out.setdefault(window, []).append("")
            continue
        try:
            rows.append(_predict(window, predictor, directory, range_max_m))
        except InputError as error:
            left_out.setdefault(str(error), []).append(f"window {window.number} at {window.stamp:.2f} s: ")
    for reason, names in left_out.items():
        many = f"{len(names)} windows, the first is {names[0]}" if len(names) > 1 else names[0]
        print(f"left out: {many}{reason}", flush=True)
    return rows, sum(map(len, left_out.values()))


def _predict(window: Window, predictor: Predictor, directory: Path, range_max_m: float) -> Row:
    """Predict one window, write its files and return its row."""
    grid = predictor.grid
    free = predictor.predict(window.scans)[0].numpy()
    stem = directory / f"window-{window.number:04d}"
    write_probabilities(stem.with_suffix(".npz"), free, window, grid)
    write_map(stem, free, window, grid)
    figure = draw(window, free, grid)
    figure.savefig(stem.with_suffix(".png"), dpi=120)
    plt.close(figure)
    row: Row = {"window": window.number, "stamp": window.stamp, "obstacle_share": float((free < 0.5).mean())}
    line = f"window {window.number} at {window.stamp:.2f} s: {row['obstacle_share']:.1%} obstacles"
    statistics = {name: float(value[0]) for name, value in measure(window.scans.tensors(), grid).items()}
    row |= statistics | {"outside_training": " ".join(_outside(statistics, predictor.statistics))}
    compared = compare(window, free, grid, range_max_m)
    if window.following:
        hits, passed = (compared[name] for name in SHARES)
        line += f"; next scan: {hits:.0%} of the hits on obstacles, {passed:.0%} of the passed pixels free"
    print(line, flush=True)
    return row | compared


def _outside(values: dict[str, float], statistics: Statistics | None) -> list[str]:
    return statistics.outside(values) if statistics else []


def _warn(table: pd.DataFrame, statistics: Statistics | None) -> None:
    """Print one warning for each statistic of the scans that is outside the training data in some window."""
    if statistics is None:
        print("warning: the weights have no statistics of their training data, so the log is not compared with it")
        return
    for name in statistics.quantiles:
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
            if name == "occupied_share" and values.max() > high and not is_wider:
                print("  wrong poses smear the hits: check columns, units, sign and times of the poses in a figure")


def _describe(log: ScanLog) -> None:
    first, last = (math.degrees(log.angles[end]) for end in (0, -1))
    rate = (len(log) - 1) / (log.stamps[-1] - log.stamps[0])
    print(f"{len(log)} scans of {len(log.angles)} beams from {first:.0f} to {last:.0f} degrees, {rate:.1f} per second")
    steps_m = np.linalg.norm(np.diff(log.poses[:, :2], axis=0), axis=1)
    jumps = np.flatnonzero(steps_m > JUMP_M_S * np.diff(log.stamps))
    if len(jumps):
        where = f"the first by {steps_m[jumps[0]]:.1f} m at {log.stamps[jumps[0] + 1]:.2f} s"
        print(f"warning: the poses jump {len(jumps)} times, {where}: windows across a jump have wrong maps")
    invalid = np.isnan(log.ranges).mean()
    if invalid:
        print(f"invalid: {invalid:.1%} of the readings (NaN, zero, below the minimum): neither a hit nor free space")
    for reason, count in log.skipped.items():
        print(f"skipped: {count} scans {reason}", flush=True)


def _summarize(rows: list[Row], target: Path) -> None:
    table = pd.DataFrame(rows)
    print(f"{len(table)} windows; mean shares:")
    for prefix, title in COMPARISONS.items():
        columns = [prefix + name for name in SHARES]
        if set(columns) <= set(table):
            hits, passed = table[columns].mean()
            print(f"  {title}: {hits:.0%} of the hits on obstacles, {passed:.0%} of the passed pixels free")
    print(target)
