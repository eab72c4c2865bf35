"""The identify line: which device this is, so that a wrong port says so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pianobot_ros.devices.serial_line.framing import PROTOCOL_VERSION, Line

__all__ = ["DEVICES", "FSR_DEVICE", "REGULATOR_DEVICE", "Identity"]

REGULATOR_DEVICE = "pianobot-vacuum"
FSR_DEVICE = "pianobot-fsr"
DEVICES: Mapping[str, str] = {REGULATOR_DEVICE: "vacuum regulator", FSR_DEVICE: "FSR reader"}
"""Identifier in the identify line to the name for humans."""


FILES: Mapping[str, str] = {REGULATOR_DEVICE: "vacuum.yaml", FSR_DEVICE: "fsr.yaml"}
"""Identifier in the identify line to the configuration file, for error messages."""


@dataclass(frozen=True)
class Identity:
    """``I`` line: ``device``, ``firmware``, ``protocol`` version, and ``features`` such as ``bits``
    or ``channels``.
    """

    device: str
    firmware: str
    protocol: int = PROTOCOL_VERSION
    features: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_line(cls, line: Line) -> Identity | None:
        """The identity in an ``I`` line; None if the line is another or malformed."""
        if line.kind != "I" or len(line.fields) < 3 or not line.fields[2].isdigit():
            return None
        pairs = (text.partition("=") for text in line.fields[3:])
        return cls(
            line.fields[0],
            line.fields[1],
            int(line.fields[2]),
            {name: value for name, _, value in pairs},
        )

    def fields(self) -> list[str]:
        """Fields of the ``I`` line."""
        return [
            self.device,
            self.firmware,
            str(self.protocol),
            *(f"{k}={v}" for k, v in self.features.items()),
        ]

    @property
    def name(self) -> str:
        """Name for humans."""
        return DEVICES.get(self.device, f"device '{self.device}'")
