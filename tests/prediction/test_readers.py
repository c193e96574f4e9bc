"""Logs in every format, written by other code than the readers, and files that are no logs."""

import gzip
import math
import os
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from repro.prediction.intake import LogScan
from repro.prediction.logs import ReadOptions, ScanLog, collect
from repro.prediction.readers import read_log
from repro.prediction.times import TimesLost, WindowSettings, parts_of

SCANS, BEAMS = 30, 181
WINDOWS = WindowSettings(steps=10)
COUNTS = "101, 180, 181, 201, 360, 361, 401, 540, 541"  # of readings of FLASER
STAMPS = 100 + 0.1 * np.arange(SCANS)
POSES = np.stack([0.05 * np.arange(SCANS), -0.02 * np.arange(SCANS), 0.03 * np.arange(SCANS)], axis=-1)
RANGES = 2 + np.random.default_rng(0).random((SCANS, BEAMS)).round(2)
RANGES[:, 40] = 81.83  # a miss
SPACING = math.radians(1)


def expect(log: ScanLog, *, atol: float = 1e-6) -> None:
    """Assert that a log is the one above."""
    assert log.stamps == pytest.approx(STAMPS, abs=1e-6)
    assert np.isinf(log.ranges[:, 40]).all()
    hits = np.delete(log.ranges, 40, axis=1)
    assert hits == pytest.approx(np.delete(RANGES, 40, axis=1), abs=1e-5)
    assert log.angles == pytest.approx(np.radians(np.arange(-90, 91)), abs=1e-5)
    assert log.poses == pytest.approx(POSES, abs=atol)
    assert log.skipped == {}


def flaser(number: int, ranges=None) -> str:
    x, y, heading = POSES[number]
    readings = RANGES[number] if ranges is None else ranges
    words = " ".join(f"{value:.2f}" for value in readings)
    pose = f"{x:.6f} {y:.6f} {heading:.6f}"
    return f"FLASER {len(readings)} {words} {pose} {pose} {STAMPS[number]:.6f} robot {number:.3f}"


def robotlaser(number: int) -> str:
    words = " ".join(f"{value:.2f}" for value in RANGES[number])
    x, y, heading = POSES[number]
    pose = f"{x:.6f} {y:.6f} {heading:.6f}"
    return (
        f"ROBOTLASER1 0 {-math.pi / 2:.8f} {math.pi:.8f} {SPACING:.8f} 81.83 0.01 0 {BEAMS} {words} 2 0.5 0.5 "
        f"{pose} {pose} 0.0 0.0 0.3 0.3 1000000 {STAMPS[number]:.6f} robot {number:.3f}"
    )


def write_lines(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(["# CARMEN Logfile", "PARAM robot_front_laser_max 81.83", *lines, ""]))
    return path


@pytest.mark.parametrize("line", [flaser, robotlaser])
def test_carmen(line, tmp_path):
    path = write_lines(tmp_path / "log.txt", [line(number) for number in range(SCANS)])
    expect(read_log(path, WINDOWS))
    packed = tmp_path / "any name"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    expect(read_log(packed, WINDOWS))


def test_a_log_that_begins_with_a_byte_order_mark_loses_no_line(tmp_path):
    lines = ["PARAM robot_front_laser_max 81.83", *(flaser(number) for number in range(SCANS))]
    path = tmp_path / "log.txt"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8-sig")
    expect(read_log(path, WINDOWS))


def test_npz(tmp_path):
    angles = np.radians(np.arange(-90, 91))
    np.savez(tmp_path / "a.npz", ranges=RANGES, angles=angles, poses=POSES, stamps=STAMPS, range_max_m=81.83)
    expect(read_log(tmp_path / "a.npz", WINDOWS))
    reverse = {"ranges": RANGES[:, ::-1], "angles": angles[::-1]}
    np.savez(tmp_path / "b.npz", **reverse, poses=POSES, stamps=STAMPS, range_max_m=81.83)
    expect(read_log(tmp_path / "b.npz", WINDOWS))


