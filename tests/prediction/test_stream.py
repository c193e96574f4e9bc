"""The stream against `cut` with `Predictor.predict`, and against its own definition, scan by scan."""

import dataclasses
import gc
import threading
import tracemalloc

import numpy as np
import pytest
import torch
from conftest import ROOT

from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.convgru import ConvGRU
from repro.networks.create import create_network
from repro.networks.model import paper_model
from repro.networks.predictor import Predictor
from repro.prediction.logs import ScanLog
from repro.prediction.readers import read_log
from repro.prediction.stream import PredictionStream
from repro.prediction.times import WindowSettings
from repro.prediction.windows import Window, cut
from repro.scans import Scans

STEPS, GRID = 10, Grid(64, 50.0)


@pytest.fixture(scope="module")
def log() -> ScanLog:
    return read_log(ROOT / "examples" / "rooms.npz", WindowSettings())


@pytest.fixture(
    scope="module",
    params=[Projection(), create_encoding("series10", {"frames": 10})],
    ids=lambda encoding: encoding.name,
)
def predictor(request) -> Predictor:
    torch.manual_seed(0)
    return Predictor(create_network(paper_model("unet"), request.param.channels).eval(), request.param, GRID)


@pytest.fixture(scope="module")
def small() -> Predictor:
    torch.manual_seed(0)
    return Predictor(create_network(paper_model("fpn")).eval(), Projection(), Grid(32, 50.0))


def windows(log: ScanLog, center) -> dict[float, Window]:
    found = cut(log, WindowSettings(center, STEPS), 0.1, GRID.size_m)
    return {round(window.stamp, 3): window for window in found if isinstance(window, Window)}


def part(log: ScanLog, index) -> ScanLog:
    return ScanLog(log.stamps[index], log.ranges[index], log.angles, log.poses[index])


@pytest.mark.parametrize("center", ["robot", (25.0, 25.0)])
def test_every_map_is_that_of_the_window_of_the_log(predictor, log, center):
    log = part(log, slice(0, 30))
    stream, expected = PredictionStream(predictor, log.angles, center=center, steps=STEPS), windows(log, center)
    maps = [stream.update(*scan) for scan in zip(log.ranges, log.poses, log.stamps, strict=True)]
    assert [each is None for each in maps] == [number < STEPS - 1 for number in range(30)]
    encoded = []
    for each in maps[STEPS - 1 :]:
        window = expected[round(each.stamp, 3)]
        assert torch.equal(torch.as_tensor(each.free), predictor.predict(window.scans)[0])
        assert (each.origin, each.resolution_m) == (window.origin, GRID.resolution_m)
        encoded.append(window.scans)
    batch = torch.cat([predictor.encoding.encode(each.tensors(), GRID) for each in encoded])
    together = predictor.predict_images(batch, batch=1)[:, 0]
    assert torch.equal(together, torch.stack([torch.as_tensor(each.free) for each in maps[STEPS - 1 :]]))


@pytest.mark.parametrize("rate", [7, 23, 90])
def test_uneven_scans_are_resampled_to_the_steps(small, rate):
    """Against a search through all scans that are kept, without the code of windows.py."""
    random = np.random.default_rng(rate)
    stamps = 1e9 + np.cumsum(random.uniform(0.5, 1.5, 6 * rate)) / rate
    ranges = random.uniform(2, 12, (len(stamps), 20)).astype(np.float32)
    poses = random.uniform(20, 30, (len(stamps), 3)) * [1, 1, 0.02] + [0, 0, 25]  # headings of a robot
    angles = np.linspace(-0.7, 0.7, 20)
    stream, kept, count = PredictionStream(small, angles, center=(25, 25), steps=STEPS), [], 0
    for number, stamp in enumerate(stamps):
        predicted = stream.update(ranges[number], poses[number], stamp)
        if kept and stamp - stamps[kept[-1]] < 0.05:
            assert predicted is None
            assert "less than half a step" in stream.reason
            continue
        kept.append(number)
        if stamp - stamps[0] < 0.1 * (STEPS - 1.5):
            assert predicted is None
            continue
        index = [min(kept, key=lambda scan: abs(stamps[scan] - stamp + 0.1 * age)) for age in range(STEPS)][::-1]
        scans = Scans(ranges[index], angles, poses[index])
        wrapped = scans.poses - [0, 0, 2 * np.pi] * np.round(scans.poses[:, 2:] / (2 * np.pi))
        expected = small.predict(Scans(scans.ranges, angles, wrapped))[0].numpy()
        assert np.abs(predicted.free - expected).max() < 1e-6
        count += 1
    assert count > 20


