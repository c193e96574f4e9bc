"""Generalization under distribution shift: other experiments, start headings, sensors, poses, faster obstacles."""

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.metrics.bootstrap import draw_weights, intervals, measured_of, resample
from repro.networks.predictor import Predictor
from repro.recordings.recorded import Recorded, load_recorded
from repro.scans import Scans, library_of
from repro.simulation.recorder import record_experiment
from repro.simulation.sensing import drifted_poses, dropped_beams, noisy_poses, noisy_ranges, skipped_scans
from repro.system.errors import InputError
from repro.world_config import WorldSpec

Change = Callable[[Scans, float, np.random.Generator], Scans]
FIELDS_OF_VIEW = (45, 60, 90, 120, 180, 270, 360)  # [deg], at about the original angular resolution
RANGES_M = (10, 15, 20, 30)  # maximum range of the lidar
SPEEDS = (1, 2, 4)  # multiples of the original speed
START_HEADINGS = (0, 90, 180, 270)  # [deg], of the whole recording about the center of the map
TEST = ["model", "encoding", "seed", "trained", "shift"]  # columns that identify a test


CHANGES: dict[str, tuple[Change, tuple[float, ...]]] = {
    "range noise [m]": (noisy_ranges, (0.0, 0.05, 0.1, 0.2, 0.5)),
    "pose noise [m]": (noisy_poses, (0.0, 0.1, 0.25, 0.5)),
    "odometry error": (drifted_poses, (0.0, 0.01, 0.02, 0.05, 0.1)),
    "beams dropped": (dropped_beams, (0.0, 0.25, 0.5)),
    "scans skipped": (skipped_scans, (0.0, 1.0, 4.0, 9.0)),
}


def with_field_of_view(spec: WorldSpec, degrees: float) -> WorldSpec:
    """Return a spec with another field of view of the lidar [deg] and beams in proportion to it.

    The angle between beams is about the same, because both ends of the field of view have a beam: 0.918 degrees at a
    view of 45 degrees, 0.909 at 90, 0.902 at 360 for the paper's lidar. At 360 degrees the first and the last beam
    coincide.
    """
    number = round(spec.lidar.number * (math.radians(degrees) / spec.lidar.angle_range))
    return spec.with_lidar(angle_range=math.radians(degrees), number=number)


def with_range(spec: WorldSpec, range_m: float) -> WorldSpec:
    """Return a spec with another maximum range of the lidar [m]."""
    return spec.with_lidar(range_max=range_m)


def with_speed(spec: WorldSpec, times: float) -> WorldSpec:
    """Return a spec with the speed of the obstacles multiplied by `times`."""
    raw = copy.deepcopy(spec.raw)
    populations = raw["obstacles"] if isinstance(raw["obstacles"], list) else [raw["obstacles"]]
    for population in populations:
        if behavior := population.get("behavior"):
            behavior["speed_m_s"] = [times * speed for speed in behavior["speed_m_s"]]
    return WorldSpec.parse(raw)


def across_experiments(predictors: Mapping[str, Predictor], recordings: Mapping[str, Path]) -> pd.DataFrame:
    """Test the network of each experiment on the test recordings of every experiment.

    Args:
        predictors: a trained network by experiment.
        recordings: directory of the recordings by experiment.

    Returns:
        rows of shift (`experiment`), trained, tested, metric, value, low, high.
    """
    rows = []
    for tested, directory in recordings.items():
        test = load_recorded(directory, "test", next(iter(predictors.values())).grid)
        for trained, predictor in predictors.items():
            rows.append(score(predictor, test).assign(shift="experiment", trained=trained, tested=tested))
    return pd.concat(rows, ignore_index=True)


