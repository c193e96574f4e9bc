"""Publish a log as a robot with ROS 1 would; run by Debian's Python: publish.py LOG.npz SCANS."""

import sys

import rospy
from robot import messages, mounting
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage


def main() -> None:
    rospy.init_node("robot")
    static = rospy.Publisher("/tf_static", TFMessage, queue_size=10, latch=True)
    topics = {LaserScan: "/scan", TFMessage: "/tf"}
    moving = {kind: rospy.Publisher(topic, kind, queue_size=100) for kind, topic in topics.items()}
    while min(publisher.get_num_connections() for publisher in (static, *moving.values())) == 0:
        rospy.sleep(0.05)
    static.publish(mounting(rospy.Time(0)))
    start = int(rospy.get_time()) + 1
    for time, message in messages(sys.argv[1], int(sys.argv[2]), lambda time: rospy.Time(start + time)):
        rospy.sleep(start + time - rospy.get_time())
        moving[type(message)].publish(message)
    rospy.sleep(0.5)


if __name__ == "__main__":
    main()
