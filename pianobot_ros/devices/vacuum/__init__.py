"""The vacuum regulator: three channels on a serial port."""

from pianobot_ros.devices.vacuum.config import RegulatorConfig
from pianobot_ros.devices.vacuum.driver import RegulatorDriver, VacuumReading, VacuumSetpoint

__all__ = ["RegulatorConfig", "RegulatorDriver", "VacuumReading", "VacuumSetpoint"]
