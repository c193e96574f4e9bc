"""Predicted maps in ROS 2: subscribes to LaserScan and tf (or Odometry), publishes nav_msgs/OccupancyGrid.

python3 examples/ros2_node.py --ros-args -r scan:=/base_scan

Topics: scan, /tf_static, /tf or odom; predicted_map. Parameters: weights, odometry (true reads odom instead of tf),
center (robot, or x,y in the frame of the poses [m]), steps, step_s, range_max_m (maximum range of the lidar [m]; by
default that of the scans), threads, undecided (low,high: probabilities of an obstacle between these are unknown, -1).
Python must find both ROS 2 and this project.
"""

import array

import rclpy
import torch
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from repro.networks.predictor import load_predictor
from repro.prediction.live import LiveMapper, two_numbers
from repro.prediction.ros import grid_message, occupancy
from repro.prediction.times import window_of

TYPES = {kind.__name__: kind for kind in (OccupancyGrid, MapMetaData, Header, Pose, Point, Quaternion)}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # what map_server and nav2 use for maps


class MapPrediction(Node):
    """The node."""

    def __init__(self) -> None:
        super().__init__("map_prediction")
        torch.set_num_threads(self.value("threads", 1))
        center = self.value("center", "robot")
        self.undecided = two_numbers(self.value("undecided", ""))
        self.publisher = self.create_publisher(OccupancyGrid, "predicted_map", LATCHED)
        predictor = load_predictor(self.value("weights", "rooms"))
        settings = window_of(
            predictor,
            center="robot" if center == "robot" else two_numbers(center),
            steps=self.value("steps", 0) or None,
            step_s=self.value("step_s", 0.0) or None,
            range_max_m=self.value("range_max_m", 0.0) or None,
        )
        mapper = LiveMapper(predictor, self.publish, self.get_logger().warning, settings)
        if self.value("odometry", False):
            self.create_subscription(Odometry, "odom", mapper.add_odometry, 100)
        else:
            self.create_subscription(TFMessage, "/tf", mapper.add_transforms, 100)
        static = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(
            TFMessage, "/tf_static", lambda message: mapper.add_transforms(message, is_static=True), static
        )
        self.create_subscription(LaserScan, "scan", mapper.add_scan, qos_profile_sensor_data)

    def value(self, name, default):
        """Declare a parameter and return its value."""
        return self.declare_parameter(name, default).value

    def publish(self, header, frame, predicted) -> None:
        data = array.array("b", occupancy(predicted.free, self.undecided, predicted.unknown).tobytes())
        self.publisher.publish(grid_message(TYPES, data, predicted, header.stamp, frame))


def main() -> None:
    rclpy.init()
    node = MapPrediction()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