def bag(
    path: Path, version: int, *, poses: str, storage=StoragePlugin.MCAP, scans: int = SCANS, compression=()
) -> Path:
    """Write a bag with the writers of rosbags; the lidar is 0.2 m in front of the robot where there are transforms."""
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    if version == 1:  # which rosbags does not list for ROS 1
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    types = store.types
    made = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=storage)
    if compression:
        made.set_compression(*compression)
    with made as writer:
        topics: dict[str, object] = {}

        def write(topic: str, kind: str, message: object, stamp: float) -> None:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            serialize = store.serialize_ros1 if version == 1 else store.serialize_cdr
            writer.write(topics[topic], round(stamp * 1e9), serialize(message, kind))

        def header(stamp: float, frame: str) -> object:
            time = types["builtin_interfaces/msg/Time"](int(stamp), round(stamp % 1 * 1e9))
            sequence = (0,) if version == 1 else ()
            return types["std_msgs/msg/Header"](*sequence, time, frame)

        def rotation(heading: float) -> object:
            return types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))

        def transform(stamp: float, parent: str, child: str, pose) -> object:
            moved = types["geometry_msgs/msg/Vector3"](float(pose[0]), float(pose[1]), 0.0)
            of = types["geometry_msgs/msg/Transform"](moved, rotation(pose[2]))
            return types["geometry_msgs/msg/TransformStamped"](header(stamp, parent), child, of)

        tf = "tf2_msgs/msg/TFMessage"
        if poses in ("tf", "both"):
            static = transform(STAMPS[0], "base_link", "laser", (0.2, 0.0, 0.0))
            write("/tf_static", tf, types[tf]([static]), STAMPS[0])
        elif poses == "conflict":
            below = transform(STAMPS[0], "base_footprint", "base_link", (0.0, 0.0, 0.0))
            write("/tf_static", tf, types[tf]([below]), STAMPS[0])
        for step in range(-1, scans + 1):  # poses at other times than the scans, linear in between
            stamp = 100 + 0.1 * step + 0.04
            x, y, heading = (rate * (step + 0.4) for rate in (0.05, -0.02, 0.03))
            if poses in ("tf", "both"):
                x, y = x - 0.2 * math.cos(heading), y - 0.2 * math.sin(heading)
                drift = 5.0 if poses == "both" else 0.0  # of a localization that is to be replaced by odometry
                moving = transform(stamp, "odom", "base_link", (x + drift, y, heading))
                write("/tf", tf, types[tf]([moving]), stamp)
            if poses in ("odometry", "both", "conflict"):
                point = types["geometry_msgs/msg/Point"](x, y, 0.0)
                pose = types["geometry_msgs/msg/Pose"](point, rotation(heading))
                zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
                twist = types["geometry_msgs/msg/Twist"](zero, zero)
                certain = np.zeros(36)
                odometry = types["nav_msgs/msg/Odometry"](
                    header(stamp, "odom"),
                    "base_link",
                    types["geometry_msgs/msg/PoseWithCovariance"](pose, certain),
                    types["geometry_msgs/msg/TwistWithCovariance"](twist, certain),
                )
                write("/odom", "nav_msgs/msg/Odometry", odometry, stamp)
        for step in range(scans):
            ranges = RANGES[step].astype(np.float32)
            limits = (np.float32(-math.pi / 2), np.float32(math.pi / 2), np.float32(SPACING), 0.0, 0.1, 0.05, 81.0)
            scan = types["sensor_msgs/msg/LaserScan"](
                header(STAMPS[step], "laser"), *map(float, limits), ranges, np.zeros(0, np.float32)
            )
            write("/scan", "sensor_msgs/msg/LaserScan", scan, STAMPS[step])
    return path


@pytest.mark.parametrize("poses", ["tf", "odometry"])
def test_ros1_bags(poses, tmp_path):
    expect(read_log(bag(tmp_path / "log.bag", 1, poses=poses), WINDOWS), atol=2e-3)


def test_odometry_of_base_link_below_base_footprint_places_both(tmp_path):
    expect(read_log(bag(tmp_path / "log.bag", 1, poses="conflict"), WINDOWS), atol=2e-3)


@pytest.mark.parametrize("poses", ["tf", "odometry"])
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_ros2_bags(poses, storage, tmp_path):
    directory = bag(tmp_path / "log", 2, poses=poses, storage=storage)
    expect(read_log(directory, WINDOWS), atol=2e-3)
    (file,) = (path for path in directory.iterdir() if path.suffix != ".yaml")
    if storage is StoragePlugin.MCAP:
        renamed = tmp_path / "recorded yesterday"
        file.rename(renamed)
        expect(read_log(renamed, WINDOWS), atol=2e-3)


def test_named_odometry_replaces_the_transforms_but_not_the_mounting_of_the_lidar(tmp_path):
    expect(read_log(bag(tmp_path / "log.bag", 1, poses="both"), WINDOWS, ReadOptions(None, "/odom")), atol=2e-3)


def test_a_lidar_whose_mounting_is_not_known_is_reported_once(tmp_path, caplog):
    read_log(bag(tmp_path / "log.bag", 1, poses="odometry"), WINDOWS)
    assert caplog.text.count("no transform of laser") == 1
    read_log(bag(tmp_path / "other.bag", 1, poses="tf"), WINDOWS)
    assert caplog.text.count("no transform") == 1


