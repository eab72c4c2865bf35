"""The force sensor on one key, with the optional key encoder, on a serial port."""

from pianobot_ros.devices.device_clock import DeviceClock
from pianobot_ros.devices.fsr.calibration import FsrCalibration
from pianobot_ros.devices.fsr.config import EncoderConfig, FsrConfig, SensorConfig
from pianobot_ros.devices.fsr.driver import FsrDriver, FsrReading

__all__ = [
    "DeviceClock",
    "EncoderConfig",
    "FsrCalibration",
    "FsrConfig",
    "FsrDriver",
    "FsrReading",
    "SensorConfig",
]
