"""A ROS 2 robot is recorded to a bag while the node maps its scans; its maps are those of the batch: make test-ros2."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from repro.logs.formats import read_log
from repro.logs.messages import seconds
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.networks.predictor import load_predictor
from repro.prediction.stream_map import predict_map
from repro.prediction.windows import cut
from repro.ros.map_message import occupancy

if "REPRO_ROS2" not in os.environ:
    pytest.skip("needs ROS 2: make test-ros2", allow_module_level=True)

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)  # of this run alone
import rclpy
from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from robot import messages, mounting
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:module .sre_:DeprecationWarning")]  # of its parser
NODE = str(Path(sys.executable).with_name("repro-ros2-node"))
EXAMPLE = ROOT / "examples" / "rooms.npz"
SCANS, STEPS = 150, 100
TF = "tf2_msgs/msg/TFMessage"
START_S = 1_700_000_000
SENSOR = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@contextmanager
def started(command: list[str], environment: dict[str, str], ready: str) -> Iterator[Path]:
    """Run a program until the end of the block, from when it prints a text; return its output."""
    end, log = time.monotonic() + 60, Path(environment["ROS_HOME"]) / f"{Path(command[0]).name}.log"
    with log.open("w") as output:
        process = subprocess.Popen(
            command, env=environment, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            while ready not in log.read_text(errors="replace"):
                assert process.poll() is None, log.read_text(errors="replace")
                assert time.monotonic() < end, f"{command} is not ready: {log.read_text(errors='replace')}"
                time.sleep(0.1)
            yield log
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def batch_maps(log: ScanLog) -> dict[float, np.ndarray]:
    """Return the data of the OccupancyGrid of every window of a log by its time [s]."""
    predictor = load_predictor("rooms")
    windows = list(cut(log, WindowSettings((12.5, 12.5), STEPS), 0.1, 25.0))
    assert len(windows) == len(log) - STEPS + 1
    maps = (predict_map(predictor, window.scans, window.origin, window.stamp) for window in windows)
    return {found.stamp: occupancy(found.free, unknown=found.unknown) for found in maps}


def check_maps(received: Sequence[Any], maps: dict[float, np.ndarray], output: str) -> None:
    """Check that the OccupancyGrids of a node, which printed an output, are the maps of the batch."""
    assert "skipped" not in output, output
    assert [seconds(grid.header.stamp) for grid in received] == pytest.approx(list(maps), abs=1e-6), output
    for grid, data in zip(received, maps.values(), strict=True):
        assert np.array_equal(grid.data, data)
        assert grid.header.frame_id == "odom"
        assert (grid.info.width, grid.info.height) == (128, 128)
        assert grid.info.resolution == pytest.approx(25 / 128)
        assert (grid.info.origin.position.x, grid.info.origin.position.y) == (0, 0)
        assert grid.info.origin.orientation.w == 1


def stamp(since_start_s: float) -> Time:
    seconds, nanoseconds = divmod(round(since_start_s * 1e9), 10**9)
    return Time(sec=START_S + seconds, nanosec=nanoseconds)


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Return the maps of the batch from a bag of the messages, as ROS 2 serializes them."""
    path, store = tmp_path_factory.mktemp("bag") / "robot", get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {"/scan": "sensor_msgs/msg/LaserScan", "/tf": TF, "/tf_static": TF}
        topics = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        writer.write(topics["/tf_static"], 0, serialize_message(mounting(stamp(0))))
        for since_start_s, message in messages(EXAMPLE, SCANS, stamp):
            topic = "/scan" if isinstance(message, LaserScan) else "/tf"
            writer.write(topics[topic], round((1 + since_start_s) * 1e9), serialize_message(message))
    return batch_maps(read_log(path, WindowSettings()))