def test_the_pose_of_a_scan_is_that_of_its_middle(tmp_path):
    log = read_log(bag(tmp_path / "log.bag", 1, poses="odometry"), WINDOWS)
    assert log.poses[:, 0] == pytest.approx(POSES[:, 0], abs=1e-6)


def test_topics_are_named_when_they_are_missing(tmp_path):
    path = bag(tmp_path / "log.bag", 1, poses="tf")
    with pytest.raises(ValueError, match=r"no messages on /front .*there are /scan"):
        read_log(path, WINDOWS, ReadOptions("/front", None))
    with pytest.raises(ValueError, match=r"no messages on /odom .*there are none"):
        read_log(path, WINDOWS, ReadOptions(None, "/odom"))


def lines_with(change) -> list[str]:
    lines = [flaser(number) for number in range(SCANS)]
    change(lines)
    return lines


@pytest.mark.parametrize(
    ("number", "line", "reason"),
    [
        (5, flaser(4), "not later than the one before"),
        (5, flaser(2), "not later than the one before"),
        (5, flaser(5, np.full(361, 2.0)), "with another number of beams than 181"),
        (5, flaser(5, np.full(402, 2.0)), f"of 402 readings, which do not tell their angles as {COUNTS} do"),
        (5, flaser(5, np.full(BEAMS, np.nan)), "without a valid reading"),
        (5, flaser(5).replace("100.500000", "nan"), "without a time"),
        (5, flaser(5).replace("0.250000", "inf"), "without a pose"),
    ],
)
def test_a_scan_that_cannot_be_used_is_skipped_and_counted(number, line, reason, tmp_path):
    lines = [flaser(each) for each in range(SCANS)]
    lines[number] = line
    log = read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    assert log.skipped == {reason: 1}
    assert len(log) == SCANS - 1


@pytest.mark.parametrize("wrong", ["0", "-1", "nan"])
@pytest.mark.parametrize("number", [0, 5])
def test_a_scan_without_a_valid_maximum_range_is_skipped_and_counted(number, wrong, tmp_path):
    """Its hits must not become misses, which are free space."""
    lines = [robotlaser(each) for each in range(SCANS)]
    lines[number] = lines[number].replace("81.83", wrong, 1)
    log = read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    assert log.skipped == {"without a valid maximum range": 1}
    assert np.isfinite(np.delete(log.ranges, 40, axis=1)).all()
    assert log.range_max_m == 81.83


def test_a_parameter_in_the_log_that_makes_the_maximum_range_invalid_skips_the_scans_after_it(tmp_path):
    lines = [flaser(each) for each in range(SCANS)]
    lines.insert(20, "PARAM robot_front_laser_max 0")
    log = read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    assert log.skipped == {"without a valid maximum range": SCANS - 20}


def test_a_log_without_any_valid_maximum_range_is_refused(tmp_path):
    lines = [robotlaser(each).replace("81.83", "0", 1) for each in range(SCANS)]
    with pytest.raises(ValueError, match="expected a positive maximum range above the minimum, 0 m, got 0"):
        read_log(write_lines(tmp_path / "log", lines), WINDOWS)


def test_a_maximum_range_that_changes_is_reported_and_the_smallest_holds_for_misses(tmp_path, caplog):
    lines = [robotlaser(each) for each in range(SCANS)]
    lines[7] = lines[7].replace("81.83", "2.5", 1)
    log = read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    printed = caplog.text
    assert "the maximum range changes, 2.5 m in 1 scans, 81.83 m in 29 scans: misses show" in printed
    assert "up to the smallest, 2.5 m" in printed
    assert log.range_max_m == 2.5
    assert np.isinf(log.ranges[7]).sum() == (RANGES[7] >= 2.5).sum()
    assert np.isfinite(np.delete(np.delete(log.ranges, 7, axis=0), 40, axis=1)).all()


def test_headings_in_degrees_are_refused_with_the_largest(tmp_path):
    arrays = {"ranges": RANGES, "angles": np.radians(np.arange(-90, 91)), "stamps": STAMPS}
    np.savez(tmp_path / "log.npz", **arrays, poses=POSES + np.array([0, 0, 180]))
    with pytest.raises(ValueError, match=r"the headings look like degrees, the largest is 180.9: expected radians"):
        read_log(tmp_path / "log.npz", WINDOWS)


