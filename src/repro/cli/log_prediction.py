"""task=predict: maps from a log of your own robot."""

import csv
import io
import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from functools import partial
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

import numpy as np

from repro.cli.jobs import Job
from repro.cli.prediction_report import Row, describe, line_of, say_left_out, summarize, time_in, warn_of
from repro.cli.settings import Prediction
from repro.logs.formats import CARMEN, kind_of, read_log
from repro.logs.options import ReadOptions, WindowSettings, window_of
from repro.logs.scan_log import ScanLog
from repro.logs.times import UnusableTimes
from repro.metrics.scores import THRESHOLD
from repro.networks.predictor import Predictor, load_predictor
from repro.networks.weights import locate, onnx_file
from repro.prediction.agreement import compare_with_scans
from repro.prediction.drawing import draw_window
from repro.prediction.log_page import page_of
from repro.prediction.map_files import write_map, write_probabilities
from repro.prediction.stream_map import REACH_M, predict_map
from repro.prediction.windows import Window, cut, spaced_by_distance
from repro.system.errors import InputError
from repro.system.files import clear_leftovers, lock, read_mapping, replacing_directory, write_json, write_text
from repro.system.progress import progress

SOURCE = "source.json"  # the log and the settings of the maps beside it
WRITTEN = r"window-\d{4,}\.(npz|pgm|yaml|png)|windows\.csv|maps\.html|source\.json|animation\.gif"  # GIF: before 0.4
CAN_DRAW = find_spec("matplotlib") is not None  # a robot needs no figures
SHOWN = 100  # windows on the page, of 60 kB each


def predict_log(job: Job, target: Path) -> None:
    """Predict the map at the end of every window of a log.

    Raises:
        InputError: the log or the weights cannot be used, or no window of the log can.
    """
    settings = job.call.prediction
    assert job.call.scans, "validated"
    path, *others = paths = [Path(name) for name in job.call.scans]
    _check_target(target, Path(settings.weights), paths)
    predictor = load(settings.weights)
    log, windows = read(path, predictor, settings, others)
    wrong = describe(log, windows, predictor.reach_m)
    target.parent.mkdir(parents=True, exist_ok=True)
    when = partial(time_in, log, windows)
    found = cut(log, windows, _stride(settings, windows, predictor), predictor.grid.size_m)
    own = re.compile(rf"{WRITTEN}|{re.escape(target.name)}\.mcap").fullmatch
    with lock(target.parent, f".{target.name}.lock"), replacing_directory(target, own) as new:
        clear_leftovers(target.parent, keep=new, of=target.name)
        rows = _predict_all(found, predictor, new, log, when)
        predicted = [row for row in rows if "left_out" not in row]
        if not predicted:
            raise InputError(f"{path}: none of its {len(rows)} windows or parts can be used, see above")
        origin = {"log": [os.path.realpath(path) for path in paths], "inconsistencies": wrong}
        write_json(new / SOURCE, origin | asdict(settings))
        write_text(new / "windows.csv", _table(rows))
        if CAN_DRAW:
            _write_page(new, predicted, path.name, when)
    warn_of(predicted, predictor.statistics, is_consistent=not wrong)
    summarize(predicted, is_consistent=not wrong)
    print(f"{target} has the maps, " + ("maps.html shows them" if CAN_DRAW else "pip install matplotlib for figures"))


def load(weights: str) -> Predictor:
    """Load the network of a prediction, from weights of torch where there is no ONNX file.

    Raises:
        InputError: there are no such weights, or they are of torch, and the study is not installed.
    """
    if onnx_file(locate(weights)) or not find_spec("torch"):
        return load_predictor(weights)
    from repro.learning.networks.trained import load_trained  # takes seconds

    return load_trained(weights)


def _check_target(target: Path, weights: Path, logs: list[Path]) -> None:
    """Refuse to replace a directory that has what is read, or maps of other files of the same name."""
    if (target / SOURCE).is_file():
        known = read_mapping(target / SOURCE, f"delete {target}").get("log")
        if isinstance(known, list) and known != [os.path.realpath(log) for log in logs]:
            raise InputError(f"{target} has the maps of {', '.join(map(str, known))}: delete it, or set outputs=")
    for source in (*logs, weights):
        if Path(os.path.realpath(source)).is_relative_to(os.path.realpath(target)):
            raise InputError(f"{source} is in {target}, which the prediction replaces: move it, or set outputs=")


