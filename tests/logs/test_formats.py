"""CARMEN and npz logs, what of them is used, and files that are no logs; see also test_bags.py."""

import gzip
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_files import (
    ANGLES,
    BEAMS,
    POSES,
    RANGES,
    SCANS,
    STAMPS,
    WINDOWS,
    bag,
    carmen,
    expect,
    flaser,
    lines,
    npz,
    read,
    robotlaser,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin

from repro.logs.consistency import inconsistencies
from repro.logs.log_scan import LogScan
from repro.logs.readings import readings
from repro.logs.reasons import Reason
from repro.logs.scan_log import ScanLog, collect


@pytest.mark.parametrize("line", [flaser, robotlaser])
def test_carmen(line, tmp_path):
    path = carmen(tmp_path / "log.txt", lines(line))
    expect(read(path))
    packed = tmp_path / "any name"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    expect(read(packed))
    path.write_text(path.read_text(), encoding="utf-8-sig")  # with a byte order mark
    expect(read(path))


def test_npz(tmp_path):
    expect(read(npz(tmp_path / "a.npz", range_max_m=81.83)))
    expect(read(npz(tmp_path / "b.npz", range_max_m=81.83, ranges=RANGES[:, ::-1], angles=ANGLES[::-1])))


def test_raw_scans_of_carmen_are_placed_by_the_odometry_around_them(tmp_path):
    """The lidar is 0.2 m in front of the robot; in a log that has placed scans, too, raw ones are passed over."""
    written = ["PARAM robot_frontlaser_offset 0.2"]
    for number in range(-1, SCANS + 1):  # odometry at other times than the scans, linear in between
        stamp, (x, y, heading) = 100 + 0.1 * number + 0.04, ((number + 0.4) * rate for rate in (0.05, -0.02, 0.03))
        x, y = x - 0.2 * math.cos(heading), y - 0.2 * math.sin(heading)
        if 0 <= number < SCANS:
            words = robotlaser(number).split()
            written.append(" ".join(["RAWLASER1", *words[1 : 9 + BEAMS], "0", *words[-3:]]))
        written.append(f"ODOM {x:.6f} {y:.6f} {heading:.6f} 0 0 0 {stamp:.6f} robot 0.0")
    path = tmp_path / "log"
    path.write_text("\n".join(written))
    expect(read(path), atol=1e-3)
    path.write_text("\n".join([robotlaser(0), *written, *map(robotlaser, range(1, SCANS))]))
    expect(read(path))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (f"{-math.pi / 2:.8f}", "1e18", "expected beam angles in radians within one turn, got 181 beams from 1e.18"),
        ("0.050000 -0.020000", "1e17 -0.020000", "with a pose that is too far away"),
    ],
)
def test_fields_that_no_lidar_has_are_refused_or_left_out(old, new, message, tmp_path):
    written = [line.replace(old, new) for line in lines(robotlaser)]
    if "pose" in message:
        assert any(re.search(message, reason) for reason in read(carmen(tmp_path / "log", written)).skipped)
    else:
        with pytest.raises(ValueError, match=message):
            read(carmen(tmp_path / "log", written))


def test_a_clock_that_was_set_back_to_its_first_time_has_no_other_message(tmp_path):
    """First and last time are equal, which divided by zero."""
    stamps = np.concatenate([100 + 0.1 * np.arange(15), 100 - 1.4 + 0.1 * np.arange(15)])
    log = read(npz(tmp_path / "log.npz", stamps=stamps), replace(WINDOWS, steps=2))
    log = replace(log, stamps=np.concatenate([log.stamps[:-1], log.stamps[:1]]))
    assert not inconsistencies(log, replace(WINDOWS, steps=2))


def test_a_line_without_an_end_is_refused(tmp_path):
    path = tmp_path / "log"
    path.write_text("FLASER 181 " + "1.0 " * 1_100_000)
    with pytest.raises(ValueError, match=r"line 1 is no FLASER line of CARMEN .it has 4,000,000 characters or more"):
        read(path)