class Robot:
    """Publishes the messages of a robot, and receives the maps."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("robot")
        self.static = self.node.create_publisher(TFMessage, "/tf_static", LATCHED)
        self.scans = self.node.create_publisher(LaserScan, "/scan", SENSOR)
        self.poses = self.node.create_publisher(TFMessage, "/tf", 1000)
        self.maps: list[OccupancyGrid] = []
        self.node.create_subscription(OccupancyGrid, "predicted_map", self.maps.append, LATCHED)

    def drive(self, late_s: float) -> None:
        """Publish scans at 10 Hz and tf at 50 Hz, some seconds later than the scans [s]; at first four times as fast.

        No map ends with the first scans: they fill the window.
        """
        while min(publisher.get_subscription_count() for publisher in (self.static, self.scans, self.poses)) == 0:
            time.sleep(0.05)
        time.sleep(1)  # the node may find the publishers later than they find it; what it has not found is lost
        self.static.publish(mounting(stamp(0)))
        due = [
            (at + late_s * isinstance(message, TFMessage), message) for at, message in messages(EXAMPLE, SCANS, stamp)
        ]
        start = time.monotonic()
        for at, message in sorted(due, key=lambda event: event[0]):
            time.sleep(max(start + at - 0.75 * min(at, 9.0) - time.monotonic(), 0))
            (self.scans if isinstance(message, LaserScan) else self.poses).publish(message)


@pytest.fixture
def robot():
    rclpy.init()
    robot, executor = Robot(), SingleThreadedExecutor()
    executor.add_node(robot.node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield robot
    executor.shutdown()
    thread.join()
    rclpy.shutdown()


@contextmanager
def busy(processes: int):
    """Keep cores busy until the end of the block."""
    with ExitStack() as stack:
        for _ in range(processes):
            process = stack.enter_context(subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]))
            stack.callback(process.kill)
        yield


@pytest.mark.parametrize(("processes", "late_s"), [(0, 0.0), (2 * (os.cpu_count() or 1), 0.0), (0, 6.0)])
def test_the_maps_of_the_node_are_those_of_the_batch(robot, maps, tmp_path, processes, late_s):
    """Idle, under load, and with transforms that are later than the scans."""
    environment = os.environ | {"ROS_HOME": str(tmp_path), "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1"}
    command = [NODE, "--ros-args", "-p", "center:=12.5,12.5", "-p", "weights:=rooms"]
    with started(command, environment, "waiting for scans") as output, busy(processes):
        robot.drive(late_s)
        end = time.monotonic() + 30
        while len(robot.maps) < len(maps) and time.monotonic() < end:
            time.sleep(0.1)
        check_maps(robot.maps, maps, output.read_text())


@pytest.mark.parametrize(
    ("parameter", "message"),
    [("steps:=20000", "steps"), ("mounting:=1,2", "mounting=1,2: must be [x,y,heading] in meters and radians")],
)
def test_wrong_parameters_end_the_node_with_a_message(parameter, message):
    done = subprocess.run([NODE, "--ros-args", "-p", parameter], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr, done.stderr


def test_the_package_is_built_by_colcon_and_its_node_takes_the_parameter_file(tmp_path):
    shutil.copytree(ROOT / "ros" / "repro_ros", tmp_path / "src" / "repro_ros")
    build = [sys.executable, "-m", "colcon", "build"]
    subprocess.run(build, cwd=tmp_path, check=True, capture_output=True, timeout=300)
    package = tmp_path / "install" / "repro_ros"
    parameters = package / "share" / "repro_ros" / "config" / "map_prediction.yaml"
    assert (package / "share" / "repro_ros" / "launch" / "map_prediction.launch.py").is_file()
    command = [str(package / "lib" / "repro_ros" / "map_prediction"), "--ros-args", "--params-file", str(parameters)]
    paths = os.pathsep.join([*map(str, package.glob("lib/python*/site-packages")), *sys.path])  # as of setup.bash
    environment = os.environ | {"ROS_HOME": str(tmp_path), "PYTHONUNBUFFERED": "1", "PYTHONPATH": paths}
    with started(command, environment, "waiting for scans"):
        pass
