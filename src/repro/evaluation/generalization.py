"""Does it travel: networks on experiments they were not trained on, and on sensors, poses and speeds they never saw."""

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.maps.datasets import Recorded, load_recorded
from repro.metrics.bootstrap import Measured, by_world, draw_weights, interval, resample
from repro.metrics.counts import count_quantized
from repro.metrics.scores import ssim
from repro.networks.predictor import Predictor
from repro.scans import Scans
from repro.simulation.recorder import record_experiment

Spec = dict[str, Any]
Change = Callable[[Scans, float, np.random.Generator], Scans]
FIELDS_OF_VIEW = (45, 60, 90, 120, 180)  # [deg], with the beams as dense as they were
SPEEDS = (1, 2, 4)  # times as fast
RAD_PER_M = 0.05  # noise of the heading that goes with noise of the position: at 20 m both shift a hit alike


def noisy_ranges(scans: Scans, std_m: float, rng: np.random.Generator) -> Scans:
    """Adds IR-SIM's own range noise: normal, to every hit; scans as arrays, `std_m` [m]."""
    noise = rng.normal(0, std_m, scans.ranges.shape)
    hit = np.isfinite(scans.ranges)
    return dataclasses.replace(scans, ranges=np.where(hit, (scans.ranges + noise).clip(0), scans.ranges))


def noisy_poses(scans: Scans, std_m: float, rng: np.random.Generator) -> Scans:
    """Adds normal noise to every pose, `std_m` [m] to x and y and 0.05 rad per metre of it to the heading."""
    noise = rng.normal(0, std_m, scans.poses.shape) * [1, 1, RAD_PER_M]
    return dataclasses.replace(scans, poses=scans.poses + noise)


def dropped_beams(scans: Scans, share: float, rng: np.random.Generator) -> Scans:
    """Loses a share of all readings at random, as if those beams had hit nothing."""
    lost = rng.random(scans.ranges.shape) < share
    return dataclasses.replace(scans, ranges=np.where(lost, np.inf, scans.ranges))


CHANGES: dict[str, tuple[Change, tuple[float, ...]]] = {
    "range noise [m]": (noisy_ranges, (0.0, 0.05, 0.1, 0.2, 0.5)),
    "pose noise [m]": (noisy_poses, (0.0, 0.1, 0.25, 0.5)),
    "beams dropped": (dropped_beams, (0.0, 0.25, 0.5)),
}


def with_field_of_view(spec: Spec, degrees: float) -> Spec:
    """Gives the lidar of a spec another field of view [deg], its beams as dense as before."""
    changed = copy.deepcopy(spec)
    lidar = changed["robot"]["sensors"][0]
    wider = math.radians(degrees) / lidar["angle_range"]
    lidar |= {"angle_range": math.radians(degrees), "number": round(lidar["number"] * wider)}
    return changed


def with_speed(spec: Spec, times: float) -> Spec:
    """Makes the obstacles of a spec so many times as fast."""
    changed = copy.deepcopy(spec)
    behavior = changed["obstacles"]["behavior"]
    behavior["speed_m_s"] = [times * speed for speed in behavior["speed_m_s"]]
    return changed


def across_experiments(predictors: Mapping[str, Predictor], recordings: Mapping[str, Path]) -> pd.DataFrame:
    """Tests the network of each experiment on the test recordings of every experiment.

    Args:
        predictors: a trained network of each experiment.
        recordings: the recorded experiments.

    Returns:
        shift (`experiment`), trained, tested, metric, value, low, high.
    """
    rows = []
    for tested, directory in recordings.items():
        test = load_recorded(directory, "test", next(iter(predictors.values())).grid)
        for trained, predictor in predictors.items():
            found = score(predictor, test.scans, test)
            rows.append(found.assign(shift="experiment", trained=trained, tested=tested))
    return pd.concat(rows, ignore_index=True)


def under_changes(predictor: Predictor, experiment: str, spec: Spec, directory: Path, pairs: int) -> pd.DataFrame:
    """Tests a network on worlds of its own experiment, sensed or moving otherwise than it has learned.

    Args:
        predictor: the network.
        experiment: the experiment it was trained on.
        spec: the worlds of that experiment; those of a changed one are its test worlds, seed by seed.
        directory: where changed worlds are recorded.
        pairs: how many recordings of each.

    Returns:
        shift (the change), trained, tested (how much of it), metric, value, low, high.
    """
    rows = []

    def add(shift: str, amount: float, scans: Scans, test: Recorded) -> None:
        found = score(predictor, scans, test)
        rows.append(found.assign(shift=shift, trained=experiment, tested=f"{amount:g}"))

    def record(name: str, changed: Spec) -> Recorded:
        record_experiment(directory / name, changed, {"test": pairs})
        return load_recorded(directory / name, "test", predictor.grid)

    plain = record("plain", spec)
    arrays = Scans(*(each.numpy() for each in (plain.scans.ranges, plain.scans.angles, plain.scans.poses)))
    for shift, (change, amounts) in CHANGES.items():
        for amount in amounts:
            add(shift, amount, change(arrays, amount, np.random.default_rng(0)), plain)
    for degrees in FIELDS_OF_VIEW:
        seen = record(f"view{degrees}", with_field_of_view(spec, degrees))
        add("field of view [deg]", degrees, seen.scans, seen)
    for times in SPEEDS:
        moved = record(f"speed{times}", with_speed(spec, times))
        add("obstacles' speed [times]", times, moved.scans, moved)
    return pd.concat(rows, ignore_index=True)


def score(predictor: Predictor, scans: Scans, test: Recorded) -> pd.DataFrame:
    """Predicts scans and compares with the true maps of their recordings: metric, value, low, high."""
    free = predictor.predict(scans)
    quantized = (free * 255).round().numpy().astype(np.uint8)
    counts = by_world(count_quantized(quantized, test.maps[:, 0].numpy()))[:, 0]
    similarity = by_world(ssim(free[:, None], test.maps.float()).numpy()) / 2
    return interval(resample(Measured(counts[None], similarity[None]), draw_weights(len(counts))))