@pytest.mark.parametrize("rate", [2, 4, 7, 13])
@pytest.mark.parametrize("center", ["robot", (25.0, 25.0)])
def test_maps_of_a_lidar_of_another_rate_are_those_of_the_log(small, log, rate, center):
    random = np.random.default_rng(rate)
    count = 6 * rate
    stamps = 1e9 + np.cumsum(random.uniform(0.9, 1.1, count)) / rate
    log = ScanLog(stamps, log.ranges[:count], log.angles, log.poses[:count])
    stream = PredictionStream(small, log.angles, center=center, steps=STEPS)
    maps = [stream.update(*scan) for scan in zip(log.ranges, log.poses, log.stamps, strict=True)]
    found = {each.stamp: each for each in maps if each}
    expected = list(cut(log, WindowSettings(center, STEPS), 0.2, GRID.size_m))
    assert len(expected) >= 10
    for window in expected:
        assert np.array_equal(found[window.stamp].free, small.predict(window.scans)[0])
        assert found[window.stamp].origin == window.origin


def feed(stream, log: ScanLog, stamps) -> list:
    return [
        stream.update(*scan) for scan in zip(log.ranges[: len(stamps)], log.poses[: len(stamps)], stamps, strict=True)
    ]


def test_the_first_window_after_a_gap_begins_after_it(small, log):
    stamps = np.concatenate([np.arange(0, 2, 0.1), np.arange(5, 8, 0.1)])
    maps = feed(PredictionStream(small, log.angles, steps=STEPS), log, stamps)
    has_map = np.array([each is not None for each in maps])
    assert has_map[(stamps > 0.85) & (stamps < 2) | (stamps > 5.85)].all()
    assert not has_map[(stamps < 0.85) | (stamps > 2) & (stamps < 5.85)].any()


def test_a_scan_that_is_not_later_is_left_out_and_a_clock_set_back_begins_again(small, log):
    stream = PredictionStream(small, log.angles, steps=STEPS)
    feed(stream, log, 100 + np.arange(0, 2, 0.1))
    before = stream.update(log.ranges[20], log.poses[20], 102.0)
    for late in (102.0, 101.5):
        assert stream.update(log.ranges[30], log.poses[30], late) is None
        assert "not later than the one before" in stream.reason
    after = stream.update(log.ranges[21], log.poses[21], 102.1)
    undisturbed = PredictionStream(small, log.angles, steps=STEPS)
    expected = feed(undisturbed, log, 100 + np.arange(0, 2.15, 0.1))
    assert np.array_equal(before.free, expected[20].free)
    assert np.array_equal(after.free, expected[21].free)
    again = feed(stream, log, np.arange(0, 1.95, 0.1))
    assert [each is None for each in again] == [True] * 9 + [False] * 11
    assert np.array_equal(again[15].free, expected[15].free)


def test_the_stream_of_a_lidar_that_reaches_less_far_is_that_of_the_predictor_with_its_range(log):
    encoding = create_encoding("series10", {"frames": 10})
    predictor = Predictor(ConvGRU(20, 10, hidden=16).eval(), encoding, Grid(32, 50.0))
    log = dataclasses.replace(log, ranges=np.where(log.ranges < 12, log.ranges, np.float32(np.inf)))
    stream = PredictionStream(predictor, log.angles, center=(25.0, 25.0), range_max_m=12.0)
    *_, predicted = (stream.update(*scan) for scan in zip(log.ranges[:100], log.poses, log.stamps, strict=False))
    window = Scans(log.ranges[:100], log.angles, log.poses[:100])
    assert np.array_equal(predicted.free, predictor.with_range(12.0).predict(window)[0])
    assert not np.array_equal(predicted.free, predictor.predict(window)[0])


def test_memory_is_constant(small, log):
    for rate in (10, 40, 1000):
        stream = PredictionStream(small, log.angles, center=(25, 25), steps=STEPS)
        lengths = []
        for number in range(600):
            stream._add(number / rate, log.ranges[0], log.poses[0])
            lengths.append(len(stream._kept))
        assert max(lengths) <= 2 * STEPS
    stream = PredictionStream(small, log.angles, steps=STEPS)
    feed(stream, log, np.arange(0, 3, 0.1))
    tracemalloc.start()
    used = []
    for begin in range(3, 103, 25):
        feed(stream, log, np.arange(begin, begin + 25, 0.1))
        gc.collect()  # what waits for the garbage collector is not kept
        used.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert np.diff(used).min() < 10_000  # what is kept of every scan grows each time, caches of libraries do not


