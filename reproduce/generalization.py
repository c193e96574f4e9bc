"""Test a network on other experiments, start headings, sensors, poses and speeds than those of its training.

    python -m reproduce.generalization exp=4 scale=laptop
    python run.py task=analysis scale=laptop

The arguments are those of run.py: the network is that of `model`, `encoding` and `seed`. The rows are added to
analysis/generalization.csv of the outputs directory in place of earlier ones of the same tests, and drawn beside it.
"""

import copy
import dataclasses
import math
import sys
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from repro.cli import compose, main
from repro.cli.jobs import Job
from repro.evaluation.image_metrics import measured_of
from repro.learning.networks.trained import load_trained
from repro.metrics.bootstrap import draw_weights, intervals, resample
from repro.networks.predictor import Predictor
from repro.recordings.reader import Recordings, open_recordings
from repro.recordings.recorded import Recorded, load_recorded
from repro.reporting.names import predictor_title
from repro.reporting.plots import LOOKS, STYLE, one_legend, save
from repro.reporting.results import read_rows
from repro.runs.keys import RunKey
from repro.scans import Scans
from repro.simulation.recorder import record_experiment
from repro.simulation.sensing import drifted_poses, noisy_poses, noisy_ranges, skipped_scans
from repro.system.files import write_text
from repro.worlds.spec import WorldSpec


def dropped_beams(scans: Scans, share: float, rng: np.random.Generator) -> Scans:
    """Drop a random share of all readings; dropped beams become misses."""
    dropped = rng.random(scans.ranges.shape) < share
    return dataclasses.replace(scans, ranges=np.where(dropped, np.inf, scans.ranges))


CHANGES: dict[str, tuple[Callable[[Scans, float, np.random.Generator], Scans], tuple[float, ...]]] = {
    "range noise [m]": (noisy_ranges, (0.0, 0.05, 0.1, 0.2, 0.5)),
    "pose noise [m]": (noisy_poses, (0.0, 0.1, 0.25, 0.5)),
    "odometry error": (drifted_poses, (0.0, 0.01, 0.02, 0.05, 0.1)),
    "beams dropped": (dropped_beams, (0.0, 0.25, 0.5)),
    "scans skipped": (skipped_scans, (0.0, 1.0, 4.0, 9.0)),
}
START_HEADINGS = (0, 90, 180, 270)  # [deg], of the whole recording about the center of the map
TEST = ["model", "encoding", "seed", "trained", "shift", "tested", "metric"]  # columns that identify a row


def with_field_of_view(spec: WorldSpec, degrees: float) -> WorldSpec:
    """Return a spec with another field of view of the lidar [deg] and beams in proportion to it."""
    number = round(spec.lidar.number * (math.radians(degrees) / spec.lidar.angle_range))
    return spec.with_lidar(angle_range=math.radians(degrees), number=number)


def with_range(spec: WorldSpec, range_m: float) -> WorldSpec:
    """Return a spec with another maximum range of the lidar [m]."""
    return spec.with_lidar(range_max=range_m)


def with_speed(spec: WorldSpec, times: float) -> WorldSpec:
    """Return a spec with the speed of the obstacles multiplied by `times`."""
    raw = copy.deepcopy(spec.raw)
    for population in raw["obstacles"] if isinstance(raw["obstacles"], list) else [raw["obstacles"]]:
        if behavior := population.get("behavior"):
            behavior["speed_m_s"] = [times * speed for speed in behavior["speed_m_s"]]
    return WorldSpec.parse(raw)


WORLDS: dict[str, tuple[Callable[[WorldSpec, float], WorldSpec], tuple[float, ...]]] = {
    "field of view [deg]": (with_field_of_view, (45, 60, 90, 120, 180, 270, 360)),
    "maximum range [m]": (with_range, (10, 15, 20, 30)),
    "obstacles' speed [times]": (with_speed, (1, 2, 4)),
}