def test_an_odd_first_scan_does_not_decide_the_beams(tmp_path):
    lines = [flaser(each) for each in range(SCANS)]
    lines[0] = flaser(0, np.full(361, 2.0))
    log = read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    assert log.skipped == {"with another number of beams than 181": 1}
    assert len(log) == SCANS - 1


@pytest.mark.parametrize("begin", [3, 20])
def test_a_clock_that_is_set_begins_a_new_part(begin, tmp_path):
    stamps = 1000.0 + 0.1 * np.arange(SCANS) - 500.0 * (np.arange(SCANS) >= begin)
    arrays = {"ranges": np.full((SCANS, 5), 3.0), "angles": np.linspace(-1, 1, 5), "poses": np.zeros((SCANS, 3))}
    np.savez(tmp_path / "log.npz", **arrays, stamps=stamps)
    log = read_log(tmp_path / "log.npz", WINDOWS)
    assert log.stamps == pytest.approx(stamps)
    assert parts_of(log.stamps, WINDOWS) == [(0, begin), (begin, SCANS)]


@pytest.mark.parametrize("wrong", [0.0, 2000.0, 1e9])
def test_single_wrong_times_are_skipped(wrong, tmp_path):
    stamps = 1000.0 + 0.1 * np.arange(SCANS)
    stamps[[4, 11, SCANS - 3]] = wrong
    arrays = {"ranges": np.full((SCANS, 5), 3.0), "angles": np.linspace(-1, 1, 5), "poses": np.zeros((SCANS, 3))}
    np.savez(tmp_path / "log.npz", **arrays, stamps=stamps)
    log = read_log(tmp_path / "log.npz", WINDOWS)
    assert log.stamps == pytest.approx(np.delete(stamps, [4, 11, SCANS - 3]))
    assert log.skipped == {"far in time from those before and after": 3}


def test_times_that_go_back_again_and_again_are_refused(tmp_path):
    count = 400
    stamps = 1000.0 + np.random.default_rng(0).permutation(count)
    arrays = {"ranges": np.full((count, 5), 3.0), "angles": np.linspace(-1, 1, 5), "poses": np.zeros((count, 3))}
    np.savez(tmp_path / "log.npz", **arrays, stamps=stamps)
    with pytest.raises(TimesLost, match=r"time goes back by more than a window \d+ times: its times are lost"):
        read_log(tmp_path / "log.npz", WINDOWS)


def test_headings_in_degrees_below_one_turn_are_refused(tmp_path):
    arrays = {"ranges": np.full((200, 5), 3.0), "angles": np.linspace(-1, 1, 5), "stamps": 0.1 * np.arange(200)}
    poses = np.stack([np.ones(200), np.ones(200), 50 * np.sin(np.arange(200) / 8)], axis=1)
    np.savez(tmp_path / "log.npz", **arrays, poses=poses)
    with pytest.raises(ValueError, match="the headings look like degrees, they jump from scan to scan"):
        read_log(tmp_path / "log.npz", WINDOWS)
    np.savez(tmp_path / "log.npz", **arrays, poses=poses * [1, 1, np.pi / 180])
    assert len(read_log(tmp_path / "log.npz", WINDOWS)) == 200


def test_the_beams_are_those_of_the_scans_with_a_pose():
    """Without a pose it is not known whether a lidar is upside down, so its angles may have the other sign."""
    placed = [LogScan(0.1 * step, np.full(5, 3.0), 0.4, -0.1, 0.1, 30.0, (0.0, 0.0, 0.0)) for step in range(60)]
    scans = [replace(each, first_angle=-0.4, spacing=0.1, pose=None) for each in placed[:40]] + placed[40:]
    log = collect(scans, Path("log"), WINDOWS)
    assert len(log) == 20
    assert log.skipped == {"without a pose": 40}
    assert log.angles == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])


def test_scans_without_beams_are_skipped_and_counted(tmp_path):
    """As some drivers send them before the lidar turns."""
    lines = [flaser(each) for each in range(SCANS)]
    lines[0] = flaser(0, [])
    log = read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    assert log.skipped == {"without beams": 1}


def test_scans_without_beams_do_not_decide_the_beams():
    empty = [LogScan(0.1 * step, np.zeros(0), 0.0, 0.1, 0.1, 30.0, (0.0, 0.0, 0.0)) for step in range(30)]
    scans = [LogScan(3 + 0.1 * step, np.full(5, 3.0), 0.0, 0.1, 0.1, 30.0, (0.0, 0.0, 0.0)) for step in range(9)]
    log = collect([*empty, *scans, replace(scans[-1], stamp=9.0, ranges=np.full(2, 3.0))], Path("log"), WINDOWS)
    assert log.skipped == {"without beams": 30, "with another number of beams than 5": 1}
    with pytest.raises(ValueError, match="expected beam angles in radians"):
        collect([*empty, *(replace(scan, first_angle=-90.0, spacing=45.0) for scan in scans)], Path("log"), WINDOWS)


