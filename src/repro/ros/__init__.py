"""The node of ROS 2: messages in, maps as messages out."""