def turned(test: Recorded, degrees: int) -> Recorded:
    """Turn recordings counterclockwise about the center of the map by a multiple of 90 degrees: robots and maps."""
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[degrees // 90 % 4]
    center_m, poses = test.grid.size_m / 2, test.scans.poses
    x, y, heading = poses[..., 0] - center_m, poses[..., 1] - center_m, poses[..., 2]
    there = (cos * x - sin * y + center_m, sin * x + cos * y + center_m, heading + math.radians(degrees))
    scans = dataclasses.replace(test.scans, poses=np.stack(there, -1))
    return dataclasses.replace(test, scans=scans, maps=np.rot90(test.maps, degrees // 90, (-2, -1)))


def across_start_headings(predictor: Predictor, recordings: Recordings) -> pd.DataFrame:
    """Test a network on the test recordings of its experiment, turned by quarters; rows of shift, tested, metric.

    The paper's rotations start at one heading and its squares on one side, so the place of a hit tells its age.
    """
    plain = load_recorded(recordings, "test", predictor.grid)
    rows = [score(predictor, turned(plain, degrees)).assign(tested=f"{degrees:g}") for degrees in START_HEADINGS]
    return pd.concat(rows).assign(shift="start heading [deg]")


def under_changes(predictor: Predictor, spec: WorldSpec, directory: Path, pairs: int, *, workers: int) -> pd.DataFrame:
    """Test a network under changed sensing and obstacle speed, in the same test worlds.

    A miss shows free space up to the maximum range of the tested lidar, or to that of the training if it is less.

    Args:
        predictor: the network.
        spec: the worlds of its training, or others.
        directory: directory for the changed recordings.
        pairs: number of recordings per change.
        workers: number of processes that record.

    Returns:
        rows of shift (kind of change), tested (amount of change), metric, value, low, high.
    """
    rows = []

    def add(shift: str, amount: float, test: Recorded, changed: WorldSpec) -> None:
        scored = score(predictor.with_range(changed.lidar.range_max), test)
        rows.append(scored.assign(shift=shift, tested=f"{amount:g}"))

    def record(name: str, changed: WorldSpec) -> Recorded:
        record_experiment(directory / name, changed, {"test": pairs}, workers=workers)
        return load_recorded(open_recordings(directory / name), "test", predictor.grid)

    plain = record("plain", spec)
    for shift, (change, amounts) in CHANGES.items():
        for amount in amounts:
            scans = change(plain.scans, amount, np.random.default_rng(0))
            add(shift, amount, dataclasses.replace(plain, scans=scans), spec)
    for shift, (change_spec, amounts) in WORLDS.items():
        for amount in amounts:
            changed = change_spec(spec, amount)
            add(shift, amount, record(f"{change_spec.__name__}{amount}", changed), changed)
    return pd.concat(rows)


def score(predictor: Predictor, test: Recorded) -> pd.DataFrame:
    """Compare the prediction of recordings with their true maps; rows of metric, value, low, high."""
    free = predictor.predict(test.scans, allow_empty=True)  # a change may leave no hit, or move a pose off the map
    measured = measured_of(free[:, None], test.maps)
    return pd.DataFrame(intervals(resample(measured, draw_weights(len(test) // 2))))


def figure_of(table: pd.DataFrame) -> Figure:
    """Plot the obstacle IoU of networks over the amount of each change."""
    rows = table[(table["shift"] != "experiment") & (table["metric"] == "obstacle_iou")]
    groups = list(rows.groupby("shift", sort=False))
    across = math.ceil(len(groups) / 2)
    size: Any = (0.6 + 2.2 * across, 4.8)
    figure, axes = plt.subplots(2, across, figsize=size, layout="constrained", sharey=True, squeeze=False)
    for ax, (shift, of_shift) in zip(axes.flat, groups, strict=False):
        networks = of_shift.groupby(["model", "encoding", "seed"], sort=False)
        network: Any
        for (network, line), look in zip(networks, cycle(LOOKS), strict=False):
            spread = [line["value"] - line["low"], line["high"] - line["value"]]
            label = f"{predictor_title(*network[:2])}, seed {network[2]}"
            ax.errorbar(
                line["tested"].astype(float), line["value"], spread, markersize=3, capsize=2, label=label, **look
            )
        ax.set(xlabel=shift)
    for ax in list(axes.flat)[len(groups) :]:
        ax.set_axis_off()
    axes[0, 0].set(ylabel="obstacle IoU", ylim=(0, None))
    one_legend(figure, axes[0])
    return figure


def test_network(job: Job) -> pd.DataFrame:
    """Test the networks of a call on the recordings of one another, and that of its experiment under changes."""
    outputs, key = job.outputs, job.key
    recorded = {name: open_recordings(path) for name, path in sorted(outputs.recorded().items())}
    runs = {name: outputs.run(RunKey(name, key.model, key.encoding, key.seed)) for name in recorded}
    for name, run in runs.items():
        if run.is_trained:
            recorded[name].check_worlds(run.config().data.worlds)
    predictors = {name: load_trained(run.model) for name, run in runs.items() if run.is_trained}
    own, recordings = predictors[key.experiment], recorded[key.experiment]
    pairs = min(job.call.scale.pairs.test, 100)
    changed = outputs.path / "generalization" / f"exp{key.experiment}"
    parts = [
        across_start_headings(own, recordings),
        under_changes(own, recordings.spec, changed, pairs, workers=job.call.runtime.workers),
    ]
    tables = [pd.concat(parts).assign(trained=key.experiment)]
    for tested in predictors:
        test = load_recorded(recorded[tested], "test", own.grid)
        for trained, predictor in predictors.items():
            about = {"shift": "experiment", "trained": trained, "tested": tested}
            tables.append(score(predictor, test).assign(**about))
    return pd.concat(tables).assign(model=key.model, encoding=key.encoding, seed=key.seed)


def run(arguments: list[str]) -> None:
    """Test the network of every job of the call, and write the table and the figure."""
    parsed = main.read_arguments(["-m", *arguments])
    with compose.composed(parsed) as composed:
        jobs = [Job(call) for call in main.read_calls(parsed, composed)]
    for job in jobs:
        path = job.outputs.analysis / "generalization.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        earlier = [read_rows(path)] if path.is_file() else []
        table = pd.concat([*earlier, test_network(job)]).drop_duplicates(TEST, keep="last")
        write_text(path, table.to_csv(index=False, float_format="%.6g"))
        with plt.rc_context(STYLE):
            print(save(figure_of(table), path.with_suffix("")))


if __name__ == "__main__":
    run(sys.argv[1:])
