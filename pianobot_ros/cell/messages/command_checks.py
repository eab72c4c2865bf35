"""Commands, checked: what the real cell refuses the twin refuses too, since both ask here.

What depends on the arm's limits is checked by :mod:`pianobot_ros.devices.wrist.limits.limiter`,
which both use as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from pianobot_ros.cell.errors import CommandRejectedError, unknown_name
from pianobot_ros.cell.messages.poses import is_rotation
from pianobot_ros.cell.messages.stamps import seconds
from pianobot_ros.cell.messages.wrist_order import WristOrder
from pianobot_ros.cell.motion.rotations import rotation_vector
from pianobot_ros.cell.motion.setpoints import WristSetpoint

__all__ = ["LATE", "STALE", "vacuum_setpoint", "wrist_setpoint"]

LATE = 0.2
"""s; a setpoint of the wrist older than this is not obeyed: the arm has long stopped, and whoever
sent it may be gone."""

STALE = 0.5
"""s; a vacuum command older than this is not obeyed."""


def wrist_setpoint(message: Any, frame: str = "base", now: float | None = None) -> WristSetpoint:
    """The setpoint in a WristCommand, which may be given as a WristOrder.

    Args:
        message: the command.
        frame: in which it is to be given; one without is taken for this one.
        now: s since the Unix epoch: a stamped command that is older than :data:`LATE` is refused.
            None: of any age is obeyed.

    Raises:
        CommandRejectedError: another frame, a number that is not finite, a quaternion that is no
            rotation, or too old.
    """
    order = message if isinstance(message, WristOrder) else WristOrder.of(message)
    if order.frame not in ("", frame):
        raise CommandRejectedError(
            f"wrist setpoint is given in the frame '{order.frame[:40]}', not in '{frame}'"
        )
    numbers = order.numbers
    if not all(map(math.isfinite, numbers)):
        raise CommandRejectedError("wrist setpoint is not finite")
    x, y, z, w = numbers[3:7]
    if not is_rotation(x, y, z, w):
        raise CommandRejectedError(
            f"wrist setpoint's quaternion has length {math.hypot(x, y, z, w):.3g}, not 1"
        )
    if now is not None and order.stamp != 0.0:
        _refuse_old("wrist setpoint", now - order.stamp, LATE, "at most")
    return WristSetpoint(
        position=np.array(numbers[:3]),
        rotation=np.array(rotation_vector((x, y, z, w))),
        velocity=np.array(numbers[7:]),
        stamp=order.stamp,
    )


def vacuum_setpoint(
    message: Any, fingers: Iterable[str], now: float, stale: float = STALE
) -> dict[str, float]:
    """Wanted gauge pressure in Pa by finger in a VacuumCommand.

    Args:
        message: the command.
        fingers: those that there are.
        now: s since the Unix epoch.
        stale: s; a stamped command older than this is refused; 0: of any age is obeyed.

    Raises:
        CommandRejectedError: not one finite pressure for each of some known fingers, or too old.
    """
    names, pressures = list(message.fingers), [float(p) for p in message.pressure]
    if len(names) != len(pressures) or not names:
        raise CommandRejectedError(
            f"{len(names)} fingers but {len(pressures)} pressures: give one pressure to each finger"
        )
    known = list(fingers)
    for name, pressure in zip(names, pressures, strict=True):
        if name not in known:
            raise CommandRejectedError(unknown_name("finger", name, known))
        if not math.isfinite(pressure):
            raise CommandRejectedError(f"vacuum of '{name}' is {pressure}: give finite Pa")
    if len(set(names)) != len(names):
        raise CommandRejectedError(f"a finger is named twice: {', '.join(names)}")
    stamp = seconds(message.header.stamp)
    if stamp > 0.0 and stale > 0.0:
        _refuse_old("it", now - stamp, stale, "stale_time is")
    return dict(zip(names, pressures, strict=True))


def _refuse_old(what: str, age: float, most: float, limit: str) -> None:
    """Raise :class:`CommandRejectedError` for what is older than ``most`` s, which is called
    ``limit``.
    """
    if age > most:
        raise CommandRejectedError(
            f"{what} is {age:.2f} s old ({limit} {most:g} s): are the clocks equal?"
        )