@pytest.mark.parametrize(
    ("number", "line", "reason"),
    [
        (5, flaser(4), "not later than the one before"),
        (5, flaser(2), "not later than the one before"),
        (5, flaser(5, np.full(361, 2.0)), "with another number of beams"),
        (0, flaser(0, np.full(361, 2.0)), "with another number of beams"),  # it does not decide the beams
        (5, flaser(5, np.full(402, 2.0)), Reason.UNKNOWN_ANGLES),
        (5, flaser(5, np.full(BEAMS, np.nan)), "without a valid reading"),
        (5, flaser(5).replace("100.500000", "nan"), "without a time"),
        (5, flaser(5).replace("0.250000", "inf"), "without a pose"),
        (0, flaser(0, []), "without beams"),  # as some drivers send before the lidar turns
        (0, robotlaser(0).replace("81.83", "0", 1), "without a valid maximum range"),
        (5, robotlaser(5).replace("81.83", "-1", 1), "without a valid maximum range"),
        (5, robotlaser(5).replace("81.83", "nan", 1), "without a valid maximum range"),
    ],
)
def test_a_scan_that_cannot_be_used_is_skipped_and_counted(number, line, reason, tmp_path):
    log = read(carmen(tmp_path / "log", lines(changed={number: line})))
    assert log.skipped == {reason: 1}
    assert len(log) == SCANS - 1
    assert log.range_max_m == 81.83
    assert np.isfinite(np.delete(log.ranges, 40, axis=1)).all(), "hits do not become misses"


def test_a_scan_with_another_maximum_range_than_most_is_left_out(tmp_path):
    log = read(carmen(tmp_path / "log", lines(robotlaser, {7: robotlaser(7).replace("81.83", "0.001", 1)})))
    assert log.range_max_m == 81.83
    assert log.skipped == {"with another maximum range, which range_max_m replaces": 1}
    assert np.isfinite(np.delete(log.ranges, 40, axis=1)).all()


def test_a_maximum_range_that_varies_is_not_known(tmp_path):
    """As of a driver that states the largest reading of each scan."""
    varied = {number: robotlaser(number).replace("81.83", f"{2.9 + 0.01 * number}", 1) for number in range(SCANS)}
    log = read(carmen(tmp_path / "log", lines(robotlaser, varied)))
    assert (log.range_max_m, len(log), log.skipped) == (math.inf, SCANS, {})
    assert np.isfinite(log.ranges).all()
    assert log.notes[0].startswith("the maximum range of the scans varies from 2.9 to 3.09 m, as of a driver")


@pytest.mark.parametrize("stated", ["81.83", "2.5", "0", "nan"])
def test_a_given_maximum_range_replaces_that_of_the_log(stated, tmp_path):
    """Also where that of the log is below its readings, which would otherwise be free rays instead of hits."""
    written = [line.replace("81.83", stated, 1) for line in lines(robotlaser)]
    log = read(carmen(tmp_path / "log", written), replace(WINDOWS, range_max_m=50.0))
    expect(log)
    held_out, _ = log.crop(1.0).held_out(0)
    assert np.isinf(held_out[0, 40])
    assert log.range_max_m == 50.0


def test_a_carmen_log_without_a_maximum_range_is_named(tmp_path, caplog):
    (tmp_path / "log").write_text("\n".join(lines()))
    assert read(tmp_path / "log").range_max_m == 81.83
    assert caplog.text.count("81.83 m is taken, prediction.range_max_m=... chooses another") == 1


def test_headings_in_degrees_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"the headings look like degrees, the largest is 180.9: expected radians"):
        read(npz(tmp_path / "log.npz", poses=POSES + np.array([0, 0, 180])))
    steps = np.arange(200)
    turning = np.stack([np.ones(200), np.ones(200), 50 * np.sin(steps / 8)], axis=1)  # below ten turns
    others = {"ranges": np.full((200, 5), 3.0), "angles": np.linspace(-1, 1, 5), "stamps": 0.1 * steps}
    with pytest.raises(ValueError, match="the headings look like degrees, they jump from scan to scan"):
        read(npz(tmp_path / "log.npz", **others, poses=turning))
    assert len(read(npz(tmp_path / "log.npz", **others, poses=turning * [1, 1, np.pi / 180]))) == 200


