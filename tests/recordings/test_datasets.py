from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import torch
from conftest import run_config, world_spec

from repro.maps.encodings import create_encoding, to_input
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.maps.statistics import summarize
from repro.recordings.datasets import HIDDEN, Batches, Pairs, load_pairs, training_statistics
from repro.recordings.format import ShardContent
from repro.recordings.reader import open_recordings
from repro.scans import Scans
from repro.simulation.raycasting import scan
from repro.simulation.sampling import reverse_direction, sample_world
from repro.simulation.simulator import simulate


def test_pairs_are_images_and_maps_of_the_split(recorded):
    pairs = load_pairs(open_recordings(recorded), "train", Grid(64, 50.0), Projection())
    assert pairs.stored.shape == pairs.maps.shape == (24, 1, 64, 64)
    assert pairs.stored.dtype == pairs.maps.dtype == torch.uint8
    assert set(pairs.maps.unique().tolist()) == {0, 1}
    image, target = pairs.batch(torch.tensor([3, 5]))
    assert image.dtype == target.dtype == torch.float32
    assert image.min() == 0
    assert image.max() == 1


@pytest.mark.parametrize(
    ("drawn", "bits", "message"),
    [
        (lambda images: images / 255, 8, r"must draw images of uint8, \(\d+, 1, 64, 64\), got float64"),
        (lambda images: images[:, :, :32], 8, r"must draw .*, got uint8, \(\d+, 1, 32, 64\)"),
        (lambda images: images, 1, "has 1 bits and must draw multiples of 255"),
        (lambda images: images, 4, "has 4 bits and must draw multiples of 17"),
    ],
)
def test_other_images_than_an_encoding_promises_are_refused(recorded, drawn, bits, message):
    class Own(Projection):
        bits: ClassVar[int] = 8

        def encode(self, scans, grid):
            return drawn(super().encode(scans, grid))

    Own.bits = bits
    with pytest.raises(ValueError, match=f"the encoding projection {message}"):
        load_pairs(open_recordings(recorded), "train", Grid(64, 50.0), Own())


def test_the_statistics_of_a_training_are_those_of_its_scans(recorded):
    recordings = open_recordings(recorded)
    scans = (shard.scans.batched() for shard in recordings.shards("train"))
    assert training_statistics(recordings, run_config()) == summarize(scans, Grid(32, 50.0))


def test_newest_hits_are_on_the_border_of_an_obstacle(recorded):
    """Hits of the last step, drawn black, touch an obstacle of the map at that step."""
    pairs = load_pairs(open_recordings(recorded), "test", Grid(128, 50.0), Projection())
    near = torch.nn.functional.max_pool2d(1 - pairs.maps.float(), 3, stride=1, padding=1)
    newest = pairs.stored == 0
    assert newest.any()
    assert near[newest].mean() > 0.99


@pytest.mark.parametrize(("name", "width"), [("series4", 5), ("counts4", 18)])
def test_a_series_is_stored_in_few_bits_and_given_as_drawn(recorded, name, width):
    grid, encoding = Grid(35, 50.0), create_encoding(name, {"frames": 4})  # the last byte of a row is not full
    pairs = load_pairs(open_recordings(recorded), "val", grid, encoding)
    assert pairs.stored.shape == (8, 8, 35, width)
    drawn = np.concatenate(
        [encoding.encode(shard.scans.batched(), grid) for shard in open_recordings(recorded).shards("val")]
    )
    assert np.array_equal(next(pairs.image_batches(len(pairs))), drawn)
    image, target = pairs.batch(torch.tensor([3, 5]))
    assert np.array_equal(image, to_input(drawn[[3, 5]], inverted=True))
    assert image.is_contiguous()
    assert target.shape == (2, 1, 35, 35)


