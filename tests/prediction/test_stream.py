"""The stream against `cut` with `Predictor.predict`, and against its own definition, scan by scan."""

import copy
import dataclasses
import os
import pickle
import queue
import signal
import threading

import numpy as np
import pytest
import torch
from conftest import ROOT
from log_files import npz, read

from repro.learning.networks.convgru import ConvGRU
from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.maps.statistics import summarize
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.drawing import draw_map
from repro.prediction.stream import EXTRA, PredictionStream
from repro.prediction.stream_map import predict_map
from repro.prediction.windows import Window, cut
from repro.runs.model import paper_model
from repro.scans import Scans
from repro.system.errors import InputError

STEPS, GRID = 10, Grid(64, 50.0)
SERIES = create_encoding("series10", {"frames": 10})
LOG = read(ROOT / "examples" / "rooms.npz", WindowSettings())
ANGLES = LOG.angles


@pytest.fixture(scope="module", params=[Projection(), SERIES], ids=lambda encoding: encoding.name)
def predictor(request) -> Predictor:
    torch.manual_seed(0)
    return Predictor(TorchNetwork(create_network(paper_model("unet"), request.param.channels)), request.param, GRID)


@pytest.fixture(scope="module")
def small() -> Predictor:
    torch.manual_seed(0)
    return Predictor(TorchNetwork(create_network(paper_model("fpn"))), Projection(), Grid(32, 50.0))


def windows(log: ScanLog, center) -> dict[float, Window]:
    found = cut(log, WindowSettings(center, STEPS), 0.1, GRID.size_m)
    return {window.stamp: window for window in found if isinstance(window, Window)}


def feed(stream: PredictionStream, stamps=None, ranges=LOG.ranges, poses=LOG.poses) -> list:
    stamps = LOG.stamps if stamps is None else stamps
    return [stream.update(*scan) for scan in zip(ranges, poses, stamps, strict=False)]


@pytest.mark.parametrize("center", ["robot", (25.0, 25.0)])
def test_every_map_is_that_of_the_window_of_the_log(predictor, center):
    log = ScanLog(LOG.stamps[:20], LOG.ranges[:20], ANGLES, LOG.poses[:20])
    stream, expected = PredictionStream(predictor, ANGLES, center=center, steps=STEPS), windows(log, center)
    maps = feed(stream, log.stamps)
    assert [found is None for found in maps] == [number < STEPS - 1 for number in range(20)]
    encoded = []
    for found in maps[STEPS - 1 :]:
        window = expected[found.stamp]
        assert np.array_equal(found.free, predictor.predict(window.scans)[0])
        assert (found.origin, found.resolution_m) == (window.origin, GRID.resolution_m)
        encoded.append(predictor.encoding.encode(window.scans.batched(), GRID))
    together = predictor.predict_images(encoded)[:, 0]
    assert np.array_equal(together, np.stack([found.free for found in maps[STEPS - 1 :]]))


@pytest.mark.parametrize("rate", [7, 23])
def test_uneven_scans_are_resampled_to_the_steps(small, rate):
    """Against a search through all scans that are kept, without the code of windows.py."""
    random = np.random.default_rng(rate)
    stamps = 1e9 + np.cumsum(random.uniform(0.5, 1.5, 40 + 2 * rate)) / rate
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
        turns = np.round(poses[index][:, 2:] / (2 * np.pi))
        window = Scans(ranges[index], angles, poses[index] - [0, 0, 2 * np.pi] * turns)
        assert np.abs(predicted.free - small.predict(window)[0]).max() < 1e-6
        count += 1
    assert count > 20


def test_a_scan_that_is_not_later_is_left_out_and_a_clock_set_back_begins_again(small):
    stream, undisturbed = (PredictionStream(small, ANGLES, steps=STEPS) for _ in range(2))
    *_, before = feed(stream, 100 + np.arange(0, 2.05, 0.1))
    for late in (102.0, 101.5):
        assert stream.update(LOG.ranges[30], LOG.poses[30], late) is None
        assert "not later than the one before" in stream.reason
    after = stream.update(LOG.ranges[21], LOG.poses[21], 102.1)
    expected = feed(undisturbed, 100 + np.arange(0, 2.15, 0.1))
    assert np.array_equal(before.free, expected[20].free)
    assert np.array_equal(after.free, expected[21].free)
    again = feed(stream, np.arange(0, 1.95, 0.1))
    assert [found is None for found in again] == [True] * 9 + [False] * 11
    assert np.array_equal(again[15].free, expected[15].free)


