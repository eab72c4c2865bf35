"""Logs as laboratories have them: any file, any names, one clean log for each joint."""

from pianobot_ros.axis.reading import listing
from pianobot_ros.axis.reading.recordings import Recording, read_log, read_recordings
from pianobot_ros.axis.reading.request import Request

__all__ = ["Recording", "Request", "listing", "read_log", "read_recordings"]