def test_batches_are_shuffled_by_seed_and_drop_the_incomplete_last_one():
    pairs = Pairs(torch.arange(10, dtype=torch.uint8).view(10, 1, 1, 1), torch.zeros(10, 1, 1, 1), Projection())
    shuffled = Batches(pairs, 4, seed=1)
    seen = [(255 * image).round().int().flatten().tolist() for image, _ in shuffled]
    assert [len(batch) for batch in seen] == [4, 4] == [4] * len(shuffled)
    assert seen == [(255 * image).round().int().flatten().tolist() for image, _ in Batches(pairs, 4, seed=1)]
    assert seen != [(255 * image).round().int().flatten().tolist() for image, _ in Batches(pairs, 4, seed=2)]
    in_order = Batches(pairs, 4)
    assert [len(image) for image, _ in in_order] == [4, 4, 2]
    assert len(in_order) == 3
    with pytest.raises(ValueError, match=r"batch_size=16 but there are only 10"):
        Batches(pairs, 16, seed=0)


def test_flip_augmentation_flips_image_and_map_together(recorded):
    pairs = load_pairs(open_recordings(recorded), "train", Grid(64, 50.0), Projection())
    plain, mirrored = (
        list(Batches(pairs, 8, seed=3, flip_augmentation=flip_augmentation)) for flip_augmentation in (False, True)
    )
    flipped = 0
    for (image, target), (other_image, other_target) in zip(plain, mirrored, strict=True):
        for k in range(8):
            same = torch.equal(image[k], other_image[k]) and torch.equal(target[k], other_target[k])
            turned = torch.equal(image[k].flip(-2), other_image[k]) and torch.equal(target[k].flip(-2), other_target[k])
            assert same or turned
            flipped += not same
    assert 4 < flipped < 20  # of 24
    again = list(Batches(pairs, 8, seed=3, flip_augmentation=True))
    assert all(torch.equal(a[0], b[0]) for a, b in zip(mirrored, again, strict=True))


def test_half_of_the_pairs_are_flipped():
    image = torch.tensor([0, 255], dtype=torch.uint8).view(1, 1, 2, 1).expand(2000, -1, -1, -1)
    ((_, target),) = Batches(Pairs(image, image, Projection()), 2000, seed=0, flip_augmentation=True)
    assert (target[:, 0, 0] > 0).float().mean().item() == pytest.approx(0.5, abs=0.05)


def test_pixels_that_standing_obstacles_hide_at_the_last_step_are_marked():
    """A wall from the lower to the upper border; the robot has passed from its left side to its right side."""
    wall, poses = np.array([[-2, -25], [2, -25], [2, 25], [-2, 25.0]]), np.array([[5, 25, 0], [45, 25, 0.0]])
    scans = Scans(np.full((2, 2, 3), np.inf), np.linspace(-0.5, 0.5, 3), np.stack([poses, poses]))
    states = np.tile([25.0, 25.0, 0.0], (1, 2, 1))
    shard = ShardContent(scans, wall[None], states, np.zeros(1, int), np.ones((2, 1), bool))
    recordings = SimpleNamespace(shards=lambda *_: [shard], manifest=SimpleNamespace(pairs={"train": 2}))
    maps = load_pairs(recordings, "train", Grid(50, 50.0), Projection(), marks_hidden=True).maps
    assert (maps[..., :22] == 1 + HIDDEN).all()
    assert (maps[..., 28:] == 1).all()


@pytest.mark.parametrize("experiment", ["3", "4"])
def test_a_flipped_recording_is_that_of_the_mirrored_world_seen_by_the_twin(experiment):
    """The image of the mirrored world along the path of the twin is the mirrored image."""
    world = sample_world(world_spec(experiment), 5)
    recording, twin = simulate(world), simulate(reverse_direction(world))
    mirrored = recording.states * [1, -1, -1] + [0, 50, 0]
    outlines = recording.outlines * [1, -1]
    ranges, _ = scan(twin.scans.poses, twin.scans.angles, outlines, mirrored, 30.0)
    grid = Grid(64, 50.0)
    here, there = (
        Projection().encode(scans.batched(), grid)
        for scans in (recording.scans, Scans(ranges, twin.scans.angles, twin.scans.poses))
    )
    assert (here[..., ::-1, :] != there).mean() < 2e-3  # hits on the edge of a pixel