def test_the_stream_of_a_lidar_that_reaches_less_far_is_that_of_the_predictor_with_its_range():
    predictor = Predictor(TorchNetwork(ConvGRU(20, 10, hidden=16)), SERIES, Grid(32, 50.0))
    ranges = np.where(LOG.ranges[:100] < 12, LOG.ranges[:100], np.float32(np.inf))
    *_, predicted = feed(PredictionStream(predictor, ANGLES, center=(25.0, 25.0), range_max_m=12.0), None, ranges)
    window = Scans(ranges, ANGLES, LOG.poses[:100])
    assert np.array_equal(predicted.free, predictor.with_range(12.0).predict(window)[0])
    assert not np.array_equal(predicted.free, predictor.predict(window)[0])


def test_an_empty_place_has_a_map_whose_pixels_in_view_are_known(predictor):
    stream = PredictionStream(predictor, ANGLES, steps=STEPS, range_max_m=30.0)
    *_, found = feed(stream, ranges=np.full((STEPS, 91), np.inf))
    assert found.free.shape == (64, 64)
    assert 0.5 < found.unknown.mean() < 0.9
    assert not found.moving.any()
    assert len(found.hits) == 0
    assert found.pose == pytest.approx(LOG.poses[STEPS - 1])


def test_what_moves_is_logged_once(small, caplog):
    fine = dataclasses.replace(small, grid=Grid(128, 50.0))
    ranges = np.full((STEPS + 5, 91), 20.0, np.float32)
    for step, values in enumerate(ranges):
        values[5 * step : 5 * step + 6] = 8.0  # of someone who walks across the view
    maps = feed(PredictionStream(fine, ANGLES, steps=STEPS), ranges=ranges, poses=np.tile(LOG.poses[0], (STEPS + 5, 1)))
    assert maps[-1].moving.any()
    assert caplog.text.count("something moves") == 1
    caplog.clear()
    feed(PredictionStream(small, ANGLES, steps=STEPS), LOG.stamps[: STEPS + 5])
    assert "something moves" not in caplog.text


@pytest.mark.parametrize(("beams", "named"), [(1, []), (-1, ["beams in the reverse order"])])
def test_a_stream_warns_once_of_scans_that_do_not_fit_their_poses(small, beams, named):
    said: list[str] = []
    stream = PredictionStream(small, ANGLES, warn=said.append)
    for number, scan in enumerate(zip(LOG.ranges[:, ::beams], LOG.poses, LOG.stamps, strict=True)):
        stream.add(*scan)
        if number % 40 == 0:
            stream.predict()
    assert [name in message for name, message in zip(named, stream.inconsistencies, strict=True)] == [True] * len(named)
    assert [message for message in said if "hits are near" in message] == stream.inconsistencies


def test_a_copy_of_a_stream_warns_in_the_same_way(small):
    said = queue.SimpleQueue()  # has a lock and no copy
    stream = PredictionStream(small, ANGLES, steps=STEPS, warn=said.put)
    for copied in (copy.copy(stream), copy.deepcopy(stream)):
        assert copied.warn == stream.warn
    with pytest.raises(InputError, match="warn: expected a function of a text, got None"):
        PredictionStream(small, ANGLES, warn=None)


def test_a_map_names_what_is_outside_of_the_training(small):
    (window,) = windows(dataclasses.replace(LOG, stamps=LOG.stamps[:STEPS]), "robot").values()
    known = dataclasses.replace(small, statistics=summarize([window.scans.batched()], small.grid))
    said: list[str] = []
    *_, usual = feed(PredictionStream(known, ANGLES, steps=STEPS, warn=said.append), LOG.stamps[:STEPS])
    assert (usual.outside_training, said) == ((), [])
    ranges = np.where(np.arange(91) % 2, LOG.ranges, np.nan)
    *_, found = feed(PredictionStream(known, ANGLES, steps=STEPS, warn=said.append), LOG.stamps[:STEPS], ranges)
    assert "valid_share" in found.outside_training
    assert found.statistics["valid_share"] == pytest.approx(45 / 91)
    assert "outside of the training: share of the readings that are valid" in said


def test_times_that_are_not_seconds_are_the_reason(small):
    stream = PredictionStream(small, ANGLES, steps=STEPS)
    feed(stream, 1000 * LOG.stamps[:STEPS])
    assert stream.reason == "a scan every 1e+02 s, the steps of a window take 0.1 s: are these times in seconds?"


