"""What each streamed message says, as columns of numbers, and which numbers cannot be meant.

A message stands for n of one layout: each of its numbers is an array (n,) of theirs, a sequence of
numbers a list of arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.messages.poses import are_rotations, position, quaternion
from pianobot_ros.cell.motion.geometry import FINGERS

__all__ = ["STREAMS", "Plausible", "Row", "Stream"]

Row = Sequence[float | Array]


@dataclass(frozen=True)
class Plausible:
    """Numbers of one field: their unit, a magnitude that none of them reaches, and whether they may
    be NaN, which says "not known".
    """

    unit: str
    largest: float
    optional: bool = False


_POSE = {"position": Plausible("m", 1e3), "rotation": Plausible("1", 2.0)}
_PRESSURE = Plausible("Pa", 1e7, optional=True)


@dataclass(frozen=True)
class Stream:
    """A type of message and its fields; ``read`` gives a row for each field.

    ``columns`` says what is plausible; a field that it does not name is judged by the column "".
    """

    type: str
    read: Callable[[Any], dict[str, Row]]
    columns: Mapping[str, Plausible]

    def table(self, message: Any, count: int) -> tuple[dict[str, Array], NDArray[np.bool_]]:
        """The fields (n, m) of ``count`` messages, and which of them (n,) can be meant.

        Raises ValueError, TypeError or AttributeError if none of them says what its type asks for.
        """
        fields, sound = {}, np.ones(count, dtype=bool)
        for name, row in self.read(message).items():
            fields[name] = values = np.empty((count, len(row)))
            for i, x in enumerate(row):
                values[:, i] = x
            column = self.column(name)
            likely = np.abs(values) < column.largest
            sound &= (likely | (column.optional & np.isnan(values))).all(axis=1)
            if name == "rotation":
                sound &= are_rotations(values)
        return fields, sound

    def column(self, name: str) -> Plausible:
        """The column of a field."""
        found = self.columns.get(name)
        return self.columns[""] if found is None else found


def _listed(values: Any) -> list[Any]:
    """A field that must be a sequence."""
    if not isinstance(values, list):
        raise TypeError("not a sequence")
    return values


def _command(message: Any) -> dict[str, Row]:
    return {"position": position(message.pose), "rotation": quaternion(message.pose)}


def _wrist(message: Any) -> dict[str, Row]:
    state = (message.safety_state,)
    return {**_command(message), "currents": _listed(message.joint_currents), "safety": state}


def _by_finger(message: Any, values: Any) -> Row:
    """``values`` in the order thumb, index, middle; a finger that is not named is NaN."""
    named = dict(zip(message.fingers, _listed(values), strict=True))
    return [named.get(finger, math.nan) for finger in FINGERS]


def _vacuum_command(message: Any) -> dict[str, Row]:
    return {"pressure": _by_finger(message, message.pressure)}


def _vacuum(message: Any) -> dict[str, Row]:
    return {name: _by_finger(message, getattr(message, name)) for name in ("setpoint", "measured")}


def _force(message: Any) -> dict[str, Row]:
    values = {"force": message.force, "counts": message.counts, "saturated": message.saturated}
    return {name: (value,) for name, value in values.items()}


def _angles(message: Any) -> dict[str, Row]:
    pairs = zip(_listed(message.notes), _listed(message.angle), strict=True)
    return {str(note): (angle,) for note, angle in pairs}


def _joints(message: Any) -> dict[str, Row]:
    return {"position": _listed(message.position)}


_CELL = {
    "wrist/state": Stream(
        "pianobot_msgs/msg/WristState",
        _wrist,
        {**_POSE, "currents": Plausible("A", 1e4, optional=True), "safety": Plausible("1", 256.0)},
    ),
    "vacuum/state": Stream("pianobot_msgs/msg/VacuumState", _vacuum, {"": _PRESSURE}),
    "fsr": Stream(
        "pianobot_msgs/msg/KeyForce",
        _force,
        {"force": Plausible("N", 1e5), "": Plausible("1", 2.0**32)},
    ),
    "key_angle": Stream("pianobot_msgs/msg/KeyAngle", _angles, {"": Plausible("rad", 100.0)}),
    "joint_states": Stream("sensor_msgs/msg/JointState", _joints, {"": Plausible("rad", 1e4)}),
}

STREAMS: dict[str, Stream] = {
    "command/wrist": Stream("pianobot_msgs/msg/WristCommand", _command, _POSE),
    "command/vacuum": Stream("pianobot_msgs/msg/VacuumCommand", _vacuum_command, {"": _PRESSURE}),
    **{f"{cell}/{name}": stream for cell in ("real", "sim") for name, stream in _CELL.items()},
}
"""By topic, without namespace and leading slash."""
