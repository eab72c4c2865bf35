"""The errors that a user can do something about."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = [
    "CancelledError",
    "CommandRejectedError",
    "ConfigError",
    "DeviceError",
    "PianobotError",
    "RecordingError",
    "ScoreError",
    "unknown_name",
]


class PianobotError(Exception):
    """An error whose message is one clear line that says what to do. The command line prints it and
    exits with 2.
    """


class CancelledError(PianobotError):
    """Somebody asked for the work to end before it was done."""


class ConfigError(PianobotError):
    """A configuration file or parameter is wrong."""


class DeviceError(PianobotError):
    """A device cannot be reached, or refuses what was asked of it."""


class CommandRejectedError(DeviceError):
    """The command is not obeyed because it is invalid: not finite, outside the workspace, of a
    wrong shape, frame or age.
    """


class RecordingError(PianobotError):
    """A recording cannot be used as it is."""


class ScoreError(PianobotError):
    """A score or phrase cannot be played."""


def unknown_name(kind: str, name: str, valid: Iterable[str]) -> str:
    """One line that names the unknown ``name``, the nearest valid one if any, and all valid
    ones.
    """
    names = sorted(valid)
    name = name[:80]  # of a stranger; to compare long ones takes long
    near = get_close_matches(name, names, n=1)
    hint = f" (did you mean '{near[0]}'?)" if near else ""
    return f"unknown {kind} '{name}'{hint}; valid: {', '.join(names)}"