def test_a_reading_at_the_minimum_is_valid():
    """In the words of LaserScan, values below range_min or above range_max are to be discarded."""
    scan = LogScan(0.0, np.float32([0.05, 0.1, 0.2, 30.0]), 0.0, 0.1, np.float32(0.1), 30.0, (0, 0, 0))
    assert np.array_equal(scan.valid_ranges(), np.float32([np.nan, 0.1, 0.2, np.inf]), equal_nan=True)


def test_times_of_six_digits_are_an_error(tmp_path):
    """As in CARMEN logs written with %g: 1.01893e+09."""
    lines = [flaser(each).replace(f"{STAMPS[each]:.6f}", f"{1e9 + 1e4 * (each > 9):g}") for each in range(SCANS)]
    path = write_lines(tmp_path / "log", lines)
    with pytest.raises(TimesLost, match="28 scans are not later than the one before, 2 are later: its times are lost"):
        read_log(path, WINDOWS)
    log = read_log(path, replace(WINDOWS, spacing="distance"))
    assert log.stamps.tolist() == list(range(SCANS))
    assert log.poses == pytest.approx(POSES, abs=1e-6)


def test_readings_at_the_maximum_are_misses_and_nan_and_zero_are_invalid(tmp_path):
    ranges = RANGES[3].copy()
    ranges[:3] = np.nan, 0, 90
    lines = [flaser(each) for each in range(SCANS)]
    lines[3] = flaser(3, ranges)
    read = read_log(write_lines(tmp_path / "log", lines), WINDOWS).ranges[3, :3]
    assert np.array_equal(read, [np.nan, np.nan, np.inf], equal_nan=True)


def test_a_full_turn_has_no_beam_twice(tmp_path):
    angles = np.radians(np.arange(0, 361.0))
    ranges = np.full((SCANS, 361), 3.0)
    np.savez(tmp_path / "a.npz", ranges=ranges, angles=angles, poses=POSES, stamps=STAMPS)
    assert len(read_log(tmp_path / "a.npz", WINDOWS).angles) == 360


def test_scans_that_follow_too_soon_are_left_out(tmp_path):
    path = write_lines(tmp_path / "log", [flaser(number) for number in range(SCANS)])
    log = read_log(path, replace(WINDOWS, step_s=0.5))
    assert len(log) == SCANS / 3
    assert log.skipped == {"less than half a step after the one before": SCANS * 2 / 3}


@pytest.mark.parametrize("first", [0.0, -math.pi])
def test_a_log_is_cropped_to_the_beams_ahead(first):
    angles = first + np.radians(np.arange(360))
    ranges = np.tile(np.cos(angles), (2, 1))  # tells the direction of a beam
    log = ScanLog(np.arange(2.0), ranges, angles, np.zeros((2, 3))).crop(math.radians(90))
    assert np.degrees(log.angles) == pytest.approx(np.arange(-45, 46), abs=1e-6)
    assert log.ranges[0] == pytest.approx(np.cos(log.angles))
    held_out, all_angles = log.held_out(1)
    assert all_angles is angles
    assert np.isnan(held_out[0]).sum() == 91
    others = ~np.isnan(held_out[0])
    assert (np.cos(angles[others]) < math.cos(math.radians(45))).all()
    assert held_out[0, others] == pytest.approx(ranges[1, others])


def test_a_crop_wider_than_the_view_of_the_lidar_is_refused():
    angles = np.radians(np.arange(271))
    log = ScanLog(np.arange(2.0), np.ones((2, 271)), angles, np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"no beams between -90.0 and 0.0 degrees: .* got 270.0 degrees"):
        log.crop(math.radians(270))
    assert len(log.crop(math.radians(60)).angles) == 31  # from straight ahead to the left


def test_a_crop_that_keeps_all_beams_holds_none_out():
    log = ScanLog(np.arange(2.0), np.ones((2, 3)), np.array([-0.1, 0, 0.1]), np.zeros((2, 3)))
    assert log.held_out(0) is None
    assert log.crop(math.radians(90)).held_out(0) is None


@pytest.mark.parametrize("stated", ["81.83", "2.5", "0", "nan"])
def test_a_given_maximum_range_replaces_that_of_the_log(stated, tmp_path):
    """Also where that of the log is below its readings, which would otherwise be free rays instead of hits."""
    lines = [robotlaser(each).replace("81.83", stated, 1) for each in range(SCANS)]
    log = read_log(write_lines(tmp_path / "log", lines), replace(WINDOWS, range_max_m=50.0))
    expect(log)
    held_out, _ = log.crop(1.0).held_out(0)
    assert np.isinf(held_out[0, 40])
    assert log.range_max_m == 50.0


