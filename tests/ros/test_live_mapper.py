"""Messages as they arrive: the maps are those of the batch, whatever the order of scans and poses."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from conftest import ROOT
from messages import Ros

from repro.learning.networks.trained import TorchNetwork
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.predictor import Predictor
from repro.prediction.moving import MOVERS
from repro.prediction.stream_map import StreamMap, predict_map
from repro.prediction.windows import cut
from repro.ros.live_mapper import MAX_WAITING, LiveMapper

ROS = Ros(2)
STEPS, STEP_S, START_S = 20, 0.1, 1000
EXAMPLE = np.load(ROOT / "examples" / "rooms.npz")
ANGLES = EXAMPLE["angles"]
POSES = EXAMPLE["poses"].astype(float)
MOUNT_M = 0.2


def predictor_of(encoding) -> Predictor:
    """Return a predictor with a small network, not trained, of which each pixel depends on many of the input."""
    torch.manual_seed(0)
    return Predictor(TorchNetwork(torch.nn.Conv2d(encoding.channels, 1, 9, padding=4)), encoding, Grid(32, 50.0))


PREDICTOR = predictor_of(Projection())


def time_of(step: float) -> float:
    return START_S + STEP_S * step


def scan(step: int, **changes):
    return ROS.scan(time_of(step), EXAMPLE["angles"], **{"ranges": EXAMPLE["ranges"][step]} | changes)


def transform(step: float, parent: str, child: str, pose, rotation=None):
    return ROS.transform(time_of(step), parent, child, pose, rotation)


def base(step: float):
    """The transform of the robot at a step, to which the lidar is mounted."""
    x, y, heading = (np.interp(step, np.arange(len(POSES)), column) for column in POSES.T)
    pose = (x - MOUNT_M * math.cos(heading), y - MOUNT_M * math.sin(heading), heading)
    return transform(step, "odom", "base_link", pose)


def mount(rotation=None):
    return transform(0, "base_link", "laser", (MOUNT_M, 0.0, 0.0), rotation)


class Robot:
    """A mapper with what it published and warned of."""

    def __init__(self, predictor=PREDICTOR, *, is_mounted: bool = True, **options) -> None:
        self.maps, self.warnings = [], []
        settings = WindowSettings(**{"center": (25.0, 25.0), "steps": STEPS, "step_s": STEP_S} | options)
        self.mapper = LiveMapper(predictor, lambda *sent: self.maps.append(sent), self.warnings.append, settings)
        if is_mounted:
            self.mapper.add_transforms(mount(), is_static=True)

    def drive(self, count: int, changed=None, **changes) -> "Robot":
        """Take the odometry of the lidar and its scans, of which some are others."""
        for step in range(count):
            self.mapper.add_odometry(ROS.odometry(time_of(step), POSES[step], "laser"))
            self.mapper.add_scan((changed or {}).get(step) or scan(step, **changes))
        return self


def driven(count: int, changed=None, predictor=PREDICTOR, **changes) -> Robot:
    return Robot(predictor, is_mounted=False).drive(count, changed, **changes)


@cache
def usual(count: int) -> list[StreamMap]:
    return expected(PREDICTOR, count)


def expected(predictor, count: int, center=(25.0, 25.0), ranges=EXAMPLE["ranges"]) -> list[StreamMap]:
    log = ScanLog(time_of(np.arange(count)), ranges[:count].astype(np.float32), EXAMPLE["angles"], POSES[:count])
    windows = cut(log, WindowSettings(center, STEPS, STEP_S), STEP_S, 50.0)
    return [predict_map(predictor, window.scans, window.origin, window.stamp) for window in windows]


def check(robot: Robot, count: int, warnings=(), center=(25.0, 25.0)) -> None:
    """Check the maps of the first scans, and that there are no others."""
    assert robot.warnings == list(warnings)
    maps = expected(robot.mapper.predictor, count, center)
    assert len(robot.maps) == len(maps)
    for number, ((sent, frame, predicted), batch) in enumerate(zip(robot.maps, maps, strict=True)):
        assert (sent.stamp, frame) == (ROS.header(time_of(STEPS - 1 + number), "").stamp, "odom")
        assert predicted.free == pytest.approx(batch.free, abs=1e-5)
        assert np.array_equal(predicted.unknown, batch.unknown)


@pytest.mark.parametrize("lag", [1, 40])
@pytest.mark.parametrize("center", ["robot", (25.0, 25.0)])
def test_maps_with_transforms_are_those_of_the_batch(lag, center):
    """Poses arrive after their scans, the mounting of the lidar even later."""
    robot = Robot(center=center, is_mounted=False)
    robot.mapper.add_transforms(base(-1))
    for step in range(40 + lag):
        if step < 40:
            robot.mapper.add_scan(scan(step))
        if step == 4:
            robot.mapper.add_transforms(mount(), is_static=True)
        if step >= lag:
            robot.mapper.add_transforms(base(step - lag))
    check(robot, 40, center=center)


def test_maps_with_odometry_are_those_of_the_batch():
    check(driven(30), 30)


def test_scans_do_not_wait_for_odometry_that_is_silent_from_the_beginning():
    """A robot that stands, with two equal poses at its start."""
    robot = Robot(is_mounted=False)
    for step in (0, 1):
        robot.mapper.add_transforms(transform(step, "odom", "laser", POSES[0]))
    for step in range(70):
        robot.mapper.add_scan(scan(step))
    assert robot.warnings == []
    for step in range(70, 180):
        robot.mapper.add_scan(scan(step))
    assert len(robot.maps) > 180 - STEPS - 100 - 2, "all but the newest ten seconds"


@pytest.mark.parametrize("ahead", [10, 1e5])
def test_a_localizer_may_stamp_its_poses_ahead_of_time(ahead):
    """A localizer stamps the pose of the odometry in the map into the future; an unrelated frame may be far ahead."""
    robot = Robot()
    for step in range(15):
        robot.mapper.add_transforms(transform(step, "map", "odom", (0.0, 0.0, 0.0)))
    for step in range(42):
        if step < 40:
            robot.mapper.add_scan(scan(step))
        robot.mapper.add_transforms(transform(step + min(ahead, 15), "map", "odom", (0.0, 0.0, 0.0)))
        robot.mapper.add_transforms(transform(step + ahead, "elsewhere", "unrelated", (0.0, 0.0, 0.0)))
        if step >= 2:
            robot.mapper.add_transforms(base(step - 2))
    assert robot.warnings == []
    assert [frame for _, frame, _ in robot.maps] == ["map"] * (40 - STEPS + 1)


def test_a_lidar_that_nobody_places_has_no_maps_and_a_reason():
    robot = Robot(is_mounted=False)
    for step in range(120):
        robot.mapper.add_transforms(transform(step, "odom", "base_link", POSES[step]))
        robot.mapper.add_scan(scan(step))
    assert not robot.maps
    assert robot.warnings[0].startswith("a scan is skipped: it is without a pose: no transform of laser")


def test_misses_free_up_to_the_maximum_range():
    predictor = predictor_of(create_encoding("series10", {"frames": 10}))
    robot = driven(45, predictor=predictor, range_max=12.0)
    note = "misses show free space up to the maximum range of the lidar, 12 m; the network was trained with 30 m"
    beyond, *others = robot.warnings
    assert "of the readings are beyond the maximum range, 12 m" in beyond
    assert others == [note]
    ranges = np.where(EXAMPLE["ranges"] < 12, EXAMPLE["ranges"], np.inf)
    free = robot.maps[-1][2].free
    assert free == pytest.approx(expected(predictor.with_range(12.0), 45, ranges=ranges)[-1].free, abs=1e-5)
    assert not np.allclose(free, expected(predictor, 45, ranges=ranges)[-1].free, atol=1e-3)


@pytest.mark.parametrize("odd", [0, 7, 33])
def test_a_scan_with_another_maximum_range_is_left_out_and_the_window_goes_on(odd):
    robot = driven(45, {odd: scan(odd, range_max=0.001)})
    reason = "with another maximum range, which range_max_m replaces"
    assert robot.warnings == [f"a scan is skipped: it is {reason}"]
    assert len(robot.maps) == 45 - STEPS + 1 - (odd in (0, 33))
    assert robot.maps[10][2].unknown.mean() == pytest.approx(usual(45)[10].unknown.mean(), rel=0.01)


def test_a_driver_that_states_the_largest_reading_has_all_maps():
    finite = np.where(EXAMPLE["ranges"] < 30, EXAMPLE["ranges"], 0)
    robot = driven(45, {step: scan(step, range_max=float(finite[step].max())) for step in range(45)})
    assert [text[:27] for text in robot.warnings] == ["the maximum range of the sc"]
    for (_, _, predicted), batch in zip(robot.maps, usual(45), strict=True):
        assert predicted.free == pytest.approx(batch.free, abs=1e-5)


def test_scans_that_cannot_be_used_are_skipped_with_their_reason():
    wrong = {
        0: (scan(0, ranges=np.ones(99, np.float32)), "with another number of beams"),
        1: (scan(1, range_max=0.0), "without a valid maximum range"),
        3: (scan(3, ranges=np.ones(7, np.float32)), "with another number of beams"),
        5: (scan(4), "not later"),
        7: (scan(7, ranges=np.full(91, np.nan, np.float32)), "without a valid reading"),
        9: (scan(9, angle_min=-1.0), "with other beam angles"),
        13: (scan(13, range_max=float("nan")), "without a valid maximum range"),
        15: (scan(15, range_max=-1.0), "without a valid maximum range"),
    }
    robot = driven(30, {step: message for step, (message, _) in wrong.items()})
    assert len(robot.warnings) == len(wrong)
    assert all(any(reason in warning for warning in robot.warnings) for _, reason in wrong.values())
    assert len(robot.maps) == 30 - 2 - STEPS + 1


def test_an_empty_place_has_maps_and_what_moves_is_named_once():
    empty = {step: scan(step, ranges=np.full(91, np.inf, np.float32)) for step in range(40)}
    robot = driven(40, empty)
    assert [text for text in robot.warnings if "misses" not in text] == []
    assert len(robot.maps) == 40 - STEPS + 1
    ranges = {step: np.full(91, 20.0, np.float32) for step in range(22)}
    for step, values in ranges.items():
        values[4 * step : 4 * step + 6] = 8.0  # of someone who walks across the view
    robot = Robot(replace(PREDICTOR, grid=Grid(128, 50.0)), is_mounted=False)
    for step, values in ranges.items():
        robot.mapper.add_odometry(ROS.odometry(time_of(step), POSES[0], "laser"))
        robot.mapper.add_scan(scan(step, ranges=values))
    assert robot.warnings == [MOVERS]
    assert robot.maps[-1][2].moving.any()


def test_scans_without_poses_do_not_pile_up():
    robot = Robot(is_mounted=False)
    for _ in range(MAX_WAITING + 5):
        robot.mapper.add_scan(scan(0))
    assert len(robot.mapper.waiting) == MAX_WAITING
    assert robot.warnings[-1].startswith("a scan is skipped: 200 others wait, no transform of laser")
    assert len(robot.warnings) == 5


def test_the_window_begins_again_when_the_poses_are_in_another_frame():
    """As when a localization starts after the node."""
    robot = Robot()
    robot.mapper.add_transforms(base(-1))
    for step in range(45):
        if step >= 15:
            robot.mapper.add_transforms(transform(step, "map", "odom", (5.0, 0.0, 0.0)))
        robot.mapper.add_scan(scan(step))
        robot.mapper.add_transforms(base(step))
    assert robot.warnings == ["the poses are in the frame map now, not in odom: the window begins again"]
    assert [frame for _, frame, _ in robot.maps] == ["map"] * (45 - 15 - STEPS + 1)


def test_a_scan_that_waits_when_the_clock_is_set_back_ends_the_window_before():
    robot = Robot(is_mounted=False)
    for step in range(31):
        robot.mapper.add_odometry(ROS.odometry(time_of(step), POSES[step], "laser"))
        robot.mapper.add_scan(scan(step))
    robot.mapper.add_scan(ROS.scan(time_of(30.9), EXAMPLE["angles"], EXAMPLE["ranges"][31]))  # waits for a later pose
    assert len(robot.maps) == 31 - STEPS + 1
    for step in (0, 1):
        robot.mapper.add_scan(ROS.scan(time_of(step - 900), EXAMPLE["angles"], EXAMPLE["ranges"][step]))
    assert len(robot.maps) == 32 - STEPS + 1


def test_maps_go_on_after_the_clock_was_set_back():
    """As with a bag that is played again; the mounting of the lidar is sent once."""
    robot = Robot()
    for _ in range(2):
        robot.mapper.add_transforms(base(-1))
        for step in range(45):
            robot.mapper.add_scan(scan(step))
            robot.mapper.add_transforms(base(step))
    first, second = robot.warnings
    assert first == f"a scan is skipped: its time, {START_S}.00 s, is earlier by more than a window"
    assert second == "the clock was set back: scans of later times are skipped"
    maps = expected(PREDICTOR, 45)
    for (_, _, predicted), batch in zip(robot.maps, maps + maps[1:], strict=True):
        assert predicted.free == pytest.approx(batch.free, abs=1e-5)


@pytest.mark.parametrize("wrong", [-9000, 55, 200])  # steps
@pytest.mark.parametrize("kind", ["scan", "pose"])
def test_maps_go_on_after_one_wrong_time(kind, wrong):
    robot = Robot()
    robot.mapper.add_transforms(base(-1))
    count, late = 110, 40
    for step in range(count):
        robot.mapper.add_scan(scan(step))
        if step == late:
            message = scan(step) if kind == "scan" else base(step)
            where = message if kind == "scan" else message.transforms[0]
            where.header = ROS.header(time_of(wrong), where.header.frame_id)
            (robot.mapper.add_scan if kind == "scan" else robot.mapper.add_transforms)(message)
        robot.mapper.add_transforms(base(step))
    maps = usual(count)
    assert len(robot.maps) >= len(maps) - (2 if kind == "scan" else 2 * STEPS)
    for (sent, _, predicted), batch in zip(robot.maps[-20:], maps[-20:], strict=True):
        assert sent.stamp.sec >= START_S
        assert predicted.free == pytest.approx(batch.free, abs=1e-5)


def test_the_maximum_range_of_a_driver_may_be_replaced():
    check(Robot(range_max_m=30.0, is_mounted=False).drive(30, range_max=0.0), 30)
