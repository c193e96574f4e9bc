"""Publish a log as a robot with ROS 1 would: tf at other times than the scans, a mounted lidar, scans at 10 Hz.

Run by Debian's Python: publish.py LOG.npz SCANS
"""

import math
import sys

import numpy as np
import rospy
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

STEP_S, RANGE_MAX_M = 0.1, 30.0
MOUNT_M = 0.2  # of the lidar in front of the center of the robot


def transform(stamp, parent, child, x, y, heading):
    turn = Quaternion(z=math.sin(heading / 2), w=math.cos(heading / 2))
    moved = TransformStamped(header=Header(stamp=stamp, frame_id=parent), child_frame_id=child)
    moved.transform.translation, moved.transform.rotation = Vector3(x=x, y=y), turn
    return TFMessage([moved])


def main() -> None:
    with np.load(sys.argv[1]) as content:
        log = {name: content[name] for name in ("ranges", "angles", "poses")}
    rospy.init_node("robot")
    static = rospy.Publisher("/tf_static", TFMessage, queue_size=10, latch=True)
    moving, scans = (rospy.Publisher(*topic, queue_size=100) for topic in (("/tf", TFMessage), ("/scan", LaserScan)))
    while min(publisher.get_num_connections() for publisher in (static, moving, scans)) == 0:
        rospy.sleep(0.05)
    static.publish(transform(rospy.Time(0), "base_link", "laser", MOUNT_M, 0.0, 0.0))
    angles, rate = log["angles"], rospy.Rate(1 / STEP_S)
    start = int(rospy.get_time())
    for step in range(int(sys.argv[2])):
        for share in (-0.4, 0.1, 0.6):
            time = max(step + share, 0)
            x, y, heading = (np.interp(time, np.arange(len(log["poses"])), column) for column in log["poses"].T)
            x, y = x - MOUNT_M * math.cos(heading), y - MOUNT_M * math.sin(heading)
            moving.publish(transform(rospy.Time(start + STEP_S * time), "odom", "base_link", x, y, heading))
        scan = LaserScan(header=Header(stamp=rospy.Time(start + STEP_S * step), frame_id="laser"))
        scan.angle_min, scan.angle_max = angles[0], angles[-1]
        scan.angle_increment = (angles[-1] - angles[0]) / (len(angles) - 1)
        scan.range_min, scan.range_max, scan.ranges = 0.0, RANGE_MAX_M, log["ranges"][step]
        scans.publish(scan)
        rate.sleep()
    rospy.sleep(0.5)


if __name__ == "__main__":
    main()