def test_a_map_has_the_newest_hits_in_the_frame_of_the_poses(small):
    *_, found = feed(PredictionStream(small, ANGLES, steps=STEPS), LOG.stamps[:STEPS])
    x, y, heading = LOG.poses[STEPS - 1]
    ranges, ways = LOG.ranges[STEPS - 1], heading + ANGLES
    points = np.stack([x + ranges * np.cos(ways), y + ranges * np.sin(ways)], axis=-1)
    assert found.hits == pytest.approx(points[np.isfinite(ranges)], abs=1e-4)


def test_a_stream_keeps_the_scans_of_a_window_only(small):
    for rate in (10, 40, 1000):
        stream = PredictionStream(small, ANGLES, center=(25, 25), steps=STEPS)
        lengths = []
        for number in range(600):
            stream._take(LOG.ranges[0], LOG.poses[0], number / rate)
            lengths.append(len(stream._kept))
        assert max(lengths) <= 2 * STEPS + EXTRA


def test_what_the_caller_changes_later_does_not_change_the_maps(small):
    stream, expected = (PredictionStream(small, ANGLES, steps=STEPS) for _ in range(2))
    ranges, pose = np.empty_like(LOG.ranges[0]), np.empty(3)
    for number in range(15):
        ranges[:], pose[:] = LOG.ranges[number], LOG.poses[number]
        found = stream.update(ranges, pose, LOG.stamps[number])
        ranges[:], pose[:] = 1, 25
    assert np.array_equal(found.free, feed(expected, LOG.stamps[:15])[-1].free)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ranges": np.ones(7)}, r"ranges: expected the shape \(91,\), got \(7,\)"),
        ({"ranges": np.ones(91, bool)}, r"ranges \[m\]: expected floating-point numbers, got bool"),
        ({"ranges": np.full(91, 3)}, r"ranges \[m\]: expected floating-point numbers, got int64"),
        ({"ranges": np.full(91, 3).astype("m8[s]")}, r"expected floating-point numbers, got timedelta64\[s\]"),
        ({"ranges": np.full(91, "3.0")}, "expected floating-point numbers, got <U3"),
        ({"ranges": np.full(91, 3 + 0j)}, "expected floating-point numbers, got complex128"),
        ({"pose": np.array([True, False, True])}, "pose: expected real numbers, got bool"),
        ({"pose": np.ma.array([1.0, 2.0, 3.0], mask=[0, 1, 0])}, "pose: expected a plain array .*, got a masked one"),
        ({"pose": np.ones(2)}, r"pose: expected the shape \(3,\), got \(2,\)"),
        ({"pose": [1e17, 25.0, 0.0]}, r"pose: expected a finite one within 1e\+07 m"),
        ({"ranges": np.full(91, np.nan)}, "no valid reading"),
        ({"ranges": np.full(91, -1.0)}, "no valid reading"),
        ({"ranges": 1000 * LOG.ranges[15]}, "expected meters, inf for a miss, and most of these are beyond 300"),
        ({"pose": np.array([0, np.nan, 0])}, "pose: expected a finite one"),
        ({"pose": np.array([25, 25, 90.0])}, "headings look like degrees, the largest is 90: expected radians"),
        ({"stamp": float("nan")}, "expected finite seconds, got nan"),
        ({"stamp": "1.5"}, "time: expected real numbers, got <U3"),
        ({"stamp": 1.7e18}, r"time: expected seconds, not ms, us or ns, got 1.7e\+18: float64 resolves 2.6e\+02 there"),
        ({"stamp": 1.7e15}, "expected seconds, not ms, us or ns"),
        ({"stamp": 1.7e12}, "expected seconds, not ms, us or ns"),
    ],
)
def test_a_scan_that_cannot_be_is_refused_and_left_out(small, change, message):
    stream, undisturbed = (PredictionStream(small, ANGLES, steps=STEPS) for _ in range(2))
    feed(stream, np.arange(0, 1.45, 0.1))
    scan = {"ranges": LOG.ranges[15], "pose": LOG.poses[15], "stamp": 1.5}
    with pytest.raises(ValueError, match=message):
        stream.update(**scan | change)
    assert np.array_equal(stream.update(**scan).free, feed(undisturbed, np.arange(0, 1.55, 0.1))[-1].free)