def read(
    path: Path, predictor: Predictor, settings: Prediction, others: Sequence[Path] = ()
) -> tuple[ScanLog, WindowSettings]:
    """Read a log of one or several files, and return the windows that are cut from it.

    The scans of a CARMEN log without usable times are spaced by distance, unless the call says otherwise.
    """
    windows = _windows(predictor, settings)
    topics = settings.scan_topic, settings.odometry_topic, settings.frame
    options = ReadOptions(*topics, settings.pose, settings.mounting)
    try:
        log = read_log(path, windows, options, others)
        if windows.spacing == "time":
            log.check_times(windows)
    except UnusableTimes as error:
        if settings.spacing or settings.step_s or kind_of(path) != CARMEN:
            raise
        reason = re.split(r": | \(skipped", str(error).removeprefix(f"{path}: "))[0]
        print(f"prediction.spacing=distance is taken: {reason}")
        windows = replace(windows, spacing="distance")
        log = read_log(path, windows, options, others)
    if windows.spacing == "distance":
        windows = spaced_by_distance(log, windows, predictor.statistics)
        log.check_times(windows)
    return log.crop(math.radians(settings.fov_deg)) if settings.fov_deg else log, windows


def _windows(predictor: Predictor, settings: Prediction) -> WindowSettings:
    """Return the windows, those of the training unless others are chosen; refuse a time of a step without times."""
    if settings.spacing == "distance" and settings.step_s is not None:
        raise InputError("prediction.step_s has no effect with prediction.spacing=distance: leave one out")
    others = {"center": settings.center, "range_max_m": settings.range_max_m, "misses": settings.misses}
    windows = window_of(predictor, settings.steps, settings.step_s, **others)
    if (windows.steps, windows.step_s) != (predictor.steps, predictor.step_s):
        chosen, known = (f"{windowing.steps} steps of {windowing.step_s:g} s" for windowing in (windows, predictor))
        print(f"warning: windows of {chosen}, the network was trained with {known}")
    return replace(windows, spacing=settings.spacing or "time")


def _stride(settings: Prediction, windows: WindowSettings, predictor: Predictor) -> float:
    """Return the time between two windows [s], or the scans between two that are spaced by distance."""
    is_spaced = windows.spacing == "distance"
    return settings.stride_s * windows.step_s / predictor.step_s if is_spaced else settings.stride_s


def _predict_all(
    windows: Iterable[Window | str], predictor: Predictor, directory: Path, log: ScanLog, when: Callable[[float], str]
) -> list[Row]:
    """Predict the windows and return their rows; of those that cannot be used, the column `left_out` has the reason."""
    rows: list[Row] = []
    for window in progress(windows, "windows"):
        if isinstance(window, str):
            rows.append({"left_out": window})
            continue
        row: Row = {"window": window.number, "stamp": window.stamp}
        try:
            rows.append(row | _predict(window, predictor, directory, log, when(window.stamp)))
        except InputError as error:
            rows.append(row | {"left_out": str(error)})
    say_left_out([row for row in rows if "left_out" in row], when)
    return rows


def _table(rows: list[Row]) -> str:
    """Return windows.csv, whose last column has the reasons for which windows were left out."""
    columns = [name for name in dict.fromkeys(("window", "stamp", *chain(*rows))) if name != "left_out"]
    text = io.StringIO()
    writer = csv.DictWriter(text, [*columns, "left_out"], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: f"{value:.4f}" if isinstance(value, float) else value for name, value in row.items()})
    return text.getvalue()


def _predict(window: Window, predictor: Predictor, directory: Path, log: ScanLog, when: str) -> Row:
    """Predict one window, write its files and return its row."""
    grid, range_max_m = predictor.grid, min(log.range_max_m, REACH_M)
    predicted = predict_map(predictor, window.scans, window.origin, window.stamp, log.range_max_m)
    stem = directory / f"window-{window.number:04d}"
    write_probabilities(stem.with_suffix(".npz"), predicted)
    write_map(stem, predicted)
    if CAN_DRAW:
        draw_window(window, predicted, grid, range_max_m, when).savefig(stem.with_suffix(".png"), dpi=120)
    row: Row = {
        "obstacle_share": float((predicted.free < THRESHOLD).mean()),
        "unknown_share": float(predicted.unknown.mean()),
        "moving_pixels": int(predicted.moving.sum()),
    }
    losses = compare_with_scans(window, predicted.free, grid, range_max_m)
    row |= {**predicted.statistics, "outside_training": " ".join(predicted.outside_training), **losses}
    print(line_of(row | {"window": window.number}, when), flush=True)
    return row


def _write_page(directory: Path, predicted: list[Row], title: str, when: Callable[[float], str]) -> None:
    """Write the page of a log, with at most `SHOWN` of its windows, evenly over it."""
    figures = []
    for place in np.unique(np.linspace(0, len(predicted) - 1, SHOWN).astype(int)):
        row = predicted[place]
        figures.append((directory / f"window-{row['window']:04d}.png", line_of(row, when(row["stamp"]))))
    write_text(directory / "maps.html", page_of(title, figures))
