"""Bags of ROS 1 and ROS 2, written by rosbags."""

import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from log_files import ANGLES, POSES, RANGES, SCANS, STAMPS, WINDOWS, bag, expect, npz, read
from messages import Ros
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from repro.logs.formats import read_log


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


def robots(path: Path, namespaces=("/robot1", "/robot2"), clock=(0.0,), kind="odometry", other=(), rear=None) -> Path:
    """Write a ROS 2 bag of robots with equal frames, of which the second drives elsewhere, or of runs of one."""
    ros = Ros(2)
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics: dict[str, object] = {}

        def write(topic: str, ns: int, message) -> None:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=ros.store)
            writer.write(topics[topic], ns, ros.serialized(message))

        for number, name in enumerate(namespaces):
            write(f"{name}/tf_static", 0, ros.transform(0, "base_link", "laser", (0.0, 0, 0)))
            if rear is not None:
                write(f"{name}/tf_static", 0, ros.transform(0, "base_link", "rear", (0.0, 0, rear)))
            for run, start in enumerate(clock):
                for step in range(SCANS):
                    place = POSES[step] + np.array([7.0 * number + 3 * run, 0, 0])
                    stamp, ns = start + 0.1 * step, round(1e9 * (1000 * run + 0.1 * step)) + number
                    if kind == "odometry":
                        write(f"{name}/odom", ns, ros.odometry(stamp, place, "base_link"))
                    elif kind == "tf":
                        write(f"{name}/tf", ns, ros.transform(stamp, "odom", "base_link", place))
                    else:
                        write(f"{name}/{kind}", ns, ros.stamped(kind, stamp, place))
                    scan = ros.scan(stamp, ANGLES, RANGES[step], range_max=81.0)
                    scan.header.frame_id = "laser" if rear is None or step % 2 else "rear"
                    write(f"{name}/scan", ns, scan)
        for topic, message in other:
            write(topic, 0, message)
    return path


@pytest.mark.parametrize("kind", ["odometry", "tf"])
@pytest.mark.parametrize("number", [0, 1])
def test_poses_are_of_the_robot_of_the_scans(kind, number, tmp_path, caplog):
    path = robots(tmp_path / "log", kind=kind)
    log = read(path, scan_topic=f"/robot{number + 1}/scan")
    assert log.poses == pytest.approx(POSES + np.array([7.0 * number, 0, 0]), abs=1e-5)
    assert f"/robot{2 - number}/" in caplog.text


def test_a_namespace_is_needed_by_none_but_those_who_have_one(tmp_path):
    path = robots(tmp_path / "log", namespaces=("", "/robot2"), kind="tf")
    assert read(path, scan_topic="/scan").poses == pytest.approx(POSES, abs=1e-5)


@pytest.mark.parametrize("kind", ["odometry", "tf"])
def test_a_bag_in_which_the_clock_was_set_back_has_two_runs(kind, tmp_path, caplog):
    log = read(robots(tmp_path / "log", ("",), clock=(100.0, 90.0), kind=kind))
    assert log.poses == pytest.approx(np.concatenate([POSES, POSES + np.array([3.0, 0, 0])]), abs=1e-5)
    assert "the clock was set back 1 times" in caplog.text


def test_two_lidars_may_share_a_topic(tmp_path, caplog):
    log = read(robots(tmp_path / "log", ("",), rear=3.0))
    turned = POSES[:, 2] + np.where(np.arange(SCANS) % 2, 0.0, 3.0)
    assert np.exp(1j * log.poses[:, 2]) == pytest.approx(np.exp(1j * turned), abs=1e-4)
    assert "/scan has scans of several lidars, rear, laser" in caplog.text


@pytest.mark.parametrize("kind", ["PoseStamped", "PoseWithCovarianceStamped"])
def test_stamped_poses_stand_in_where_nothing_else_moves(kind, tmp_path):
    assert read(robots(tmp_path / "log", ("",), kind=kind)).poses == pytest.approx(POSES, abs=1e-5)


def test_scans_and_poses_may_be_in_two_bags(tmp_path):
    whole = bag(tmp_path / "log", 2, poses="tf")
    parts = []
    with AnyReader([whole], default_typestore=Ros(2).store) as reader:
        for name in ("scan", "tf"):
            with Writer2(tmp_path / name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
                for connection in reader.connections:
                    if name in connection.topic:
                        made = writer.add_connection(connection.topic, connection.msgtype, typestore=Ros(2).store)
                        for _, ns, raw in reader.messages([connection]):
                            writer.write(made, ns, raw)
            parts.append(tmp_path / name)
    with pytest.raises(ValueError, match=r"no poses: .* name both: scans=\[a.bag,b.bag\]"):
        read(parts[0])
    with pytest.raises(ValueError, match=r"no messages of sensor_msgs/msg/LaserScan; .* name both: scans="):
        read(parts[1])
    expect(read_log(parts[0], WINDOWS, others=[parts[1]]), atol=2e-3)
    with pytest.raises(ValueError, match=r"log\.npz: expected the files of one log, all of the kind bag"):
        read_log(parts[0], WINDOWS, others=[npz(tmp_path / "log.npz")])


def test_an_mcap_needs_no_profile_and_may_have_channels_that_are_none_of_ros(tmp_path, monkeypatch):
    from rosbags.rosbag2 import storage_mcap

    write_string, write_schema = storage_mcap.write_string, storage_mcap.write_schema
    monkeypatch.setattr(
        storage_mcap, "write_string", lambda out, text: write_string(out, "" if text == "ros2" else text)
    )

    def schema_of(out, schema) -> None:
        is_other = schema.name == "std_msgs/msg/String"
        write_schema(out, schema._replace(encoding="jsonschema") if is_other else schema)

    monkeypatch.setattr(storage_mcap, "write_schema", schema_of)
    other = [("/battery", Ros(2).types["String"]("{}"))]
    (path,) = robots(tmp_path / "log", ("",), kind="tf", other=other).glob("*.mcap")
    data = path.read_bytes()
    assert b"jsonschema" in data
    assert not data[17]
    assert read(path).poses == pytest.approx(POSES, abs=1e-5)


@pytest.mark.parametrize("file", ["metadata.yaml", "more.mcap"])
def test_a_pipe_in_the_directory_of_a_bag_is_refused(file, tmp_path):
    directory = bag(tmp_path / "log", 2, poses="tf")
    (directory / file).unlink(missing_ok=True)
    os.mkfifo(directory / file)
    with pytest.raises(ValueError, match=rf"{file}: expected a regular file"):
        read(directory)


@pytest.mark.parametrize(
    ("content", "problem"), [(b"a: &x [1]\nb: *x\n", "has aliases"), (b"#" * 2**23, "has more than")]
)
def test_metadata_that_would_fill_the_memory_are_refused(content, problem, tmp_path):
    directory = bag(tmp_path / "log", 2, poses="tf")
    with (directory / "metadata.yaml").open("ab") as file:
        file.write(content)
    with pytest.raises(ValueError, match=rf"metadata.yaml: {problem}"):
        read(directory)


def test_names_of_others_do_not_control_the_terminal(tmp_path, caplog):
    other = [("/tf_static", Ros(2).transform(0, "base_link", "laser\x1b[2J", (place, 0, 0))) for place in (1.0, 2.0)]
    read(robots(tmp_path / "log", ("",), other=other))
    assert r"laser\x1b[2J has several static poses" in caplog.text
    assert "\x1b" not in caplog.text
