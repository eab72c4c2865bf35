"""Presliding: a contact bends before it slips, so dry friction of any law builds up over a
distance after a rest or a reversal (Dahl 1968; Canudas de Wit et al. 1995, IEEE Transactions on
Automatic Control 40). The distance hangs on the contact, however far the joint travels, and is no
effect: every dry friction has one.
"""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Parameter

__all__ = ["advance", "distance", "slowed"]

USUAL = {"rad": 1e-3, "m": 1e-5}
"""Distance in which friction comes to two thirds: of a geared servo 0.285 Nm / 260 Nm/rad (Canudas
de Wit and Lischinsky 1997, Int. J. of Adaptive Control and Signal Processing 11), of a slide 1 N /
1e5 N/m (Canudas de Wit et al. 1995).
"""
SPREAD = 0.5 * math.log(10.0)
"""Deviation of its logarithm: two of them are ten times more or less, as joints differ by."""
LEAST, MOST = 1e-3, 30.0
"""Bounds, of what is usual: no joint's log tells the least from none at all."""


@njit(cache=True, _nrt=False)  # type: ignore[untyped-decorator,unused-ignore]
def advance(bent: float, dq: float, distance: float) -> float:
    """Friction as a share (-1 to 1) of the level at which it slips, after moving by dq."""
    return (bent * distance + dq) / (distance + abs(dq))


@njit(cache=True, _nrt=False)  # type: ignore[untyped-decorator,unused-ignore]
def slowed(free: float, brake: float, bent: float, h: float, distance: float) -> float:
    """Speed after a step of h s that would end at the speed `free` without friction, of which
    friction that slips takes `brake` (>= 0) away; implicit, and with no distance a rigid stop.
    """
    ahead = 1.0 if free > brake * bent else -1.0
    push = ahead * free
    middle = distance + h * (brake - push)
    root = math.sqrt(middle * middle + 4.0 * h * distance * (push - ahead * brake * bent))
    if middle > 0.0:  # the same root, without cancellation
        return ahead * 2.0 * distance * (push - ahead * brake * bent) / (middle + root)
    return ahead * (root - middle) / (2.0 * h)


def distance(s: Scales) -> Parameter:
    """The distance (rad, or m of a linear axis) over which dry friction builds up."""
    usual = USUAL[s.unit]
    low, high = LEAST * usual, MOST * usual
    return Parameter("presliding", usual, low, high, s.unit, "mechanics", SPREAD, True)
