import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import world_spec

from repro.reporting.figures import (
    Example,
    data_collection,
    data_representation,
    irsim_drawing,
    method_overview,
    results,
)
from repro.simulation.recording import record
from repro.simulation.worlds import sample_world


@pytest.fixture
def example():
    run = record(sample_world(world_spec("3"), 0))
    image = np.full((32, 32), 255, dtype=np.uint8)
    image[4:8, 4:8] = 0
    return Example("Experiment 3", image, image / 255, image // 255, run.ranges, run.poses, 0.8)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_irsim_draws_the_world_it_is_given():
    """The drawing is dark in the middle of every obstacle and nowhere in the emptied zone but at the robot."""
    world = sample_world(world_spec("1"), 0)
    gray = irsim_drawing(world, step=0, size_px=500)[..., :3].mean(-1)
    assert gray.shape == (500, 500)
    for obstacle in world["obstacle"]:
        x, y = obstacle["state"][:2]
        assert gray[499 - int(10 * y), int(10 * x)] < 30


def test_all_setups_are_drawn():
    specs = {experiment: world_spec(experiment) for experiment in "1234"}
    figure = data_collection(specs, seed=1, step=3)
    assert [ax.get_title().split("\n")[0] for ax in figure.axes] == [f"Experiment {e}" for e in "1234"]


def test_results_show_input_prediction_and_truth(example):
    figure = results([example, example])
    assert len(figure.axes) == 6
    shown = [ax.images[0].get_array() for ax in figure.axes[::2]]
    for image, name in zip(shown, ("projection", "prediction", "truth"), strict=True):
        scale = 1 if name == "projection" else 255
        assert np.array_equal(image, scale * getattr(example, name)), name


def test_representation_and_overview_are_drawn(example, tmp_path):
    for figure in (data_representation([example]), method_overview(example)):
        figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
