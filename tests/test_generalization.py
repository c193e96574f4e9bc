import math

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT, world_spec
from reproduce import generalization

from repro.learning.networks.trained import load_trained
from repro.maps.grid import Grid
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import load_recorded
from repro.reporting.results import read_rows
from repro.simulation.raycasting import scan
from repro.simulation.recorder import record_experiment
from repro.simulation.sampling import sample_world
from repro.worlds import spec as world_config

RESULTS = ROOT / "reproduce" / "results"


def test_a_wider_view_has_more_beams_and_the_same_worlds():
    spec = world_spec("4")
    wide = generalization.with_field_of_view(spec, 180)
    assert wide.lidar.angle_range == pytest.approx(math.pi)
    assert wide.lidar.number == 200
    assert generalization.with_field_of_view(spec, 90).lidar.number == 100
    assert sample_world(spec, 7)["obstacle"] == sample_world(wide, 7)["obstacle"]
    near = generalization.with_range(spec, 10)
    assert near.lidar.range_max == 10
    assert sample_world(spec, 7)["obstacle"] == sample_world(near, 7)["obstacle"]
    fast = generalization.with_speed(spec, 2)
    assert fast.obstacles.behavior.speed_m_s == (0.4, 1.4)
    assert spec.obstacles.behavior.speed_m_s == (0.2, 0.7)


@pytest.mark.parametrize("degrees", [90, 180, 270])
@pytest.mark.parametrize("experiment", ["1", "4"])
def test_turned_recordings_are_those_of_turned_worlds(tmp_path, experiment, degrees):
    """The recorder's ray casting in the turned world gives the same ranges at the turned poses."""
    record_experiment(tmp_path, world_spec(experiment), {"test": 2}, workers=1)
    plain, (shard,) = (
        load_recorded(open_recordings(tmp_path), "test", Grid(64, 50.0)),
        open_recordings(tmp_path).shards("test"),
    )
    test, angle = generalization.turned(plain, degrees), math.radians(degrees)
    cos, sin = round(math.cos(angle)), round(math.sin(angle))
    states = shard.states.astype(float)
    states[..., :2] = (states[..., :2] - 25) @ np.array([[cos, sin], [-sin, cos]]) + 25
    states[..., 2] += angle
    assert np.array_equal(test.maps[0, 0], np.rot90(plain.maps[0, 0], degrees // 90))
    for poses, recorded in zip(test.scans.poses, test.scans.ranges, strict=True):
        ranges, _ = scan(poses, test.scans.angles, shard.outlines, states, test.range_max_m)
        same = np.isfinite(ranges) == np.isfinite(recorded)
        assert same.mean() > 0.9999  # the recorded states are rounded to 32 bits
        both = same & np.isfinite(ranges)
        assert np.abs(ranges[both] - recorded[both]).max() < 1e-3


def test_the_figure_has_a_panel_per_change_and_a_line_per_network():
    figure = generalization.figure_of(read_rows(RESULTS / "laptop" / "analysis" / "generalization.csv"))
    assert len([ax for ax in figure.axes if ax.axison]) == 5
    assert len(figure.axes[0].containers) == 2
    plt.close(figure)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("weights", "published", "experiment", "shift"),
    [
        ("workstation/exp4-unet", "workstation", "4", "obstacles' speed [times]"),
        ("drive-16000/expmixed-convgru", "drive-16000", "mixed", "maximum range [m]"),
    ],
)
def test_published_rows_are_those_of_published_weights(weights, published, experiment, shift, tmp_path, monkeypatch):
    change, amounts = generalization.WORLDS[shift]
    monkeypatch.setattr(generalization, "CHANGES", {"scans skipped": (generalization.skipped_scans, (4.0,))})
    monkeypatch.setattr(generalization, "WORLDS", {shift: (change, amounts[1:2])})
    monkeypatch.setattr(generalization, "START_HEADINGS", (180,))
    world = ROOT / "conf" / "world" / ("paper.yaml" if experiment == "4" else "drive.yaml")
    spec = world_config.world_spec(world_config.read_world(world), experiment)
    predictor = load_trained(RESULTS / weights)
    tables = [generalization.under_changes(predictor, spec, tmp_path, 200, workers=1)]
    if experiment == "4":
        record_experiment(tmp_path / "test", spec, {"test": 500}, workers=1)
        tables.append(generalization.across_start_headings(predictor, open_recordings(tmp_path / "test")))

    rows = read_rows(RESULTS / published / "analysis" / "generalization.csv")
    rows = rows[(rows["model"] == weights.rpartition("-")[2]) & (rows["trained"] == experiment)]
    both = pd.concat(tables).merge(rows, on=["shift", "tested", "metric"], suffixes=("", "_published"))
    assert set(both["shift"]) == {"scans skipped", shift} | ({"start heading [deg]"} if experiment == "4" else set())
    assert both["value"].to_numpy() == pytest.approx(both["value_published"].to_numpy(), abs=2e-3)