def test_times_that_are_lost_are_an_error(tmp_path):
    """They go back again and again, or have six digits, as in CARMEN logs written with %g: 1.01893e+09."""
    count = 400
    arrays = {"ranges": np.full((count, 5), 3.0), "angles": np.linspace(-1, 1, 5), "poses": np.zeros((count, 3))}
    stamps = 1000.0 + np.random.default_rng(0).permutation(count)
    with pytest.raises(ValueError, match=r"time goes back by more than a window \d+ times: its times are lost"):
        read(npz(tmp_path / "log.npz", **arrays, stamps=stamps))
    written = [line.replace(f"{STAMPS[n]:.6f}", f"{1e9 + 1e4 * (n > 9):g}") for n, line in enumerate(lines())]
    path = carmen(tmp_path / "log", written)
    with pytest.raises(ValueError, match="28 scans are not later than the one before, 2 are later: its times are lost"):
        read(path)
    log = read(path, replace(WINDOWS, spacing="distance"))
    assert log.stamps.tolist() == list(range(SCANS))
    assert log.poses == pytest.approx(POSES, abs=1e-6)


def log_scan(step: int, count: int = 5, **changes) -> LogScan:
    scan = LogScan(0.1 * step, np.full(count, 3.0), 0.0, 0.1, 0.1, 30.0, (0.0, 0.0, 0.0))
    return replace(scan, **changes)


def test_the_beams_are_those_of_the_scans_with_a_pose():
    """Without a pose it is not known whether a lidar is upside down, so its angles may have the other sign."""
    lost = [log_scan(step, first_angle=-0.4, pose=None) for step in range(40)]
    log = collect([*lost, *(log_scan(step, first_angle=0.4, spacing=-0.1) for step in range(40, 60))], "log", WINDOWS)
    assert len(log) == 20
    assert log.skipped == {"without a pose": 40}
    assert log.angles == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])


def test_scans_with_a_varying_number_of_readings_are_resampled(caplog):
    """As of an LD19: 88 to 94 readings between the same limits, most often 91; a ramp tells the angle of a reading."""
    counts = [(91, 91, 88, 94)[step % 4] for step in range(40)]
    scans = [
        log_scan(step, ranges=np.linspace(2, 3, count), first_angle=-1.0, spacing=2.0 / (count - 1))
        for step, count in enumerate(counts)
    ]
    log = collect(scans, "log", WINDOWS)
    assert log.skipped == {}
    assert np.abs(log.ranges - np.linspace(2, 3, 91)).max() <= 0.5 / 87 + 1e-6
    assert log.ranges[0] == pytest.approx(np.linspace(2, 3, 91))
    assert caplog.text.count("the beams vary, such as") == 1


def test_readings_at_the_minimum_are_valid_at_the_maximum_misses_and_others_invalid():
    """In the words of LaserScan, values below range_min or above range_max are to be discarded."""
    reported = np.float32([np.nan, -1, 0, 0.05, 0.1, 0.2, 30, 90])
    expected = np.float32([np.nan, np.nan, np.nan, np.nan, 0.1, 0.2, np.inf, np.inf])
    assert np.array_equal(readings(reported, np.float32(0.1), 30.0), expected, equal_nan=True)


def test_an_empty_place_is_a_log(tmp_path):
    """Also where the driver reports each miss as the same value far beyond the maximum range."""
    log = read(carmen(tmp_path / "log", ["PARAM front_laser_max 30", *(flaser(n, [6e4] * 181) for n in range(SCANS))]))
    assert np.isinf(log.ranges).all()
    assert log.skipped == {}


def test_a_full_turn_has_no_beam_twice(tmp_path):
    angles = np.radians(np.arange(0, 361.0))
    assert len(read(npz(tmp_path / "a.npz", ranges=np.full((SCANS, 361), 3.0), angles=angles)).angles) == 360