@pytest.mark.parametrize("origin", [None, "ab", (1.0,), (np.nan, 0.0), (True, False)])
def test_a_map_has_an_origin(small, origin):
    window = Scans(LOG.ranges[:STEPS], ANGLES, LOG.poses[:STEPS])
    with pytest.raises(ValueError, match="origin"):
        predict_map(small, window, origin, 1.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"center": "start"}, "center: expected robot"),
        ({"center": (1,)}, r"center=\(1,\): must be robot"),
        ({"center": (True, 1)}, r"center=\(True, 1\): must be robot"),
        ({"center": None}, "center: must be robot"),
        ({"angles": np.linspace(-45, 45, 91)}, "angles are beyond a full turn: expected radians"),
        ({"angles": np.linspace(-2 * np.pi, 2 * np.pi, 721)}, "355 of 721 angles are more than a turn from the first"),
        ({"steps": 9}, "steps: expected at least 10, one for each part of the encoding, got 9"),
        ({"steps": 50.5}, "steps=50.5: must be a valid integer"),
        ({"steps": True}, "steps=True: must be a number"),
        ({"step_s": 0.0}, "step_s=0.0: must be greater than or equal to 0.001"),
        ({"step_s": float("inf")}, "step_s=inf: must be"),
    ],
)
def test_impossible_settings_are_refused_at_once(small, options, message):
    series = dataclasses.replace(small, encoding=create_encoding("series10", {"frames": 10, "range_max_m": 30.0}))
    with pytest.raises(ValueError, match=message):
        PredictionStream(series, **{"angles": ANGLES} | options)


def test_the_last_beam_of_a_full_turn_is_left_out_as_in_a_log(small, tmp_path):
    """A lidar of 360 degrees with a beam at both ends, whose two readings differ."""
    angles, poses, stamps = np.linspace(-np.pi, np.pi, 361), LOG.poses[:STEPS], 0.1 * np.arange(STEPS)
    ranges = np.random.default_rng(0).uniform(2, 12, (STEPS, 361)).astype(np.float32)
    ranges[:, 0] = np.nan
    path = npz(tmp_path / "full.npz", ranges=ranges, angles=angles, poses=poses, stamps=stamps)
    *_, found = feed(PredictionStream(small, angles, center=(25.0, 25.0), steps=STEPS), stamps, ranges)
    (window,) = windows(read(path), (25.0, 25.0)).values()
    assert window.scans.ranges.shape[-1] == 360
    assert np.array_equal(found.free, small.predict(window.scans)[0])


def test_a_window_of_reversed_beams_or_another_byte_order_is_predicted(predictor):
    """As of a lidar that is mounted upside down, whose arrays are views with negative strides."""
    ranges, poses = LOG.ranges[:STEPS], LOG.poses[:STEPS]
    free = predictor.predict(Scans(ranges, ANGLES, poses))
    assert np.array_equal(predictor.predict(Scans(ranges[:, ::-1], ANGLES[::-1], poses)), free)
    assert np.array_equal(predictor.predict(Scans(ranges.astype(">f4"), ANGLES.astype(">f8"), poses)), free)


def test_a_stream_may_be_used_by_several_threads(small):
    stream, failures = PredictionStream(small, ANGLES, steps=30), []

    def update(first: int) -> None:
        try:
            for number in range(first, 30, 3):
                stream.update(LOG.ranges[number], LOG.poses[number], LOG.stamps[number])
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


def of_beams(beams: slice) -> np.ndarray:
    """Return scans in which only some beams have a reading."""
    ranges = np.full_like(LOG.ranges[:STEPS], np.nan)
    ranges[:, beams] = 4.0
    return ranges


def test_pixels_that_no_reading_supports_are_unknown(small):
    """Beams of 4 m ahead support the pixels along them, and nothing else."""
    poses = np.tile([25.0, 25.0, 0.0], (STEPS, 1))
    *_, predicted = feed(
        PredictionStream(small, ANGLES, center=(25.0, 25.0), steps=STEPS), None, of_beams(slice(40, 51)), poses
    )
    x, y = (Grid(32, 50.0).centers() - 25.0).T
    is_supported = ~predicted.unknown.ravel()
    assert is_supported.any()
    assert (x[is_supported] > -1.6).all()
    assert (np.hypot(x, y)[is_supported] < 6).all()


