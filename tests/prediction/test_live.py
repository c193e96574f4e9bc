"""Messages as they arrive: the maps are those of the batch, whatever the order of scans and poses."""

import copy
import math

import numpy as np
import pytest
import torch
from conftest import ROOT
from rosbags.typesys import Stores, get_typestore

from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.create import create_network
from repro.networks.model import paper_model
from repro.networks.predictor import Predictor
from repro.prediction.live import MAX_OTHERS, MAX_WAITING, LiveMapper
from repro.prediction.logs import ScanLog
from repro.prediction.stream import StreamMap, predict_map
from repro.prediction.times import WindowSettings
from repro.prediction.windows import cut

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = {  # with the names that they have in ROS
    name.rpartition("/")[2]: type(name.rpartition("/")[2], (kind,), {}) for name, kind in STORE.types.items()
}
STEPS, STEP_S, START_S = 20, 0.1, 1000
EXAMPLE = np.load(ROOT / "examples" / "rooms.npz")
POSES = EXAMPLE["poses"].astype(float)
MOUNT_M = 0.2


@pytest.fixture(scope="module")
def predictor():
    torch.manual_seed(0)
    return Predictor(create_network(paper_model("unet")).eval(), Projection(), Grid(32, 50.0))


def header(time: float, frame: str):
    nanoseconds = round((START_S + time) * 1e9)
    return TYPES["Header"](TYPES["Time"](*divmod(nanoseconds, 10**9)), frame)


def scan(step: int, **changes):
    angles = EXAMPLE["angles"]
    values = {
        "angle_min": float(angles[0]),
        "angle_increment": float((angles[-1] - angles[0]) / (len(angles) - 1)),
        "time_increment": 0.0,
        "scan_time": STEP_S,
        "range_min": 0.0,
        "range_max": 30.0,
        "ranges": EXAMPLE["ranges"][step].astype(np.float32),
        "intensities": np.zeros(0, np.float32),
    }
    values |= changes
    values.setdefault("angle_max", values["angle_min"] + values["angle_increment"] * (len(values["ranges"]) - 1))
    return TYPES["LaserScan"](header(STEP_S * step, "laser"), **values)


def rotation(heading: float):
    return TYPES["Quaternion"](0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))


def transform(step: float, parent: str, child: str, pose):
    moved = TYPES["Transform"](TYPES["Vector3"](float(pose[0]), float(pose[1]), 0.0), rotation(pose[2]))
    return TYPES["TFMessage"]([TYPES["TransformStamped"](header(STEP_S * step, parent), child, moved)])


def base(step: float):
    """The transform of the robot at a step, to which the lidar is mounted."""
    x, y, heading = (np.interp(step, np.arange(len(POSES)), column) for column in POSES.T)
    pose = (x - MOUNT_M * math.cos(heading), y - MOUNT_M * math.sin(heading), heading)
    return transform(step, "odom", "base_link", pose)


def odometry(step: int):
    x, y, heading = POSES[step]
    pose = TYPES["Pose"](TYPES["Point"](x, y, 0.0), rotation(heading))
    zero = TYPES["Vector3"](0.0, 0.0, 0.0)
    with_covariance = TYPES["PoseWithCovariance"](pose, np.zeros(36))
    twist = TYPES["TwistWithCovariance"](TYPES["Twist"](zero, zero), np.zeros(36))
    return TYPES["Odometry"](header(STEP_S * step, "odom"), "laser", with_covariance, twist)


MOUNT = transform(0, "base_link", "laser", (MOUNT_M, 0.0, 0.0))


class Robot:
    """A mapper with what it published and warned of."""

    def __init__(self, predictor, **options) -> None:
        self.maps, self.warnings = [], []
        settings = WindowSettings(**{"center": (25.0, 25.0), "steps": STEPS, "step_s": STEP_S} | options)
        self.mapper = LiveMapper(predictor, lambda *sent: self.maps.append(sent), self.warnings.append, settings)


def expected(predictor, count: int, center=(25.0, 25.0), ranges=EXAMPLE["ranges"]) -> list[StreamMap]:
    stamps = START_S + STEP_S * np.arange(count)
    log = ScanLog(stamps, ranges[:count].astype(np.float32), EXAMPLE["angles"], POSES[:count])
    windows = cut(log, WindowSettings(center, STEPS, STEP_S), STEP_S, 50.0)
    return [predict_map(predictor, window.scans, window.origin, window.stamp) for window in windows]


def check(robot: Robot, maps: list[StreamMap]) -> None:
    assert robot.warnings == []
    assert len(robot.maps) == len(maps)
    for number, ((sent, frame, predicted), batch) in enumerate(zip(robot.maps, maps, strict=True)):
        assert (sent.stamp, frame) == (header(STEP_S * (STEPS - 1 + number), "").stamp, "odom")
        assert predicted.free == pytest.approx(batch.free, abs=1e-5)
        assert np.array_equal(predicted.unknown, batch.unknown)


