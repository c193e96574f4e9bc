"""Predicted maps in ROS 1: subscribes to LaserScan and tf (or Odometry), publishes nav_msgs/OccupancyGrid.

PYTHONPATH=src:.venv/lib/python3.11/site-packages python3 examples/ros1_node.py scan:=/base_scan _frame:=odom

The parameters are those of `repro.ros.node`. The Python of ROS 1 must be that of .venv: it needs rospy and this
project. Debian 12 has ROS 1 for Python 3.11: apt-get install python3-rospy.
"""

import sys

import rospy
from geometry_msgs.msg import Point, Pose, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from repro.ros.live_mapper import MAX_WAITING
from repro.ros.node import PARAMETERS, create_mapper
from repro.system.errors import InputError

TYPES = {kind.__name__: kind for kind in (OccupancyGrid, MapMetaData, Header, Pose, Point, Quaternion)}


def main() -> None:
    rospy.init_node("map_prediction")
    values = {name: rospy.get_param(f"~{name}", default) for name, (default, _) in PARAMETERS.items()}
    publisher = rospy.Publisher("predicted_map", OccupancyGrid, queue_size=10, latch=True)
    try:
        mapper = create_mapper(values, TYPES, publisher.publish, rospy.logwarn)
    except InputError as error:
        sys.exit(f"map_prediction: {error}")
    if values["odometry"]:
        rospy.Subscriber("odom", Odometry, mapper.add_odometry)
    else:
        rospy.Subscriber("/tf", TFMessage, mapper.add_transforms)
    rospy.Subscriber("/tf_static", TFMessage, lambda message: mapper.add_transforms(message, is_static=True))
    scans = rospy.Subscriber(values["scan_topic"], LaserScan, mapper.add_scan, queue_size=MAX_WAITING)
    rospy.loginfo("waiting for scans on %s", scans.resolved_name)
    rospy.spin()


if __name__ == "__main__":
    main()
