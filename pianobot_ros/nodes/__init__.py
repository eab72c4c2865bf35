"""ROS 2 nodes: thin shells around the rooms that know no ROS."""

from pianobot_ros.nodes.base.loading import begin_loading
from pianobot_ros.nodes.graph import MODULES

begin_loading(MODULES)