def test_what_the_caller_changes_later_does_not_change_the_maps(small, log):
    stream, expected = (
        PredictionStream(small, log.angles, steps=STEPS),
        PredictionStream(small, log.angles, steps=STEPS),
    )
    ranges, pose = np.empty_like(log.ranges[0]), np.empty(3)
    for number in range(15):
        ranges[:], pose[:] = log.ranges[number], log.poses[number]
        found = stream.update(ranges, pose, log.stamps[number])
        ranges[:], pose[:] = 1, 25
    other = [expected.update(*scan) for scan in zip(log.ranges[:15], log.poses[:15], log.stamps[:15], strict=True)]
    assert np.array_equal(found.free, other[-1].free)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ranges": np.ones(7)}, r"expected ranges \(91,\) and a pose \(3,\), got \(7,\)"),
        ({"ranges": np.full(91, np.nan)}, "no valid reading"),
        ({"ranges": np.full(91, -1.0)}, "no valid reading"),
        ({"pose": np.array([0, np.nan, 0])}, "finite pose"),
        ({"stamp": float("nan")}, "expected finite seconds, got nan"),
        ({"stamp": "1.5"}, "expected finite seconds, got '1.5'"),
        ({"stamp": 1.7e18}, r"time: expected seconds, got 1.7e\+18, which looks like ns: float64 resolves 2.6e\+02"),
        ({"stamp": 1.7e15}, "looks like us: float64 resolves 0.25"),
        ({"stamp": 1.7e12}, "looks like ms"),
    ],
)
def test_a_scan_that_cannot_be_is_refused_and_left_out(small, log, change, message):
    stream = PredictionStream(small, log.angles, steps=STEPS)
    feed(stream, log, np.arange(0, 1.45, 0.1))
    with pytest.raises(ValueError, match=message):
        stream.update(**({"ranges": log.ranges[15], "pose": log.poses[15], "stamp": 1.5} | change))
    found = stream.update(log.ranges[15], log.poses[15], 1.5)
    expected = feed(PredictionStream(small, log.angles, steps=STEPS), log, np.arange(0, 1.55, 0.1))
    assert np.array_equal(found.free, expected[-1].free)


def test_negative_readings_are_invalid_as_in_a_log(small, log):
    ranges = log.ranges[:20].copy()
    ranges[:, 3] = -0.01
    stream, expected = (PredictionStream(small, log.angles, steps=STEPS) for _ in range(2))
    found = feed(stream, dataclasses.replace(log, ranges=ranges), np.arange(0, 1.95, 0.1))[-1]
    ranges[:, 3] = np.nan
    other = feed(expected, dataclasses.replace(log, ranges=ranges), np.arange(0, 1.95, 0.1))[-1]
    assert np.array_equal(found.free, other.free)


def test_a_window_without_information_is_refused(small, log):
    stream = PredictionStream(small, log.angles, center=(1000.0, 0.0), steps=STEPS)
    with pytest.raises(ValueError, match="a robot that is outside the map"):
        feed(stream, log, np.arange(0, 1.45, 0.1))


@pytest.mark.parametrize("center", ["start", (1,), (0, float("nan")), None])
def test_an_unknown_center_is_refused(small, log, center):
    with pytest.raises(ValueError, match="center: expected robot"):
        PredictionStream(small, log.angles, center=center)


def test_angles_in_degrees_are_refused_at_once(small):
    with pytest.raises(ValueError, match="angles are beyond a full turn: expected radians"):
        PredictionStream(small, np.linspace(-45, 45, 91))


def test_angles_over_two_turns_are_refused_at_once(small):
    with pytest.raises(ValueError, match="355 of 721 angles are more than a turn from the first"):
        PredictionStream(small, np.linspace(-2 * np.pi, 2 * np.pi, 721))


def test_the_last_beam_of_a_full_turn_is_left_out_as_in_a_log(small, log, tmp_path):
    """A lidar of 360 degrees with a beam at both ends, whose two readings differ."""
    angles = np.linspace(-np.pi, np.pi, 361)
    ranges = np.random.default_rng(0).uniform(2, 12, (STEPS, 361)).astype(np.float32)
    ranges[:, 0] = np.nan
    arrays = {"ranges": ranges, "angles": angles, "poses": log.poses[:STEPS], "stamps": 0.1 * np.arange(STEPS)}
    np.savez(tmp_path / "full.npz", **arrays)
    stream = PredictionStream(small, angles, center=(25.0, 25.0), steps=STEPS, range_max_m=None)
    *_, found = (stream.update(*scan) for scan in zip(ranges, arrays["poses"], arrays["stamps"], strict=True))
    (window,) = windows(read_log(tmp_path / "full.npz", WindowSettings(steps=STEPS)), (25.0, 25.0)).values()
    assert window.scans.ranges.shape[-1] == 360
    assert torch.equal(torch.as_tensor(found.free), small.predict(window.scans)[0])