def test_scans_that_follow_too_soon_are_left_out(tmp_path):
    log = read(carmen(tmp_path / "log", lines()), replace(WINDOWS, step_s=0.5))
    assert len(log) == SCANS / 3
    assert log.skipped == {"less than half a step after the one before": SCANS * 2 / 3}


def of_beams(angles: np.ndarray, ranges: np.ndarray | float = 1.0) -> ScanLog:
    return ScanLog(np.arange(2.0), np.tile(ranges + 0 * angles, (2, 1)), angles, np.zeros((2, 3)))


@pytest.mark.parametrize("first", [0.0, -math.pi])
def test_a_log_is_cropped_to_the_beams_ahead(first):
    angles = first + np.radians(np.arange(360))
    log = of_beams(angles, np.cos(angles)).crop(math.radians(90))  # a range tells the direction of a beam
    assert np.degrees(log.angles) == pytest.approx(np.arange(-45, 46), abs=1e-6)
    assert log.ranges[0] == pytest.approx(np.cos(log.angles))
    held_out, all_angles = log.held_out(1)
    assert all_angles is angles
    assert np.isnan(held_out[0]).sum() == 91
    others = ~np.isnan(held_out[0])
    assert (np.cos(angles[others]) < math.cos(math.radians(45))).all()
    assert held_out[0, others] == pytest.approx(np.cos(angles[others]))


def test_a_crop_is_within_the_view_of_the_lidar():
    log = of_beams(np.radians(np.arange(271)))
    with pytest.raises(ValueError, match=r"no beams between -90.0 and 0.0 degrees: .* got 270.0 degrees"):
        log.crop(math.radians(270))
    assert len(log.crop(math.radians(60)).angles) == 31  # from straight ahead to the left
    log = of_beams(np.array([-0.1, 0, 0.1]))
    assert log.held_out(0) is None
    assert log.crop(math.radians(90)).held_out(0) is None, "all beams are kept"


def content(data: bytes, suffix: str = ""):
    return lambda path: (path.with_suffix(suffix).write_bytes(data), path.with_suffix(suffix))[1]