def test_readings_beyond_the_maximum_range_that_vary_are_named(tmp_path, caplog):
    lines = [robotlaser(each).replace("81.83", "2.5", 1) for each in range(SCANS)]
    read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    assert "readings beyond the maximum range, 2.5 m, vary like hits up to" in caplog.text
    caplog.clear()
    read_log(write_lines(tmp_path / "log", [robotlaser(each) for each in range(SCANS)]), WINDOWS)
    assert "vary" not in caplog.text


def altered(data: bytes) -> bytes:
    return data[:12] + b"\xff" * 40 + data[52:]


def truncated(path: Path) -> Path:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def shortened(path: Path) -> Path:
    """Cut off a part of the last page of a database, which SQLite reads as zeros."""
    path.write_bytes(path.read_bytes()[:-100])
    return path


def compressed(path: Path) -> Path:
    written = bag(path, 2, poses="tf", compression=(CompressionMode.MESSAGE, CompressionFormat.ZSTD))
    return next(written.glob("*.mcap"))


def mcap(path: Path) -> Path:
    (written,) = bag(path, 2, poses="tf").glob("*.mcap")
    return written


def with_profile(path: Path, profile: bytes) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[:17] + len(profile).to_bytes(4, "little") + profile + data[25:])
    return path


NO_LOGS = {
    "missing": (lambda path: path, "no such file"),
    "empty": (lambda path: (path.write_bytes(b"") and path) or path, "is empty"),
    "garbage": (lambda path: (path.write_bytes(bytes(range(256)) * 99), path)[1], "of no known kind"),
    "text": (lambda path: (path.write_text("hello\nworld\n"), path)[1], "of no known kind"),
    "directory": (lambda path: (path.mkdir(), path)[1], "without metadata.yaml"),
    "pipe": (lambda path: (os.mkfifo(path), path)[1], "neither a file nor a directory"),
    "unreadable": (lambda path: Path("/proc/self/mem"), "cannot be read .*error"),
    "zip": (lambda path: (path.write_bytes(b"PK\x03\x04" + bytes(99)), path)[1], "cannot be read"),
    "gzip": (lambda path: (path.write_bytes(gzip.compress(flaser(0).encode())[:-20]), path)[1], "is damaged"),
    "gzip with other bytes": (
        lambda path: (path.write_bytes(altered(gzip.compress(flaser(0).encode()))), path)[1],
        "is damaged",
    ),
    "gzip of nothing": (lambda path: (path.write_bytes(gzip.compress(b"")), path)[1], "is packed with gzip: unpack it"),
    "gzip of a bag": (lambda path: (path.write_bytes(gzip.compress(b"#ROSBAG V2.0")), path)[1], "packed with gzip"),
    "zstd": (lambda path: (path.write_bytes(b"\x28\xb5\x2f\xfd" + bytes(99)), path)[1], "packed with zstd: unpack it"),
    "bag header only": (lambda path: (path.write_bytes(b"#ROSBAG V2.0\n"), path)[1], "the bag cannot be read"),
    "mcap header only": (lambda path: (path.write_bytes(b"\x89MCAP0\r\n"), path)[1], "the bag cannot be read"),
    "sqlite header only": (lambda path: (path.write_bytes(b"SQLite format 3\0"), path)[1], "the bag cannot be read"),
    "truncated bag": (lambda path: truncated(bag(path.with_suffix(".bag"), 1, poses="tf")), "the bag cannot be read"),
    "truncated mcap": (lambda path: truncated(mcap(path)), r"the bag cannot be read .*mcap recover"),
    "truncated database": (
        lambda path: shortened(next(bag(path, 2, poses="tf", storage=StoragePlugin.SQLITE3).glob("*.db3"))),
        "the bag is truncated",
    ),
    "compressed messages without metadata": (lambda path: compressed(path), "compressed, give its directory"),
    "mcap of ros1": (lambda path: with_profile(mcap(path), b"ros1"), "profile 'ros2', got 'ros1': .*rosbags-convert"),
    "mcap of no profile": (lambda path: with_profile(mcap(path), b""), "profile 'ros2', got ''"),
    "bag without poses": (lambda path: bag(path.with_suffix(".bag"), 1, poses="none"), "no poses"),
    "bag without scans": (lambda path: bag(path.with_suffix(".bag"), 1, poses="tf", scans=0), "no messages of sensor"),
    "one scan": (lambda path: write_lines(path, [flaser(0)]), "1 scans can be used"),
    "no scans": (lambda path: write_lines(path, []), "expected lines FLASER or ROBOTLASER1 .*; its lines are PARAM"),
    "millimeters": (
        lambda path: write_lines(
            path, ["PARAM front_laser_max 90000", *(flaser(n, 1000 * RANGES[n]) for n in range(SCANS))]
        ),
        "expected meters",
    ),
    "a million beams": (
        lambda path: write_lines(path, [flaser(n, np.full(1_000_000, 2.0)) for n in range(2)]),
        "0 scans can be used .2 of 1000000 readings, which do not tell their angles",
    ),
    "a short line": (lambda path: write_lines(path, [flaser(0)[:300]]), "line 3 is no FLASER line"),
    "no readings": (
        lambda path: write_lines(path, ["FLASER 0 0 0 0 0 0 0 1.0 robot 1.0"]),
        "0 scans can be used .1 without beams",
    ),
    "words": (lambda path: write_lines(path, ["FLASER two 1 2 3"]), "line 3 is no FLASER line"),
}


