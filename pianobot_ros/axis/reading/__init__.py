"""Logs as laboratories have them: any file, any names, one clean log for each joint."""

from pianobot_ros.axis.reading import listing
from pianobot_ros.axis.reading.recordings import RobotRun, read_log, read_recordings
from pianobot_ros.axis.reading.request import Request

__all__ = ["Request", "RobotRun", "listing", "read_log", "read_recordings"]