def turned(test: Recorded, degrees: int) -> Recorded:
    """Turn recordings counterclockwise about the center of the map, exactly: robots, obstacles and true maps.

    Raises:
        ValueError: the angle is not a multiple of 90 degrees, so that the pixels would not fall on pixels.
    """
    if degrees % 90:
        raise InputError(f"expected a multiple of 90 degrees, got {degrees:g}")
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[degrees // 90 % 4]
    center_m = test.grid.size_m / 2

    def turn(poses: Any) -> Any:
        x, y, heading = poses[..., 0] - center_m, poses[..., 1] - center_m, poses[..., 2]
        there = (cos * x - sin * y + center_m, sin * x + cos * y + center_m, heading + math.radians(degrees))
        return library_of(poses).stack(there, -1)

    truth = dataclasses.replace(test.truth, states=turn(test.truth.states)) if test.truth else None
    scans = dataclasses.replace(test.scans, poses=turn(test.scans.poses))
    return dataclasses.replace(test, scans=scans, maps=test.maps.rot90(degrees // 90, (-2, -1)), truth=truth)


def across_start_headings(predictor: Predictor, experiment: str, recordings: Path) -> pd.DataFrame:
    """Test a network on the test recordings of its own experiment, turned by quarters about the center of the map.

    The paper's rotations start at one heading and its squares on one side, so the place of a hit tells its age.

    Returns:
        rows of shift (`start heading [deg]`), trained, tested (the angle), metric, value, low, high.
    """
    plain, rows = load_recorded(recordings, "test", predictor.grid), []
    for degrees in START_HEADINGS:
        scored = score(predictor, turned(plain, degrees))
        rows.append(scored.assign(shift="start heading [deg]", trained=experiment, tested=f"{degrees:g}"))
    return pd.concat(rows, ignore_index=True)


def under_changes(
    predictor: Predictor, experiment: str, spec: WorldSpec, directory: Path, pairs: int, *, workers: int
) -> pd.DataFrame:
    """Test a network on its own experiment under changed sensing or obstacle speed.

    A miss shows free space up to the maximum range of the tested lidar, or to that of the training if it is less.

    Args:
        predictor: the network.
        experiment: the experiment it was trained on.
        spec: the world spec of that experiment, which may have another lidar than the training; changed recordings use
            the same test worlds and seeds.
        directory: directory for the changed recordings.
        pairs: number of recordings per change, even, since a world and its twin are two recordings.
        workers: number of processes that record.

    Returns:
        rows of shift (kind of change), trained, tested (amount of change), metric, value, low, high.

    Raises:
        ValueError: `pairs` is odd, or see `recorder.record_experiment`.
    """
    rows = []

    def add(shift: str, amount: float, test: Recorded, changed: WorldSpec) -> None:
        scored = score(predictor.with_range(changed.lidar.range_max), test)
        rows.append(scored.assign(shift=shift, trained=experiment, tested=f"{amount:g}"))

    def record(name: str, changed: WorldSpec) -> Recorded:
        record_experiment(directory / name, changed, {"test": pairs}, workers=workers)
        return load_recorded(directory / name, "test", predictor.grid)

    plain = record("plain", spec)
    arrays = Scans(*(each.numpy() for each in (plain.scans.ranges, plain.scans.angles, plain.scans.poses)))
    for shift, (change, amounts) in CHANGES.items():
        for amount in amounts:
            scans = change(arrays, amount, np.random.default_rng(0))
            add(shift, amount, dataclasses.replace(plain, scans=scans), spec)
    for shift, name, change_spec, amounts in (
        ("field of view [deg]", "view", with_field_of_view, FIELDS_OF_VIEW),
        ("maximum range [m]", "range", with_range, RANGES_M),
        ("obstacles' speed [times]", "speed", with_speed, SPEEDS),
    ):
        for amount in amounts:
            changed = change_spec(spec, amount)
            add(shift, amount, record(f"{name}{amount}", changed), changed)
    return pd.concat(rows, ignore_index=True)


def updated(earlier: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """Return earlier rows with new ones, which replace those of the same network, training and shift."""
    is_replaced = pd.MultiIndex.from_frame(earlier[TEST]).isin(pd.MultiIndex.from_frame(new[TEST]))
    return pd.concat([earlier[~is_replaced], new], ignore_index=True)


def score(predictor: Predictor, test: Recorded) -> pd.DataFrame:
    """Compare the prediction of recordings with their true maps; rows of metric, value, low, high."""
    free = predictor.predict(test.scans, allow_empty=True)  # a change may leave no hit, or move a pose off the map
    measured = measured_of(free[:, None], test.maps)
    return pd.DataFrame(intervals(resample(measured, draw_weights(len(test) // 2))))