@pytest.mark.parametrize("lag", [1, 3, 8])
@pytest.mark.parametrize("center", ["robot", (25.0, 25.0)])
def test_maps_with_transforms_are_those_of_the_batch(predictor, lag, center):
    """Poses arrive after their scans, the mounting of the lidar even later."""
    robot = Robot(predictor, center=center)
    robot.mapper.add_transforms(base(-1))
    for step in range(40 + lag):
        if step < 40:
            robot.mapper.add_scan(scan(step))
        if step == 4:
            robot.mapper.add_transforms(MOUNT, is_static=True)
        if step >= lag:
            robot.mapper.add_transforms(base(step - lag))
    check(robot, expected(predictor, 40, center))


def test_scans_wait_for_transforms_that_lag_more_and_more(predictor):
    """As on a busy computer: up to 8 s behind the scans, and then in time again."""
    robot = Robot(predictor)
    robot.mapper.add_transforms(MOUNT, is_static=True)
    robot.mapper.add_transforms(base(-1))
    sent, count = 0, 200
    for step in range(count):
        robot.mapper.add_scan(scan(step))
        while sent <= step - min(step // 2, 80) or sent <= (step - 100 if step < 150 else step):
            robot.mapper.add_transforms(base(sent))
            sent += 1
    check(robot, expected(predictor, count))


def test_scans_do_not_wait_for_odometry_that_is_silent_from_the_beginning(predictor):
    """A robot that stands, with two equal poses at its start."""
    robot = Robot(predictor)
    for step in (0, 1):
        robot.mapper.add_transforms(transform(step, "odom", "laser", POSES[0]))
    for step in range(70):
        robot.mapper.add_scan(scan(step))
    assert robot.warnings == []
    assert len(robot.maps) > 70 - STEPS - 30 - 1, "all but the newest three seconds"


@pytest.mark.parametrize("ahead", [10, 15, 1e5])
def test_a_localizer_may_stamp_its_poses_ahead_of_time(predictor, ahead):
    """A localizer stamps the pose of the odometry in the map into the future; an unrelated frame may be far ahead."""
    robot = Robot(predictor)
    robot.mapper.add_transforms(MOUNT, is_static=True)
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


def test_a_lidar_upside_down_may_have_no_pose_for_a_while(predictor):
    turned = TYPES["Quaternion"](1.0, 0.0, 0.0, 0.0)  # half a turn about x
    mount = TYPES["Transform"](TYPES["Vector3"](MOUNT_M, 0.0, 0.0), turned)
    mount = TYPES["TFMessage"]([TYPES["TransformStamped"](header(0, "base_link"), "laser", mount)])
    robot = Robot(predictor)
    robot.mapper.add_transforms(mount, is_static=True)
    lost = range(40, 40 + 2 * MAX_OTHERS)
    for step in range(60):
        if step not in lost:
            robot.mapper.add_transforms(base(step))
        robot.mapper.add_scan(scan(step, ranges=EXAMPLE["ranges"][step, ::-1].astype(np.float32)))
    assert not any("the beams of the lidar have changed" in each for each in robot.warnings)


def test_maps_with_odometry_are_those_of_the_batch(predictor):
    robot = Robot(predictor)
    for step in range(30):
        robot.mapper.add_odometry(odometry(step))
        robot.mapper.add_scan(scan(step))
    check(robot, expected(predictor, 30))


def test_a_lidar_that_nobody_places_is_at_the_robot_after_a_second(predictor):
    robot = Robot(predictor)
    for step in range(30):
        robot.mapper.add_transforms(transform(step, "odom", "base_link", POSES[step]))
        robot.mapper.add_scan(scan(step))
    (warning,) = robot.warnings
    assert "no transform of laser" in warning
    robot.warnings.clear()
    check(robot, expected(predictor, 30))


def robot_that_sees_free_space() -> Robot:
    """Return a robot whose network, not trained, takes misses as free up to 30 m."""
    torch.manual_seed(0)
    encoding = create_encoding("series10", {"frames": 10})
    network = create_network(paper_model("unet"), in_channels=encoding.channels).eval()
    return Robot(Predictor(network, encoding, Grid(32, 50.0)))


def test_misses_of_a_lidar_that_reaches_less_far_free_its_own_range():
    robot = robot_that_sees_free_space()
    for step in range(25):
        robot.mapper.add_odometry(odometry(step))
        robot.mapper.add_scan(scan(step, range_max=12.0))
    message = "misses show free space up to the maximum range of the lidar, 12 m; the network was trained with 30 m"
    assert robot.warnings == [message]
    robot.warnings.clear()
    ranges = np.where(EXAMPLE["ranges"] < 12, EXAMPLE["ranges"], np.inf)
    maps = expected(robot.mapper.predictor.with_range(12.0), 25, ranges=ranges)
    check(robot, maps)
    as_far = expected(robot.mapper.predictor, 25, ranges=ranges)
    assert not np.allclose(maps[-1].free, as_far[-1].free, atol=1e-3)


def test_scans_that_cannot_be_used_are_skipped_with_their_reason(predictor):
    robot = Robot(predictor)
    wrong = {
        3: scan(3, ranges=np.ones(7, np.float32)),
        5: scan(4),
        7: scan(7, ranges=np.full(91, np.nan, np.float32)),
        9: scan(9, angle_min=-1.0),
        11: scan(11, range_max=0.0),
        13: scan(13, range_max=float("nan")),
        15: scan(15, range_max=-1.0),
    }
    for step in range(30):
        robot.mapper.add_odometry(odometry(step))
        robot.mapper.add_scan(wrong.get(step, scan(step)))
    reasons = ("another number of beams", "not later", "without a valid reading", "other beam angles")
    reasons += ("without a valid maximum range",) * 3
    assert len(robot.warnings) == len(wrong)
    assert all(any(reason in warning for warning in robot.warnings) for reason in reasons)
    assert len(robot.maps) == 30 - STEPS + 1


def test_a_first_scan_without_a_valid_maximum_range_is_skipped(predictor):
    robot = Robot(predictor)
    for step in range(30):
        robot.mapper.add_odometry(odometry(step))
        robot.mapper.add_scan(scan(step, range_max=0.0) if step == 0 else scan(step))
    assert robot.warnings == ["a scan is skipped: it is without a valid maximum range"]
    assert len(robot.maps) == 30 - 1 - STEPS + 1


def test_the_smallest_maximum_range_holds_for_the_misses_of_all_scans():
    """As in a log; a hit of another scan beyond it stays a hit."""
    robot = robot_that_sees_free_space()
    for step in range(25):
        robot.mapper.add_odometry(odometry(step))
        robot.mapper.add_scan(scan(step, range_max=12.0 if step == 20 else 30.0))
    (warning,) = robot.warnings
    assert warning == "the maximum range changes: misses show free space up to the smallest, 12 m"
    ranges = EXAMPLE["ranges"].copy()
    ranges[20][ranges[20] >= 12] = np.inf
    maps = expected(robot.mapper.predictor.with_range(12.0), 25, ranges=ranges)
    assert robot.maps[-1][2].free == pytest.approx(maps[-1].free, abs=1e-5)


def test_an_odd_first_scan_costs_itself_only(predictor):
    robot = Robot(predictor)
    for step in range(30):
        robot.mapper.add_odometry(odometry(step))
        robot.mapper.add_scan(scan(step, ranges=np.ones(99, np.float32)) if step == 0 else scan(step))
    assert robot.warnings == ["a scan is skipped: it is with another number of beams than 91"]
    assert len(robot.maps) == 30 - 1 - STEPS + 1


def test_the_window_begins_again_with_other_beams(predictor):
    robot = Robot(predictor)
    for step in range(40 + MAX_OTHERS + STEPS):
        robot.mapper.add_odometry(odometry(step))
        robot.mapper.add_scan(scan(step, ranges=np.ones(99, np.float32)) if step >= 40 else scan(step))
    *skipped, changed = robot.warnings
    assert skipped == ["a scan is skipped: it is with another number of beams than 91"] * (MAX_OTHERS + 1)
    assert changed == "the beams of the lidar have changed: the window begins again"


def test_scans_without_poses_do_not_pile_up(predictor):
    robot = Robot(predictor)
    for _ in range(MAX_WAITING + 5):
        robot.mapper.add_scan(scan(0))
    assert len(robot.mapper.waiting) == MAX_WAITING
    assert len(robot.warnings) == 5


def test_a_scan_after_a_gap_of_poses_is_skipped(predictor):
    robot = Robot(predictor)
    robot.mapper.add_odometry(odometry(0))
    robot.mapper.add_odometry(odometry(1))
    robot.mapper.add_scan(scan(10))
    robot.mapper.add_odometry(odometry(25))
    assert robot.warnings == [
        "a scan is skipped: it is without a pose: it needs poses of laser in odom before and after 1001.00 s, at most "
        "1 s apart; there are poses from 1000.00 to 1002.50 s"
    ]


def test_a_scan_waits_for_the_poses_of_the_robot(predictor):
    """The mounting of the lidar alone does not place it."""
    robot = Robot(predictor)
    robot.mapper.add_transforms(MOUNT, is_static=True)
    for step in range(5):
        robot.mapper.add_scan(scan(step))
    for step in range(-1, 25):
        robot.mapper.add_transforms(base(step))
        if step >= 5:
            robot.mapper.add_scan(scan(step))
    check(robot, expected(predictor, 25))


def test_the_window_begins_again_when_the_poses_are_in_another_frame(predictor):
    """As when a localization starts after the node."""
    robot = Robot(predictor)
    robot.mapper.add_transforms(MOUNT, is_static=True)
    robot.mapper.add_transforms(base(-1))
    for step in range(45):
        if step >= 15:
            robot.mapper.add_transforms(transform(step, "map", "odom", (5.0, 0.0, 0.0)))
        robot.mapper.add_scan(scan(step))
        robot.mapper.add_transforms(base(step))
    assert robot.warnings == ["the poses are in the frame map now, not in odom: the window begins again"]
    assert len(robot.maps) == 45 - 15 - STEPS + 1
    assert {frame for _, frame, _ in robot.maps} == {"map"}


def test_a_tilted_lidar_is_skipped_with_its_reason(predictor):
    robot = Robot(predictor)
    on_its_side = copy.deepcopy(MOUNT)
    on_its_side.transforms[0].transform.rotation = TYPES["Quaternion"](math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    robot.mapper.add_transforms(on_its_side, is_static=True)
    robot.mapper.add_transforms(base(0))
    robot.mapper.add_scan(scan(0))
    robot.mapper.add_transforms(base(1))
    assert robot.warnings == [
        "laser is tilted by 90 degrees: expected a horizontal lidar, within 30 degrees",
        "a scan is skipped: it is tilted by more than 30 degrees",
    ]


def test_poses_of_a_second_source_are_named_once(predictor):
    robot = Robot(predictor)
    for step in range(3):
        robot.mapper.add_transforms(base(step))
        robot.mapper.add_transforms(transform(step, "odom_combined", "base_link", POSES[step]))
    assert robot.warnings == ["poses of base_link in odom_combined are left out: it has poses in odom"]


def test_maps_go_on_after_the_clock_was_set_back(predictor):
    """As with a bag that is played again; the mounting of the lidar is sent once."""
    robot = Robot(predictor)
    robot.mapper.add_transforms(MOUNT, is_static=True)
    for _ in range(2):
        robot.mapper.add_transforms(base(-1))
        for step in range(45):
            robot.mapper.add_scan(scan(step))
            robot.mapper.add_transforms(base(step))
    assert robot.warnings == ["the clock was set back: the window begins again"]
    maps = expected(predictor, 45)
    assert len(robot.maps) == 2 * len(maps)
    for (_, _, predicted), batch in zip(robot.maps, 2 * maps, strict=True):
        assert predicted.free == pytest.approx(batch.free, abs=1e-5)


@pytest.mark.parametrize("wrong", [-9000, 200, 1_000_000])  # steps
@pytest.mark.parametrize("kind", ["scan", "pose"])
def test_maps_go_on_after_one_wrong_time(predictor, kind, wrong):
    robot = Robot(predictor)
    robot.mapper.add_transforms(MOUNT, is_static=True)
    robot.mapper.add_transforms(base(-1))
    count, late = 140, 60
    for step in range(count):
        robot.mapper.add_scan(scan(step))
        if step == late:
            message = scan(step) if kind == "scan" else base(step)
            where = message if kind == "scan" else message.transforms[0]
            where.header = header(STEP_S * wrong, where.header.frame_id)
            (robot.mapper.add_scan if kind == "scan" else robot.mapper.add_transforms)(message)
        robot.mapper.add_transforms(base(step))
    maps = expected(predictor, count)
    assert len(robot.maps) >= len(maps) - 2 * STEPS
    for (sent, _, predicted), batch in zip(robot.maps[-40:], maps[-40:], strict=True):
        assert sent.stamp.sec >= START_S
        assert predicted.free == pytest.approx(batch.free, abs=1e-5)


@pytest.mark.parametrize("center", [None, "start", "25 25", (25.0,), (25.0, math.nan)])
def test_a_center_that_is_none_is_refused_at_the_start(predictor, center):
    with pytest.raises(ValueError, match="center: expected robot"):
        Robot(predictor, center=center)


def test_the_maximum_range_of_a_driver_may_be_replaced(predictor):
    robot = Robot(predictor, range_max_m=30.0)
    robot.mapper.add_transforms(base(-1))
    robot.mapper.add_transforms(MOUNT, is_static=True)
    for step in range(30):
        robot.mapper.add_scan(scan(step, range_max=0.0))
        robot.mapper.add_transforms(base(step))
    check(robot, expected(predictor, 30))
    with pytest.raises(ValueError, match="range_max_m: expected a positive range"):
        Robot(predictor, range_max_m=-1.0)