def test_a_heading_in_degrees_is_refused(small, log):
    stream = PredictionStream(small, log.angles, steps=STEPS)
    with pytest.raises(ValueError, match="headings look like degrees, the largest is 90: expected radians"):
        stream.update(log.ranges[0], np.array([25, 25, 90.0]), 0.0)
    assert not stream._kept


@pytest.mark.parametrize(("steps", "step_s"), [(9, 0.1), (0, 0.1), (50.5, 0.1), (100, 0.0), (100, float("inf"))])
def test_an_impossible_window_is_refused_at_once(small, log, steps, step_s):
    series = dataclasses.replace(small, encoding=create_encoding("series10", {"frames": 10, "range_max_m": 30.0}))
    with pytest.raises(ValueError, match=f"10 steps or more, a whole number, and .*, got {steps} and {step_s}"):
        PredictionStream(series, log.angles, steps=steps, step_s=step_s)


def test_the_window_is_that_of_the_training_unless_another_is_chosen(small, log):
    trained = dataclasses.replace(small, steps=40, step_s=0.5)
    usual, chosen = PredictionStream(trained, log.angles), PredictionStream(trained, log.angles, steps=10, step_s=0.2)
    assert (usual.settings.steps, usual.settings.step_s) == (40, 0.5)
    assert (chosen.settings.steps, chosen.settings.step_s) == (10, 0.2)


def test_a_window_of_reversed_beams_or_another_byte_order_is_predicted(predictor, log):
    """As of a lidar that is mounted upside down, whose arrays are views with negative strides."""
    window = Scans(log.ranges[:STEPS], log.angles, log.poses[:STEPS])
    reversed_beams = Scans(log.ranges[:STEPS, ::-1], log.angles[::-1], log.poses[:STEPS])
    swapped = Scans(log.ranges[:STEPS].astype(">f4"), log.angles.astype(">f8"), log.poses[:STEPS])
    for other in (reversed_beams, swapped):
        assert torch.equal(predictor.predict(other), predictor.predict(window))


def test_a_stream_may_be_used_by_several_threads(small, log):
    stream, failures = PredictionStream(small, log.angles, steps=STEPS), []

    def update(first: int) -> None:
        try:
            for number in range(first, 30, 3):
                stream.update(log.ranges[number], log.poses[number], log.stamps[number])
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=update, args=(first,)) for first in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    kept = [stamp for stamp, _, _ in stream._kept]
    assert kept == sorted(set(kept))
    assert bool(stream), "a stream without scans is no less a stream"


def test_pixels_that_no_reading_supports_are_unknown(small, log):
    """One beam of 4 m ahead supports the pixels along it, and nothing else."""
    ranges = np.full_like(log.ranges[:STEPS], np.nan)
    ranges[:, 40:51] = 4.0
    stream = PredictionStream(small, log.angles, center=(25.0, 25.0), steps=STEPS)
    poses = np.tile([25.0, 25.0, 0.0], (STEPS, 1))
    *_, predicted = (stream.update(*scan) for scan in zip(ranges, poses, log.stamps, strict=False))
    x, y = (Grid(32, 50.0).centers().numpy() - 25.0).T
    is_supported = ~predicted.unknown.ravel()
    assert is_supported.any()
    assert (x[is_supported] > -1.6).all()
    assert (np.hypot(x, y)[is_supported] < 6).all()


def test_windows_of_few_valid_readings_are_refused(small, log):
    stream = PredictionStream(small, log.angles, center=(25.0, 25.0), steps=STEPS)
    ranges = np.full_like(log.ranges[:STEPS], np.nan)
    ranges[:, 45] = 4.0
    poses = np.tile([25.0, 25.0, 0.0], (STEPS, 1))
    for number in range(STEPS - 1):
        stream.update(ranges[number], poses[number], log.stamps[number])
    with pytest.raises(ValueError, match=r"windows are with too few valid readings: .* the fewest have 1\.1%"):
        stream.update(ranges[-1], poses[-1], log.stamps[STEPS - 1])
