"""Bag files without a ROS graph: rosbag2 MCAP into a
:class:`~pianobot_ros.cell.recordings.recording.Recording` and back.
"""
