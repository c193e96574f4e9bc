"""The node of ROS 2, the command `repro-ros2-node`: LaserScan and tf, or Odometry, to OccupancyGrid."""

import sys
from typing import Any

try:
    import rclpy
except ModuleNotFoundError as error:
    sys.exit(f"{error}: source the setup of ROS 2 first, such as /opt/ros/jazzy/setup.bash")
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from repro.ros.live_mapper import MAX_WAITING
from repro.ros.node import PARAMETERS, create_mapper
from repro.system.errors import InputError

TYPES = {kind.__name__: kind for kind in (OccupancyGrid, MapMetaData, Header, Pose, Point, Quaternion)}
# As of sensor data, but with a longer queue: an update of the map takes longer than a scan on a busy computer.
SENSOR = QoSProfile(depth=MAX_WAITING, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # what map_server and Nav2 use for maps
STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
POSES = QoSProfile(depth=1000)


class MapPrediction(Node):
    """The node.

    Raises:
        InputError: a parameter has no value that it can have.
        ParameterException: it has another type.
    """

    def __init__(self) -> None:
        super().__init__("map_prediction")
        values = {name: self._declare(name) for name in PARAMETERS}
        publisher = self.create_publisher(OccupancyGrid, "predicted_map", LATCHED)
        mapper = create_mapper(values, TYPES, publisher.publish, self.get_logger().warning)
        if values["odometry"]:
            self.create_subscription(Odometry, "odom", mapper.add_odometry, POSES)
        else:
            self.create_subscription(TFMessage, "/tf", mapper.add_transforms, POSES)
        self.create_subscription(
            TFMessage, "/tf_static", lambda message: mapper.add_transforms(message, is_static=True), STATIC
        )
        scans = self.create_subscription(LaserScan, values["scan_topic"], mapper.add_scan, SENSOR)
        self.get_logger().info(f"waiting for scans on {scans.topic_name}")

    def _declare(self, name: str) -> Any:
        """Declare a parameter and return its value."""
        default, description = PARAMETERS[name]
        is_text = isinstance(default, str)  # which may be a list of numbers
        descriptor = ParameterDescriptor(description=description, read_only=True, dynamic_typing=is_text)
        return self.declare_parameter(name, default, descriptor).value


def main() -> None:
    rclpy.init()
    try:
        rclpy.spin(MapPrediction())
    except (InputError, ParameterException) as error:
        sys.exit(f"map_prediction: {error}")
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
