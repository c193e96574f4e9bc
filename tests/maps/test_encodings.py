import math
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from omegaconf import OmegaConf

from repro.maps.encodings import ENCODINGS, Encoding, create_encoding, kind_of, to_input
from repro.maps.grid import Grid
from repro.maps.projection import Projection, newest_hits
from repro.maps.series import Counts, Series, Stack
from repro.maps.visibility import newest_passed
from repro.recordings.reader import open_recordings
from repro.scans import Scans
from repro.worlds.spec import plain

GRID = Grid(64, 50.0)
CONFIGURED = sorted((ROOT / "conf" / "encoding").glob("*.yaml"))


def configured(path: Path) -> Encoding:
    """Create the encoding of a file in conf/encoding with the parameters it has by default."""
    world = OmegaConf.load(ROOT / "conf" / "world" / "paper.yaml")
    values = {"world": world, "decay": True, "oldest_gray": 0.8, "encoding": OmegaConf.load(path)}
    return create_encoding(**plain(OmegaConf.create(values))["encoding"])


ALL = [configured(path) for path in CONFIGURED]


@pytest.fixture(scope="module")
def scans(recorded):
    return next(open_recordings(recorded).shards("test")).scans.batched()


def test_every_encoding_has_a_configuration_and_every_configuration_an_encoding():
    assert [encoding.name for encoding in ALL] == [path.stem for path in CONFIGURED]
    assert {kind_of(encoding.name) for encoding in ALL} == set(ENCODINGS)


@pytest.mark.parametrize("encoding", ALL, ids=lambda encoding: encoding.name)
def test_an_encoding_is_created_again_from_its_parameters_and_follows_the_range_of_the_lidar(encoding):
    assert create_encoding(encoding.name, vars(encoding)) == encoding
    shorter = encoding.with_range(7.0)
    assert (shorter.name, shorter.reach_m) == (encoding.name, 7.0 if encoding.reach_m else 0.0)


@pytest.mark.parametrize("encoding", ALL, ids=lambda encoding: encoding.name)
def test_images_and_inputs_have_the_expected_shape_type_and_range(scans, encoding):
    images = encoding.encode(scans, GRID)
    assert images.shape == (len(scans), encoding.channels, 64, 64)
    assert images.dtype == np.uint8
    inputs = to_input(images, inverted=encoding.is_inverted)
    assert inputs.shape == images.shape
    assert (inputs.dtype, inputs.min(), inputs.max()) == (np.float32, 0, 1)
    assert (inputs[images == 0] == encoding.is_inverted).all()


@pytest.mark.parametrize("encoding", ALL, ids=lambda encoding: encoding.name)
def test_a_window_is_encoded_alone_as_in_a_batch(scans, encoding):
    assert np.array_equal(encoding.encode(scans[1:2], GRID)[0], encoding.encode(scans, GRID)[1])


def test_a_window_with_fewer_steps_than_parts_is_refused(scans):
    with pytest.raises(ValueError, match="divides a window into 4 parts, got a window of 3 steps"):
        Series(4).encode(Scans(scans.ranges[:, :3], scans.angles, scans.poses[:, :3]), GRID)


@pytest.mark.parametrize("steps", [4, 7, 100])
def test_a_series_encodes_the_hits_and_the_free_pixels_of_each_part_of_the_window(scans, steps):
    """The parts need not be equally long."""
    window = Scans(scans.ranges[:, :steps], scans.angles, scans.poses[:, :steps])
    images = Series(4).encode(window, GRID)
    assert np.array_equal(images[:, :4], Stack(4).encode(window, GRID))
    for number, part in enumerate(np.array_split(np.arange(steps), 4)):
        alone = Scans(scans.ranges[:, part], scans.angles, scans.poses[:, part])
        assert np.array_equal(images[:, number : number + 1], Projection(decay=False).encode(alone, GRID))
        assert np.array_equal(images[:, 4 + number] == 0, newest_passed(alone, GRID, 30.0) > 0)
    assert steps < 100 or 0.02 < (images[:, 4:] == 0).mean() < 0.5


@pytest.mark.parametrize("steps", [10, 12, 37, 100, 250])
def test_parts_get_shorter_towards_now_and_the_newest_is_one_step(steps):
    lengths = np.diff([0, *Counts(10)._ends(steps)])
    assert lengths.sum() == steps
    assert lengths[-1] == lengths.min() == 1
    assert (np.diff(lengths) <= 0).all()
    if steps == 100:
        assert lengths.tolist() == [32, 23, 15, 10, 7, 5, 3, 2, 2, 1]


def test_counts_are_of_the_steps_of_each_part_that_hit_or_passed_over_a_pixel(scans):
    images = Counts(10).encode(scans, GRID)
    begin = 0
    for part, end in enumerate(Counts(10)._ends(scans.ranges.shape[1])):
        steps = [Scans(scans.ranges[:, [step]], scans.angles, scans.poses[:, [step]]) for step in range(begin, end)]
        hits = sum((newest_hits(step, GRID) > 0).astype(int) for step in steps)
        passes = sum((newest_passed(step, GRID, 30.0) > 0).astype(int) for step in steps)
        for kind, counts in enumerate((hits, passes)):
            dark = (255 - images[:, 10 * kind + part].astype(float)) / 255
            share = np.log1p(counts) / np.log1p(end - begin)
            assert ((dark >= share - 1e-6) & (dark <= share + 1 / 15)).all()
            assert np.array_equal(dark > 0, counts > 0)
        begin = end
    assert len(np.unique(images)) > 8


def test_an_encoding_is_created_from_its_name_and_parameters():
    assert create_encoding("projection", {"decay": False, "oldest_gray": 0.5}) == Projection(False, 0.5)
    with pytest.raises(ValueError, match=r"encoding must be one of .*projection.*got 'stacks'"):
        create_encoding("stacks", {})
    with pytest.raises(ValueError, match="encoding projection takes decay, oldest_gray, got dark"):
        create_encoding("projection", {"dark": 1})
    assert create_encoding("stack4", {"frames": 4}) == Stack(4)
    with pytest.raises(ValueError, match=r"stack4 does not match its parameters .* describe stack5"):
        create_encoding("stack4", {"frames": 5})


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("series4", {"frames": 4, "range_max_m": -1}, "range_max_m=-1: must be greater than 0"),
        ("series4", {"frames": 4, "range_max_m": math.inf}, "range_max_m=inf: must be a finite number"),
        ("stack4", {"frames": True}, "frames=True: must be a valid integer"),
        ("stack4", {}, "frames: is missing"),
        ("projection", {"decay": "foo"}, "decay=foo: must be a valid boolean"),
        ("projection", {"oldest_gray": math.nan}, "oldest_gray=nan: must be"),
        ("projection", {"oldest_gray": 1}, "oldest_gray=1: must be less than or equal to 0.996"),
    ],
)
def test_invalid_parameters_are_refused(name, parameters, message):
    with pytest.raises(ValueError, match=message):
        create_encoding(name, parameters)
