import numpy as np
import pytest
import torch
from conftest import world_spec
from PIL import Image

from repro.maps.encodings import create_encoding
from repro.maps.ground_truth import rasterize
from repro.networks.convgru import ConvGRU
from repro.networks.predictor import Predictor, load_predictor
from repro.reporting import animation, page
from repro.reporting.animation import make_frames, write_animation
from repro.simulation.simulator import simulate
from repro.simulation.worlds import sample_world


@pytest.fixture(scope="module")
def recording():
    return simulate(sample_world(world_spec("4"), 17))


@pytest.fixture(scope="module")
def predictor(evaluated):
    return load_predictor(evaluated.model)


def test_the_last_frame_is_the_whole_recording(recording, predictor):
    frames = make_frames(recording, predictor, every=25)
    assert frames.steps.tolist() == [25, 50, 75, 100]
    assert np.allclose(frames.predictions[-1], predictor.predict(recording.scans)[0], atol=1e-5)
    outlines, last = torch.as_tensor(recording.outlines).float(), torch.as_tensor(recording.states[:, -1]).float()
    truth = rasterize(outlines, last, torch.zeros(len(last), dtype=torch.long), 1, predictor.grid)[0]
    assert np.array_equal(frames.maps[-1], truth.numpy())


def test_the_image_fills_as_the_robot_turns(recording, predictor):
    frames = make_frames(recording, predictor, every=10)
    hits = (frames.images < 255).sum((1, 2))
    assert (np.diff(hits) >= 0).all()
    assert hits[-1] > 1.5 * hits[0]
    assert (frames.images == 0).any((1, 2)).all()  # what is seen now is black at every step


def test_a_series_is_shown_as_one_image(recording, predictor):
    series = Predictor(
        ConvGRU(8, 4, hidden=16), create_encoding("series4", {"frames": 4, "range_max_m": 10.0}), predictor.grid
    )
    frames = make_frames(recording, series, every=50)
    assert np.array_equal(frames.images[-1], make_frames(recording, predictor, every=50).images[-1])


def test_long_recordings_have_a_limited_number_of_frames(recording, predictor, monkeypatch):
    monkeypatch.setattr(animation, "MOST_FRAMES", 7)
    monkeypatch.setattr(animation, "BATCH", 2)
    frames = make_frames(recording, predictor)
    assert frames.steps.tolist() == [10, 25, 40, 55, 70, 85, 100]
    assert len(frames.images) == len(frames.predictions) == len(frames.maps) == 7


@pytest.mark.slow
def test_the_animation_has_every_step(recording, predictor, tmp_path):
    frames = make_frames(recording, predictor, every=20)
    write_animation(recording, frames, tmp_path / "moving.gif", size_m=50.0, range_max_m=30.0)
    with Image.open(tmp_path / "moving.gif") as picture:
        assert picture.n_frames >= 5
        first, second = (np.asarray(picture.convert("L")) for _ in map(picture.seek, (0, 3)))
    assert (first != second).mean() > 0.01


def test_figures_are_embedded(tmp_path):
    Image.new("L", (300, 150)).save(tmp_path / "results.png", dpi=(150, 150))
    embedded = {name: page._embedded(path) for name, path in page.images_of(tmp_path).items()}
    assert embedded["results"]["width"] == pytest.approx(2 * page.PX_PER_INCH, abs=1)
    assert embedded["results"]["url"].startswith("data:image/png;base64,")
