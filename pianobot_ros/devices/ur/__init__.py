"""The UR5 arm: a driver around the client library ``ur_rtde``, which runs in a process of its own."""

from pianobot_ros.devices.ur.config import UrConfig, load_config
from pianobot_ros.devices.ur.driver import UrDriver
from pianobot_ros.devices.ur.types import SafetyState, WristReading, WristSetpoint

__all__ = ["SafetyState", "UrConfig", "UrDriver", "WristReading", "WristSetpoint", "load_config"]
