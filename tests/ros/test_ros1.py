"""A bag recorded by ROS 1 is read, and played to the node, whose maps are those of the batch: make test-ros."""

import os
import shutil
import socket
import subprocess
import sys
import sysconfig
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from programs import EXAMPLE, batch_maps, check_maps, started, wait_for
from rosbags.highlevel import AnyReader

from repro.logs.formats import read_log
from repro.logs.options import WindowSettings

DEBIAN = "/usr/bin/python3"  # the Python of rospy
SCANS = 120
SPEED = 0.5  # at which the bag is played: the tests may share their cores


def reason_to_skip() -> str:
    if shutil.which("roscore") is None:
        packages = "ros-core python3-rospy python3-rosbag python3-{sensor,nav,geometry,tf2}-msgs"
        return f"needs ROS 1: apt-get install {packages} (Debian 12)"
    version = "import sys; print(*sys.version_info[:2])"
    of_ros, ours = (subprocess.check_output([python, "-c", version], text=True) for python in (DEBIAN, sys.executable))
    return "" if of_ros == ours else f"rospy has Python {of_ros.strip()}, the environment {ours.strip()}"


REASON = reason_to_skip()
pytestmark = [pytest.mark.slow]
if "REPRO_ROS" not in os.environ:  # make test-ros fails where ROS is missing
    pytestmark.append(pytest.mark.skipif(bool(REASON), reason=REASON))


@pytest.fixture(scope="module")
def ros(tmp_path_factory):
    """Start a roscore on a free port and return the environment of its nodes."""
    assert not REASON, REASON
    home = tmp_path_factory.mktemp("ros")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environment = os.environ | {
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "ROS_HOME": str(home),
        "PYTHONPATH": f"{ROOT / 'src'}:{sysconfig.get_path('purelib')}",
        "PYTHONUNBUFFERED": "1",
        "OMP_NUM_THREADS": "1",
    }
    with started(["roscore", "-p", str(port)], environment, "started core service"):
        yield environment


@contextmanager
def record(path: Path, topics: list[str], environment: dict[str, str], most: int = 0):
    """Record topics to a bag until the end of the block, or until each has so many messages."""
    command = ["rosbag", "record", "-l", str(most), "-O", str(path), *topics]
    with started(command, environment, path.with_suffix(".bag.active")) as output:
        yield output
    wait_for(path, output)  # rosbag may end before its recorder has closed the bag


@pytest.fixture(scope="module")
def bag(ros, tmp_path_factory):
    """Record a bag by `rosbag record`."""
    path = tmp_path_factory.mktemp("bag") / "robot.bag"
    with record(path, ["/scan", "/tf", "/tf_static"], ros):
        command = [DEBIAN, str(ROOT / "tests" / "ros" / "publish.py"), str(EXAMPLE), str(SCANS)]
        subprocess.run(command, env=ros, check=True, timeout=120)
    return path


@pytest.fixture(scope="module")
def log(bag):
    return read_log(bag, WindowSettings())


def test_a_recorded_bag_is_read(log):
    with np.load(EXAMPLE) as content:
        assert len(log) == SCANS
        assert log.stamps - log.stamps[0] == pytest.approx(0.1 * np.arange(SCANS), abs=1e-6)
        assert log.poses == pytest.approx(content["poses"][:SCANS], abs=0.06)  # turns of 18 degrees between two poses
        expected = content["ranges"][:SCANS]
        assert np.array_equal(np.isfinite(log.ranges), np.isfinite(expected))


def test_the_maps_of_the_node_are_those_of_the_batch(bag, log, ros):
    maps = bag.with_name("maps.bag")
    node = [DEBIAN, str(ROOT / "examples" / "ros1_node.py"), "_center:=12.5,12.5", "_weights:=rooms"]
    play = ["rosbag", "play", "-q", "-d", "1", "-r", str(SPEED), str(bag)]
    expected = batch_maps(log)
    with (
        started(node, ros, "waiting for scans", "node") as output,
        record(maps, ["/predicted_map"], ros, most=len(expected)),
    ):
        subprocess.run(play, env=ros, check=True, timeout=120)
        wait_for(maps, output)  # the recorder ends with the last map
    with AnyReader([maps]) as reader:
        received = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]
    check_maps(received, expected, output.read_text())
