"""The nodes of ROS 1 and ROS 2: messages in, maps as messages out."""
