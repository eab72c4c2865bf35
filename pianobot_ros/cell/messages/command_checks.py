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
from pianobot_ros.cell.host.wall_clock import AHEAD
from pianobot_ros.cell.messages.poses import is_rotation
from pianobot_ros.cell.messages.stamps import seconds
from pianobot_ros.cell.messages.wrist_order import WristOrder
from pianobot_ros.cell.motion.rotations import rotation_vector
from pianobot_ros.cell.motion.setpoints import WristSetpoint

__all__ = ["FRAME", "LATE", "STALE", "vacuum_setpoint", "wrist_setpoint"]

FRAME = "base"
"""In which commands are given, where a node is not told another."""

LATE = 0.2
"""s; a setpoint of the wrist older than this is not obeyed: the arm has long stopped, and whoever
sent it may be gone."""

STALE = 0.5
"""s; a vacuum command older than this is not obeyed."""


def wrist_setpoint(message: Any, frame: str = FRAME, now: float | None = None) -> WristSetpoint:
    """The setpoint in a WristCommand, which may be given as a WristOrder.

    Args:
        message: the command.
        frame: in which it is to be given; one without is taken for this one.
        now: s since the Unix epoch; None: with any stamp it is obeyed.

    Raises:
        CommandRejectedError: another frame, a stamp older than :data:`LATE` or too far ahead, a
            number that is not finite, or a quaternion that is no rotation.
    """
    order = message if isinstance(message, WristOrder) else WristOrder.of(message)
    _check_header("wrist setpoint", order.frame, order.stamp, frame, now, LATE)
    numbers = order.numbers
    if not all(map(math.isfinite, numbers)):
        raise CommandRejectedError("wrist setpoint is not finite")
    x, y, z, w = numbers[3:7]
    if not is_rotation(x, y, z, w):
        raise CommandRejectedError(
            f"wrist setpoint's quaternion has length {math.hypot(x, y, z, w):.3g}, not 1"
        )
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
        CommandRejectedError: another frame, a stamp that is too old or too far ahead, or not one
            finite pressure for each of some known fingers.
    """
    header = message.header
    _check_header(
        "vacuum command", header.frame_id, seconds(header.stamp), FRAME, now, stale or math.inf
    )
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
    return dict(zip(names, pressures, strict=True))


def _check_header(
    what: str, given: str, stamp: float, frame: str, now: float | None, oldest: float
) -> None:
    """Every command's frame and stamp: it is ``given`` in the frame, or in none, and stamped with
    a time at most ``oldest`` s ago and no more than :data:`AHEAD` to come, or with none.
    """
    if given not in ("", frame):
        raise CommandRejectedError(f"{what} is given in the frame '{given[:40]}', not in '{frame}'")
    if now is None or stamp == 0.0:
        return
    age = now - stamp
    if age > oldest or age < -AHEAD:
        said = f"{age:.2f} s old (at most {oldest:g} s)"
        if age < 0.0:
            said = f"stamped {-age:.2f} s ahead (at most {AHEAD:g} s)"
        raise CommandRejectedError(f"{what} is {said}: are the clocks equal?")
