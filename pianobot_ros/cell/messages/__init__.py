"""The graph's messages as the rest of the package sees them: one decoder for each.

Everything here looks at fields only, so it reads what rclpy delivers, what rosbags reads from a
recording, and anything else of the same shape; nothing here needs ROS. A number that cannot be what
the field says is refused where it commands, and dropped and counted where it was measured
(``docs/graph.md``).
"""
