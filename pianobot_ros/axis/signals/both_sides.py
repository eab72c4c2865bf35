"""A joint whose position was recorded on both sides of what is between motor and load."""

from __future__ import annotations

import numpy as np

from pianobot_ros.axis.signals.log_repair import integral
from pianobot_ros.gap.problem.types import Array

__all__ = ["at_the_motor", "moves_like", "why_not"]

APART = 0.1
"""Share of the position's variance that a motor which is the joint's leaves at most."""
SAME = 0.02
"""Ratio of both motions from 1 within which it is 1: a spring under a load moves it too."""
NO_TWIST = 1e-6
"""Share of the travel below which two positions are copies of each other."""


def at_the_motor(motor: Array, position: Array) -> Array | None:
    """The motor's position (n,) as the joint would have it without a twist: in the joint's unit,
    with the gear's ratio and sign, and on average where the joint is. None where it is no other
    motion than the joint's, or quite another.
    """
    ok = np.isfinite(motor) & np.isfinite(position)
    if ok.sum() < 20 or float(np.ptp(motor[ok])) == 0.0 or float(np.ptp(position[ok])) == 0.0:
        return None
    x, q = motor[ok] - motor[ok].mean(), position[ok] - position[ok].mean()
    ratio = float(x @ q) / float(x @ x)
    if abs(ratio - 1.0) < SAME:
        ratio = 1.0
    twist = ratio * x - q
    if float(np.var(twist)) > APART * float(np.var(q)):
        return None
    if float(np.std(twist)) < NO_TWIST * float(np.ptp(q)):
        return None
    return np.asarray(position[ok].mean() + ratio * (motor - motor[ok].mean()))


def why_not(motor: Array, position: Array) -> str:
    """Why :func:`at_the_motor` has none: there is no twist, the two drift apart, or they are two
    motions. Steps over a hundredth of the time tell a drift from another motion.
    """
    ok = np.isfinite(motor) & np.isfinite(position)
    x, q = motor[ok], position[ok]
    lag = max(x.size // 100, 1)
    if x.size < 20 or not np.ptp(x) > 0.0:
        return "no twist is seen"
    dx, dq = x[lag:] - x[:-lag], q[lag:] - q[:-lag]
    ratio = float(dx @ dq) / max(float(dx @ dx), 1e-300)
    twist = ratio * x - q
    if float(np.std(twist)) < NO_TWIST * float(np.ptp(q)):
        return "no twist is seen"
    if float(np.var(ratio * dx - dq)) > APART * float(np.var(dq)):
        return "it is another motion"
    return (
        f"the two drift apart by {float(np.ptp(twist)):.3g}"
        f" ({float(twist[-1] - twist[0]):+.3g} from first to last sample), as where one of the"
        " encoders loses its place"
    )


def moves_like(speed: Array, one: Array, other: Array, t: Array) -> bool:
    """Whether a speed (n,) is the slope of `one` rather than of the `other` position (n,), at times
    t (n,): what its integral leaves of each beside a line says so.
    """
    ok = np.isfinite(speed) & np.isfinite(one) & np.isfinite(other)
    if ok.sum() < 20:
        return False
    x, moved = t[ok], integral(speed[ok], np.diff(t[ok]))
    left = [_beside_a_line(y[ok] - moved, x) for y in (one, other)]
    return left[0] < left[1]


def _beside_a_line(y: Array, x: Array) -> float:
    return float(np.var(y - np.polyval(np.polyfit(x - x.mean(), y, 1), x - x.mean())))
