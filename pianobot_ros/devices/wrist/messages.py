"""What the driver and its worker process tell each other, over a socket that keeps message
boundaries.

The first byte is the kind. Readings and setpoints are packed numbers, the rest is JSON.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

__all__ = [
    "HALT",
    "QUIT",
    "READING",
    "RECOVER",
    "SETPOINT",
    "TEXT",
    "RawReading",
    "Setpoint",
    "pack_text",
    "unpack_text",
]

SETPOINT, HALT, RECOVER, QUIT = b"s", b"h", b"r", b"q"  # to the worker
READING, TEXT = b"R", b"T"  # from the worker

_SETPOINT = struct.Struct("<Qdd6d")
_LARGEST = 1000.0
"""No length in m, angle in rad, their speeds or current in A of an arm comes near this."""
_READING = struct.Struct("<QqddQdd?iiI d 6d6d6d 6d6d6d".replace(" ", ""))


class Setpoint(NamedTuple):
    """A tool pose, (6,), for ``servoL``; ``written`` is the monotonic time at which the user wrote
    it and ``due`` the one at which the arm is to be given it, s."""

    sequence: int
    written: float
    due: float
    pose: Sequence[float]

    def pack(self) -> bytes:
        """As a message."""
        return SETPOINT + _SETPOINT.pack(self.sequence, self.written, self.due, *self.pose)

    @classmethod
    def unpack(cls, message: bytes) -> Setpoint:
        """From a message."""
        sequence, written, due, *pose = _SETPOINT.unpack(message[1:])
        return cls(sequence, written, due, pose)


class RawReading(NamedTuple):
    """One package of the controller, in the controller's own terms: tool poses with rotation
    vectors.
    """

    sequence: int
    time_ns: int
    monotonic: float
    controller_time: float
    applied: int
    latency: float
    behind: float
    servoing: bool
    safety_mode: int
    robot_mode: int
    runtime_state: int
    speed_scaling: float
    pose: tuple[float, ...]
    speed: tuple[float, ...]
    target: tuple[float, ...]
    q: tuple[float, ...]
    qd: tuple[float, ...]
    current: tuple[float, ...]

    @property
    def program_running(self) -> bool:
        """Whether the controller runs a program."""
        return self.runtime_state == 2

    def pack(self) -> bytes:
        """As a message."""
        numbers, vectors = self[:12], self[12:]
        return READING + _READING.pack(*numbers, *chain.from_iterable(vectors))

    @classmethod
    def unpack(cls, message: bytes) -> RawReading:
        """From a message."""
        v = _READING.unpack(message[1:])
        vectors = [v[12 + 6 * i : 18 + 6 * i] for i in range(6)]
        return cls(*v[:12], *vectors)

    @property
    def plausible(self) -> bool:
        """Whether every number is finite and of a size that an arm's state can have."""
        vectors = (*self.pose, *self.speed, *self.target, *self.q, *self.qd, *self.current)
        return (
            math.isfinite(sum(vectors))  # so that each of them is a number
            and min(vectors) > -_LARGEST
            and max(vectors) < _LARGEST
            and 0.0 <= self.controller_time < math.inf
            and 0.0 <= self.speed_scaling <= 2.0
            and 0.0 <= self.behind < math.inf
        )


def pack_text(event: str, **content: Any) -> bytes:
    """An event with its content, as a message."""
    return TEXT + json.dumps({"event": event, **content}).encode()


def unpack_text(message: bytes) -> dict[str, Any]:
    """The content of an event; its name is under ``event``."""
    return dict(json.loads(message[1:]))
