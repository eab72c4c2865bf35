"""ROS 2 nodes: thin shells around the rooms that know no ROS."""
