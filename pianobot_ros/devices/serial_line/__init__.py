"""The line protocol of the cell's serial devices: framing, parser, and a link that identifies and
reconnects.
"""

from pianobot_ros.devices.serial_line.framing import (
    MAX_LINE,
    PROTOCOL_VERSION,
    SEQUENCE_SPAN,
    Line,
    LineParser,
    LineStatistics,
    crc16,
    encode,
)
from pianobot_ros.devices.serial_line.identity import (
    DEVICES,
    FSR_DEVICE,
    REGULATOR_DEVICE,
    Identity,
)
from pianobot_ros.devices.serial_line.link import SerialLink
from pianobot_ros.devices.serial_line.opening import LinkConfig

__all__ = [
    "DEVICES",
    "FSR_DEVICE",
    "MAX_LINE",
    "PROTOCOL_VERSION",
    "REGULATOR_DEVICE",
    "SEQUENCE_SPAN",
    "Identity",
    "Line",
    "LineParser",
    "LineStatistics",
    "LinkConfig",
    "SerialLink",
    "crc16",
    "encode",
]
