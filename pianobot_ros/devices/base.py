"""The one small protocol that every device driver speaks, real or emulated.

A driver owns a link to one device. It validates and clips what it is told to send and says what it
really sent; it never blocks the caller on the link; and its health is judged by the age of what the
device sent, not by return values.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar, runtime_checkable

from pianobot_ros.cell.errors import CommandRejectedError, DeviceError
from pianobot_ros.cell.numbers.config import Section, load_section

__all__ = [
    "CommandRejectedError",
    "Device",
    "DeviceConfig",
    "DeviceError",
    "DeviceUnavailableError",
    "Health",
    "HealthLevel",
]

CommandT = TypeVar("CommandT")
ConfigT = TypeVar("ConfigT", bound="DeviceConfig")
StateT_co = TypeVar("StateT_co", covariant=True)


class DeviceConfig(Section):
    """The configuration file of a device, which is called as its package is."""

    @classmethod
    def file(cls) -> str:
        """The file's name."""
        return f"{cls.__module__.split('.')[-2]}.yaml"

    @classmethod
    def load(cls: type[ConfigT], path: str | Path = "") -> ConfigT:
        """The file ``path``, or the device's in the configuration directory. Raises ConfigError in
        one line.
        """
        return load_section(path or cls.file(), cls)


class DeviceUnavailableError(DeviceError):
    """The device cannot be reached: wrong address or port, refused, unplugged, or silent."""


class HealthLevel(enum.IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus, with the same numbers."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Health:
    """How a device is doing.

    Attributes:
        level: OK, WARN (works, but something was clipped, lost or degraded), ERROR (does not work),
            STALE (nothing arrives).
        message: one line for a human.
        age_s: age of the newest data from the device, seconds; infinite if there was none.
        values: counters and readings for diagnostics.
    """

    level: HealthLevel
    message: str
    age_s: float = float("inf")
    values: Mapping[str, float | int | str] = field(default_factory=dict)


@runtime_checkable
class Device(Protocol[CommandT, StateT_co]):
    """A driver. ``latest`` and ``write`` never block on the link; ``connect`` and ``close`` may,
    for a bounded time.
    """

    def connect(self) -> None:
        """Open the link. Raises DeviceUnavailableError if the device cannot be reached."""

    def latest(self) -> StateT_co | None:
        """Newest state that the device sent, or None before the first. Never waits."""

    def write(self, command: CommandT) -> CommandT:
        """Send a command; return what was really sent after clipping. Raises CommandRejectedError
        if nothing was.
        """

    def health(self) -> Health:
        """How the link and the device are doing, now."""

    def close(self) -> None:
        """Bring the device to a safe state and release the link. May be called twice."""