@pytest.mark.parametrize("name", NO_LOGS)
def test_what_is_no_log_is_refused_with_its_name(name, tmp_path):
    make, message = NO_LOGS[name]
    path = make(tmp_path / "log")
    with pytest.raises(ValueError, match=message) as refused:
        read_log(path, WINDOWS)
    assert str(path) in str(refused.value)


def test_a_bag_of_which_messages_are_lost_is_refused(tmp_path):
    """As on a disk with a bad block; rosbags passes over zeros."""
    directory = bag(tmp_path / "log", 2, poses="tf")
    (path,) = directory.glob("*.mcap")
    data = path.read_bytes()
    middle = len(data) // 2
    path.write_bytes(data[:middle] + bytes(1000) + data[middle + 1000 :])
    with pytest.raises(ValueError, match=r"the bag is damaged: \d+ of 30 messages on /scan can be read; repair it"):
        read_log(path, WINDOWS)


def test_a_text_with_comments_is_no_carmen_log(tmp_path):
    with pytest.raises(ValueError, match="is of no known kind"):
        read_log(write(tmp_path / "poses.txt", "# time x y heading\n0 1 2 3\n"), WINDOWS)


def test_a_carmen_log_without_a_maximum_range_is_named(tmp_path, caplog):
    lines = [flaser(each) for each in range(SCANS)]
    log = read_log(write(tmp_path / "log", "\n".join(lines)), WINDOWS)
    assert log.range_max_m == 81.83
    assert caplog.text.count("81.83 m is taken, prediction.range_max_m=... chooses another") == 1


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_lidar_that_stands_needs_no_poses(tmp_path):
    options = ReadOptions(pose=(1.0, 2.0, 0.5))
    log = read_log(bag(tmp_path / "log.bag", 1, poses="none"), WINDOWS, options)
    assert log.stamps == pytest.approx(STAMPS, abs=1e-6)
    assert log.poses == pytest.approx(np.tile(options.pose, (SCANS, 1)))
    np.savez(tmp_path / "log.npz", ranges=RANGES, angles=np.radians(np.arange(-90, 91)), stamps=STAMPS)
    with pytest.raises(ValueError, match=r"lacks poses: .* For a lidar that stands, set prediction.pose=fixed"):
        read_log(tmp_path / "log.npz", WINDOWS)
    assert read_log(tmp_path / "log.npz", WINDOWS, options).poses == pytest.approx(log.poses)


def test_a_mounting_places_the_lidar_on_the_robot(tmp_path):
    log = read_log(write_lines(tmp_path / "log", [flaser(n) for n in range(SCANS)]), WINDOWS)
    back = ReadOptions(mounting=(0.2, 0.1, math.pi))
    mounted = read_log(tmp_path / "log", WINDOWS, back)
    for (x, y, heading), found in zip(log.poses, mounted.poses, strict=True):
        turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
        assert found[:2] == pytest.approx((x, y) + turn @ (0.2, 0.1))
        assert found[2] == pytest.approx(heading + math.pi)


def test_a_mounting_replaces_that_of_a_bag(tmp_path):
    path = bag(tmp_path / "log.bag", 1, poses="tf")
    expect(read_log(path, WINDOWS, ReadOptions(mounting=(0.2, 0.0, 0.0))), atol=2e-3)
    turned = read_log(path, WINDOWS, ReadOptions(mounting=(0.2, 0.0, 1.0)))
    assert turned.poses == pytest.approx(POSES + np.array([0, 0, 1]), abs=2e-3)


