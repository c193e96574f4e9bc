"""Bags of ROS 1 and ROS 2, written by rosbags."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from log_files import POSES, SCANS, STAMPS, bag, expect, npz, read
from rosbags.rosbag2 import StoragePlugin


@pytest.mark.parametrize(("poses", "topic"), [("tf", None), ("odometry", None), ("conflict", None), ("both", "/odom")])
def test_ros1_bags(poses, topic, tmp_path):
    """Named odometry replaces the transforms but not the mounting; it may be of a frame that has a static parent."""
    expect(read(bag(tmp_path / "log.bag", 1, poses=poses), odometry_topic=topic), atol=2e-3)


@pytest.mark.parametrize("poses", ["tf", "odometry"])
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_ros2_bags(poses, storage, tmp_path):
    directory = bag(tmp_path / "log", 2, poses=poses, storage=storage)
    expect(read(directory), atol=2e-3)
    (file,) = (path for path in directory.iterdir() if path.suffix != ".yaml")
    expect(read(file), atol=2e-3)


def test_a_lidar_whose_mounting_is_not_known_is_refused(tmp_path, caplog):
    path = bag(tmp_path / "log.bag", 1, poses="odometry", is_mounted=False)
    with pytest.raises(ValueError, match=r"0 scans can be used \(30 without a pose\)"):
        read(path)
    assert caplog.text.count("no transform of laser: set prediction.mounting, of a node mounting, to x,y,heading") == 1
    expect(read(path, mounting=(0.0, 0.0, 0.0)), atol=2e-3)


def test_topics_are_named_when_they_are_missing(tmp_path):
    path = bag(tmp_path / "log.bag", 1, poses="tf")
    with pytest.raises(ValueError, match=r"no messages on /front .*there are /scan"):
        read(path, scan_topic="/front")
    with pytest.raises(ValueError, match=r"no messages on /odom .*there are none"):
        read(path, odometry_topic="/odom")


def test_a_lidar_that_stands_needs_no_poses(tmp_path):
    pose = (1.0, 2.0, 0.5)
    log = read(bag(tmp_path / "log.bag", 1, poses="none"), pose=pose)
    assert log.stamps == pytest.approx(STAMPS, abs=1e-6)
    assert log.poses == pytest.approx(np.tile(pose, (SCANS, 1)))
    arrays = npz(tmp_path / "log.npz", poses=None)
    with pytest.raises(ValueError, match=r"lacks poses: .* For a lidar that stands, set prediction.pose=fixed"):
        read(arrays)
    assert read(arrays, pose=pose).poses == pytest.approx(log.poses)
    assert read(arrays, pose=(1, 2, 3)).poses.dtype == float  # of whole numbers, as those of other logs


def test_a_mounting_replaces_that_of_a_bag(tmp_path):
    path = bag(tmp_path / "log.bag", 1, poses="tf")
    expect(read(path, mounting=(0.2, 0.0, 0.0)), atol=2e-3)
    turned = read(path, mounting=(0.2, 0.0, 1.0))
    assert turned.poses == pytest.approx(POSES + np.array([0, 0, 1]), abs=2e-3)


def test_a_bag_of_which_messages_are_lost_is_refused(tmp_path):
    """As on a disk with a bad block; rosbags passes over zeros."""
    (path,) = bag(tmp_path / "log", 2, poses="tf").glob("*.mcap")
    data = path.read_bytes()
    middle = len(data) // 2
    path.write_bytes(data[:middle] + bytes(1000) + data[middle + 1000 :])
    with pytest.raises(ValueError, match=r"the bag is damaged: \d+ of 30 messages on /scan can be read; repair it"):
        read(path)


def test_a_database_whose_last_messages_are_in_its_log_is_refused_until_it_has_them(tmp_path):
    """As after a recorder was killed."""
    directory = bag(tmp_path / "log", 2, poses="tf", storage=StoragePlugin.SQLITE3)
    (path,) = directory.glob("*.db3")
    recorder = sqlite3.connect(path)
    recorder.execute("PRAGMA journal_mode=WAL")
    recorder.execute("UPDATE messages SET timestamp=timestamp")
    recorder.commit()
    killed = Path(shutil.copytree(directory, tmp_path / "killed"))
    recorder.close()
    for given in (killed, killed / path.name):
        with pytest.raises(ValueError, match=r"db3-wal, .* was killed: move them into it with sqlite3 .*'PRAGMA wal"):
            read(given)
    with closing(sqlite3.connect(killed / path.name)) as repaired:
        repaired.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    expect(read(killed), atol=2e-3)