def truncated(path: Path, count: int = 0) -> Path:
    """Cut off some bytes, or half of a file; SQLite reads the rest of a page as zeros."""
    path.write_bytes(path.read_bytes()[: -count or path.stat().st_size // 2])
    return path


def mcap(path: Path, profile: bytes = b"ros2", **options) -> Path:
    (written,) = bag(path, 2, poses="tf", **options).glob("*.mcap")
    data = written.read_bytes()
    written.write_bytes(data[:17] + len(profile).to_bytes(4, "little") + profile + data[25:])
    return written


PACKED = gzip.compress(flaser(0).encode())
COMPRESSED = {"compression": (CompressionMode.MESSAGE, CompressionFormat.ZSTD)}
IN_MM = ["PARAM front_laser_max 90000", *(flaser(number, 1000 * RANGES[number]) for number in range(SCANS))]
NO_LOGS = {
    "missing": (lambda path: path, "no such file"),
    "empty": (content(b""), "is empty"),
    "garbage": (content(bytes(range(256)) * 99), "of no known kind"),
    "text with comments": (content(b"# time x y heading\n0 1 2 3\n"), "of no known kind"),
    "directory": (lambda path: (path.mkdir(), path)[1], "without metadata.yaml"),
    "pipe": (lambda path: (os.mkfifo(path), path)[1], "neither a file nor a directory"),
    "unreadable": (lambda path: Path("/proc/self/mem"), "cannot be read .*error"),
    "zip": (content(b"PK\x03\x04" + bytes(99)), "cannot be read"),
    "gzip": (content(PACKED[:-20]), "is damaged"),
    "gzip with other bytes": (content(PACKED[:12] + b"\xff" * 40 + PACKED[52:]), "is damaged"),
    "gzip of a bag": (content(gzip.compress(b"#ROSBAG V2.0")), "of no known kind: .*, unpacked"),
    "bag of another name": (content(b"#ROSBAG V2.0\n"), "is a bag: expected a name that ends with .bag, .db3, .mcap"),
    "bag header only": (content(b"#ROSBAG V2.0\n", ".bag"), "the bag cannot be read"),
    "mcap header only": (content(b"\x89MCAP0\r\n", ".mcap"), "the bag cannot be read"),
    "sqlite header only": (content(b"SQLite format 3\0", ".db3"), "the bag cannot be read"),
    "truncated bag": (lambda path: truncated(bag(path.with_suffix(".bag"), 1, poses="tf")), "the bag cannot be read"),
    "truncated mcap": (lambda path: truncated(mcap(path)), r"the bag cannot be read .*mcap recover"),
    "truncated database": (
        lambda path: truncated(next(bag(path, 2, poses="tf", storage=StoragePlugin.SQLITE3).glob("*.db3")), 100),
        "the bag is truncated",
    ),
    "compressed messages without metadata": (lambda path: mcap(path, **COMPRESSED), "compressed, give its directory"),
    "mcap of ros1": (lambda path: mcap(path, b"ros1"), "messages of ROS 2, got the profile 'ros1': .*rosbags-convert"),
    "mcap of another profile": (lambda path: mcap(path, b"cars"), "messages of ROS 2, got the profile 'cars'$"),
    "bag without poses": (lambda path: bag(path.with_suffix(".bag"), 1, poses="none"), "no poses"),
    "bag without scans": (lambda path: bag(path.with_suffix(".bag"), 1, poses="tf", scans=0), "no messages of sensor"),
    "one scan": (lambda path: carmen(path, [flaser(0)]), "1 scans can be used"),
    "no scans": (
        lambda path: carmen(path, []),
        "expected lines FLASER, ROBOTLASER1 or RAWLASER1 .*; its lines are PARAM",
    ),
    "no maximum range": (
        lambda path: carmen(path, [line.replace("81.83", "0", 1) for line in lines(robotlaser)]),
        "expected a positive maximum range above the minimum, 0 m, got 0",
    ),
    "millimeters": (lambda path: carmen(path, IN_MM), "0 scans can be used .30 with ranges that are not in meters"),
    "millimeters of a lidar of 30 m": (lambda path: carmen(path, ["PARAM front_laser_max 30", *IN_MM[1:]]), "not in m"),
    "many beams": (
        lambda path: carmen(path, [flaser(n, np.full(10_000, 2.0)) for n in range(2)]),
        "0 scans can be used .2 with a number of readings that does not tell their angles",
    ),
    "a short line": (lambda path: carmen(path, [flaser(0)[:300]]), "line 3 is no FLASER line"),
    "words": (lambda path: carmen(path, ["FLASER two 1 2 3"]), "line 3 is no FLASER line"),
}


@pytest.mark.parametrize("name", NO_LOGS)
def test_what_is_no_log_is_refused_with_its_name(name, tmp_path):
    make, message = NO_LOGS[name]
    path = make(tmp_path / "log")
    with pytest.raises(ValueError, match=message) as refused:
        read(path)
    assert str(path) in str(refused.value)


def test_a_mounting_places_the_lidar_on_the_robot(tmp_path):
    path = carmen(tmp_path / "log", lines())
    for (x, y, heading), found in zip(read(path).poses, read(path, mounting=(0.2, 0.1, math.pi)).poses, strict=True):
        turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
        assert found[:2] == pytest.approx((x, y) + turn @ (0.2, 0.1))
        assert found[2] == pytest.approx(heading + math.pi)


def test_scans_that_were_left_out_are_named_where_the_others_have_no_window(tmp_path):
    log = read(carmen(tmp_path / "log", [flaser(n, None if n < 5 else np.zeros(BEAMS)) for n in range(SCANS)]))
    with pytest.raises(ValueError, match=r"the log has 0.4 s of scans, .* \(skipped: 25 without a valid reading\)"):
        log.check_times(WINDOWS)


def test_topics_and_frames_of_a_log_that_is_no_bag_are_refused(tmp_path):
    with pytest.raises(ValueError, match="expected a bag for a topic or a frame of its poses, got CARMEN"):
        read(carmen(tmp_path / "log", lines()), scan_topic="/scan")
