"""ROS 2 nodes: thin shells around the rooms that know no ROS."""

from pianobot_ros.nodes.base.loading import end_silently_while_loading
from pianobot_ros.nodes.graph import NODES

end_silently_while_loading([spec.name for spec in NODES])