@pytest.mark.parametrize("unused", [{"mounting": (0.0, 0.0, 1.0)}, {"frame": "odom"}, {"odometry_topic": "/odom"}])
def test_what_the_pose_of_a_lidar_that_stands_makes_useless_is_refused(unused):
    with pytest.raises(ValueError, match=f"a lidar that stands needs no {next(iter(unused))}"):
        ReadOptions(pose=(0.0, 0.0, 0.0), **unused)


def test_scans_that_were_left_out_are_named_where_the_others_have_no_window(tmp_path):
    lines = [flaser(each, None if each < 5 else np.zeros(BEAMS)) for each in range(SCANS)]
    log = read_log(write_lines(tmp_path / "log", lines), WINDOWS)
    with pytest.raises(ValueError, match=r"the log has 0.4 s of scans, .* \(skipped: 25 without a valid reading\)"):
        log.check_times(WINDOWS)


def test_topics_and_frames_of_a_log_that_is_no_bag_are_refused(tmp_path):
    path = write_lines(tmp_path / "log", [flaser(n) for n in range(SCANS)])
    with pytest.raises(ValueError, match="expected a bag for a topic or a frame of its poses, got CARMEN"):
        read_log(path, WINDOWS, ReadOptions("/scan"))


def test_scans_with_a_varying_number_of_readings_are_resampled(caplog):
    """As of an LD19: 88 to 94 readings between the same limits, most often 91; a ramp tells the angle of a reading."""
    scans = []
    for step in range(40):
        count = (91, 91, 88, 94)[step % 4]
        ranges = np.linspace(2, 3, count)
        scans.append(LogScan(0.1 * step, ranges, -1.0, 2.0 / (count - 1), 0.1, 30.0, (0.0, 0.0, 0.0)))
    log = collect(scans, Path("log"), WINDOWS)
    assert log.skipped == {}
    assert np.abs(log.ranges - np.linspace(2, 3, 91)).max() <= 0.5 / 87 + 1e-6
    assert log.ranges[0] == pytest.approx(np.linspace(2, 3, 91))
    assert caplog.text.count("the beams vary, such as") == 1


def test_the_last_messages_of_a_database_that_was_not_closed_are_read(tmp_path):
    """They are in its write-ahead log, as after a recorder was killed."""
    directory = bag(tmp_path / "log", 2, poses="tf", storage=StoragePlugin.SQLITE3)
    (path,) = directory.glob("*.db3")
    open_one = sqlite3.connect(path)
    open_one.execute("PRAGMA journal_mode=WAL")
    open_one.execute("PRAGMA wal_autocheckpoint=0")
    (topic,) = open_one.execute("SELECT id FROM topics WHERE name='/scan'").fetchone()
    rows = open_one.execute("SELECT timestamp, data FROM messages WHERE topic_id=?", (topic,)).fetchall()
    open_one.execute("DELETE FROM messages WHERE topic_id=? AND timestamp>?", (topic, rows[9][0]))
    open_one.commit()
    open_one.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
    open_one.executemany(insert, [(topic, *row) for row in rows[10:]])
    open_one.commit()
    recording = shutil.copytree(directory, tmp_path / "killed")
    open_one.close()
    before = {file.name: file.read_bytes() for file in recording.iterdir()}
    assert any(name.endswith("-wal") for name in before)
    expect(read_log(recording, WINDOWS), atol=2e-3)
    expect(read_log(recording / path.name, WINDOWS), atol=2e-3)
    assert {file.name: file.read_bytes() for file in recording.iterdir()} == before


def test_the_parts_of_a_bag_in_a_directory_are_one_log(tmp_path):
    """The second one has the same scans again, and no poses."""
    for name, poses in (("a.bag", "tf"), ("b.bag", "none")):
        bag(tmp_path / name, 1, poses=poses)
    log = read_log(tmp_path, WINDOWS)
    assert log.skipped == {"not later than the one before": SCANS}
    expect(replace(log, skipped={}), atol=2e-3)


def test_a_directory_of_a_bag_has_regular_files_only(tmp_path):
    directory = bag(tmp_path / "log", 2, poses="tf")
    os.mkfifo(directory / "pipe")
    with pytest.raises(ValueError, match="pipe: expected a regular file in the directory of a bag"):
        read_log(directory, WINDOWS)


def test_a_line_that_does_not_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("repro.prediction.carmen.MAX_LINE", 1000)
    with pytest.raises(ValueError, match="has a line of more than 1000 characters"):
        read_log(write_lines(tmp_path / "log", ["FLASER " + "1 " * 2000]), WINDOWS)
