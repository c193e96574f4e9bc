"""Predicted maps in ROS 1: subscribes to LaserScan and tf (or Odometry), publishes nav_msgs/OccupancyGrid.

PYTHONPATH=src:.venv/lib/python3.11/site-packages python3 examples/ros1_node.py scan:=/base_scan

Topics: scan, /tf_static, /tf or odom; predicted_map. Parameters: ~weights, ~odometry (true reads odom instead of tf),
~center (robot, or x,y in the frame of the poses [m]), ~steps, ~step_s, ~range_max_m (maximum range of the lidar [m]; by
default that of the scans), ~threads, ~undecided (low,high: probabilities of an obstacle between these are unknown, -1).
Debian 12 has ROS 1 for Python 3.11: apt install ros-core python3-rospy.
"""

import rospy
import torch
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from repro.networks.predictor import load_predictor
from repro.prediction.live import MAX_WAITING, LiveMapper, two_numbers
from repro.prediction.ros import grid_message, occupancy
from repro.prediction.times import window_of

TYPES = {kind.__name__: kind for kind in (OccupancyGrid, MapMetaData, Header, Pose, Point, Quaternion)}


def main() -> None:
    rospy.init_node("map_prediction")
    torch.set_num_threads(rospy.get_param("~threads", 1))
    center = rospy.get_param("~center", "robot")
    undecided = two_numbers(rospy.get_param("~undecided", ""))
    publisher = rospy.Publisher("predicted_map", OccupancyGrid, queue_size=10, latch=True)

    def publish(header, frame, predicted) -> None:
        data = occupancy(predicted.free, undecided, predicted.unknown)
        publisher.publish(grid_message(TYPES, data, predicted, header.stamp, frame))

    predictor = load_predictor(rospy.get_param("~weights", "rooms"))
    settings = window_of(
        predictor,
        center="robot" if center == "robot" else two_numbers(center),
        steps=rospy.get_param("~steps", None),
        step_s=rospy.get_param("~step_s", None),
        range_max_m=rospy.get_param("~range_max_m", None),
    )
    mapper = LiveMapper(predictor, publish, rospy.logwarn, settings)
    if rospy.get_param("~odometry", False):
        rospy.Subscriber("odom", Odometry, mapper.add_odometry)
    else:
        rospy.Subscriber("/tf", TFMessage, mapper.add_transforms)
    rospy.Subscriber("/tf_static", TFMessage, lambda message: mapper.add_transforms(message, is_static=True))
    rospy.Subscriber("scan", LaserScan, mapper.add_scan, queue_size=MAX_WAITING)
    rospy.loginfo("waiting for scans on %s", rospy.resolve_name("scan"))
    rospy.spin()


if __name__ == "__main__":
    main()
