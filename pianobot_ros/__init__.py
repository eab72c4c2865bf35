"""A robot-piano cell as a ROS 2 node graph with a simulated twin, and a diagnosis of the gap
between the two.
"""

__version__ = "0.2.0"