def test_an_update_in_a_signal_handler_is_refused_and_changes_nothing(small, monkeypatch):
    """It would wait for itself; between two updates it is one more."""
    stream, undisturbed = (PredictionStream(small, ANGLES, steps=STEPS) for _ in range(2))
    take, scan = stream._take, (LOG.ranges[0], LOG.poses[0], 99.0)

    def interrupted(*values):
        with pytest.raises(ValueError, match="update runs in this thread already"):
            stream.update(*scan)
        return take(*values)

    monkeypatch.setattr(stream, "_take", interrupted)
    found = feed(stream, np.arange(0, 1.45, 0.1))[-1]
    assert np.array_equal(found.free, feed(undisturbed, np.arange(0, 1.45, 0.1))[-1].free)


def test_a_child_process_goes_on_where_its_parent_was(small):
    stream = PredictionStream(small, ANGLES, steps=STEPS)
    assert feed(stream, np.arange(0, 1.05, 0.1))[-1] is not None
    child = os.fork()
    if not child:
        signal.alarm(20)
        os._exit(0 if stream.update(LOG.ranges[11], LOG.poses[11], 1.1) else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_scans_are_taken_without_predicting_and_the_map_is_that_of_all_of_them(small):
    stream, other = (PredictionStream(small, ANGLES, steps=STEPS) for _ in range(2))
    assert other.predict() is None
    *_, expected = feed(stream, LOG.stamps[:20])
    for scan in zip(LOG.ranges[:20], LOG.poses[:20], LOG.stamps[:20], strict=True):
        assert other.add(*scan) is None
    assert np.array_equal(other.predict().free, expected.free)
    other.add(LOG.ranges[20], LOG.poses[20], LOG.stamps[19])
    assert "not later" in other.reason  # and is no reason against the map of the scan before
    assert np.array_equal(other.predict().free, expected.free)


def test_a_name_is_no_predictor_and_none_is_no_map():
    with pytest.raises(InputError, match="expected that of load_predictor, got 'rooms'"):
        PredictionStream("rooms", ANGLES)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="expected a map of a stream, got None"):
        draw_map(None)  # type: ignore[arg-type]


def test_a_fast_lidar_has_a_map_at_any_time(small):
    """Of scans that arrive more often than steps, some are left out; the map is that of the last one kept."""
    stream = PredictionStream(small, ANGLES, steps=STEPS)
    for number in range(120):
        stream.add(LOG.ranges[number // 4], LOG.poses[number // 4], number / 40)
        if number % 7 == 0 and number > 60:
            assert stream.predict() is not None


def test_a_stream_is_copied_and_pickled_with_its_scans():
    stream = PredictionStream(load_predictor("rooms"), LOG.angles, steps=STEPS)
    feed(stream, LOG.stamps[:15])
    copies = [copy.copy, copy.deepcopy, lambda stream: pickle.loads(pickle.dumps(stream))]  # noqa: S301
    expected, *found = (
        one.update(LOG.ranges[15], LOG.poses[15], LOG.stamps[15])
        for one in (*(make(stream) for make in reversed(copies)), stream)
    )
    assert all(np.array_equal(one.free, expected.free) for one in found)


def test_objects_are_described_in_a_line(small):
    stream = PredictionStream(small, ANGLES, steps=STEPS)
    *_, predicted = feed(stream, LOG.stamps[:STEPS])
    of_predictor = "Predictor(projection, 100 steps of 0.1 s, maps of 32 px of 50 m)"
    assert repr(stream) == f"PredictionStream({of_predictor}, 91 beams, 10 scans)"
    x, y = LOG.poses[STEPS - 1, :2] - 25
    assert repr(predicted) == f"StreamMap(32 x 32 px of 1.56 m from ({x:.2f}, {y:.2f}) at 0.90 s)"


@pytest.mark.parametrize("stamp", [np.float64(3), np.int64(3), np.array(3.0), np.longdouble(3)])
def test_numbers_of_numpy_are_times_and_truth_values_are_none(small, stamp):
    stream = PredictionStream(small, ANGLES, steps=np.int64(STEPS), step_s=np.float32(0.1))
    stream.add(LOG.ranges[0].astype(np.longdouble), LOG.poses[0].astype(np.float32), stamp)
    assert stream._kept[0][0] == 3.0
    for wrong in (True, "3", np.timedelta64(3, "s"), 3 + 0j, [3.0]):
        with pytest.raises(InputError, match="time: expected"):
            stream.add(LOG.ranges[0], LOG.poses[0], wrong)
