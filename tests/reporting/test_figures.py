import dataclasses
import shutil

import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import fake_run, world_spec

from repro.cli.paper_figures import draw_figures
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.reporting.figures import (
    Example,
    data_representation,
    irsim_drawing,
    load_example,
    method_overview,
    results,
    write_figures,
)
from repro.runs.config import PROJECTION
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status
from repro.simulation.recorder import record_experiment
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate


@pytest.fixture(scope="module")
def example():
    scans = simulate(sample_world(world_spec("3"), 0)).scans
    image = np.full((32, 32), 255, dtype=np.uint8)
    image[4:8, 10:14] = 0
    return Example("3", PROJECTION, image, image / 510, image.T // 255, scans, 0.8)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_irsim_draws_the_given_world():
    """The drawing is dark in the center of every obstacle."""
    world = sample_world(world_spec("1"), 0)
    gray = irsim_drawing(world, step=0, size_px=500)[..., :3].mean(-1)
    assert gray.shape == (500, 500)
    for obstacle in world["obstacle"]:
        x, y = obstacle["state"][:2]
        assert gray[499 - int(10 * y), int(10 * x)] < 30


def test_results_and_overview_show_scans_poses_projection_prediction_and_truth(example):
    drawn = (example.projection, 255 * example.prediction, 255 * example.truth)
    scans, poses, *others = method_overview(example).axes
    ranges = np.where(np.isinf(example.scans.ranges), np.nan, example.scans.ranges)
    figure = results([example, example])
    assert len(figure.axes) == 6
    for axes, images in (((scans, *others), (ranges, *drawn)), (figure.axes[::2], drawn)):
        for ax, image in zip(axes, images, strict=True):
            shown = np.ma.filled(ax.images[0].get_array().astype(float), np.nan)
            assert np.array_equal(shown, image, equal_nan=True), ax.get_title()
    (arrows,) = poses.collections
    assert np.allclose(arrows.get_offsets(), example.scans.poses[::4, :2])


def test_the_representation_shows_one_projection_per_experiment_with_the_meaning_of_the_grays(example):
    figure = data_representation([example, dataclasses.replace(example, experiment="4")])
    *panels, bar = figure.axes
    assert [ax.get_title() for ax in panels] == ["Experiment 3\nDynamic, rotation", "Experiment 4\nDynamic, square"]
    assert all(np.array_equal(ax.images[0].get_array(), example.projection) for ax in panels)
    assert bar.get_yticks().tolist() == [0, 204, 255]
    assert [label.get_text() for label in bar.get_yticklabels()] == ["last step", "first step", "no hit"]


def test_the_image_of_an_example_is_the_projection_of_its_scans(evaluated):
    outputs, key = Outputs(evaluated.path.parents[4]), evaluated.config().key
    example = load_example(outputs, key)
    drawn = Projection().encode(example.scans.batched(), Grid(32, 50.0))[0, 0]
    assert np.array_equal(example.projection, drawn)


def test_figures_without_data_are_deleted(example, tmp_path):
    figures = {"data_collection", "method_overview", "data_representation", "results"}
    written = write_figures(tmp_path, {"3": sample_world(world_spec("3"), 0)}, [example])
    assert {path.stem for path in written} == figures
    mine = tmp_path / "mine.png"
    mine.touch()
    write_figures(tmp_path, {}, [example])
    assert {path.stem for path in tmp_path.iterdir()} == {*figures, "mine"} - {"data_collection"}


def test_figures_show_the_network_with_the_lowest_seed(tmp_path, monkeypatch):
    for seed in (2, 1):
        fake_run(tmp_path, "3", "unet", 0.5, seed=seed)
    fake_run(tmp_path, "3", "unet", 0.5, seed=0, status=Status.failed)
    fake_run(tmp_path, "3", "fpn", 0.5)
    shutil.copytree(
        tmp_path / RunKey("3", "unet", PROJECTION, 1).path, tmp_path / "runs/exp3/unet/projection/seed1_old"
    )
    record_experiment(Outputs(tmp_path).recordings("3"), world_spec("3"), {"train": 2, "val": 2, "test": 2}, workers=1)
    shown = []
    monkeypatch.setattr("repro.cli.paper_figures.load_example", lambda outputs, key: shown.append(key))
    monkeypatch.setattr("repro.cli.paper_figures.write_figures", lambda *_: [])
    draw_figures(Outputs(tmp_path))
    assert shown == [RunKey("3", "unet", PROJECTION, 1)]
