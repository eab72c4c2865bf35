"""Feed-forward linearisation of the voice coil, as the paper does it: a third-order polynomial of
displacement and current, whose zeroth, second and third terms are added to the command, so that
what is left is linear.

The rig's numbers are those of Table 2; how far flexure and field are from linear the paper does not
say (:class:`~pianobot_ros.piano.action.parameters.CoilCurve`, declared free).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.action.parameters import ActionParameters

__all__ = ["Linearised", "linearise"]

SPAN = 0.010  # m to either side of the centre
POINTS = 41


@dataclass(frozen=True)
class Linearised:
    """``current`` (n,) A that holds the armature at ``displacement`` (n,) m, alone (``before``) and
    as commanded with the compensator (``after``); ``coefficients`` (4,) of i(x), zeroth first;
    ``off_before`` and ``off_after``: largest distance from a straight line through the centre, as a
    share of the span; ``stiffness`` N/m that is left.
    """

    displacement: Array
    before: Array
    after: Array
    coefficients: Array
    off_before: float
    off_after: float
    stiffness: float


def linearise(p: ActionParameters, *, seed: int) -> Linearised:
    """Measure i(x) of the simulated armature, fit the polynomial, and measure again with it."""
    a, curve = p.armature, p.curve
    rng = np.random.default_rng(seed)
    x = np.linspace(-SPAN, SPAN, POINTS)
    share = x / SPAN
    bent = a.stiffness * x * (1 + curve.quadratic * share + curve.cubic * share**2)
    held = (bent - curve.weight) / a.motor_constant  # the current that balances flexure and weight
    seen = np.round(x * p.rig.encoder_resolution) / p.rig.encoder_resolution
    reported = held + rng.normal(0.0, curve.current_noise, x.size)
    coefficients = np.polynomial.polynomial.polyfit(seen, reported, 3)
    straight = np.array([0.0, coefficients[1], 0.0, 0.0])
    added = np.polynomial.polynomial.polyval(seen, coefficients - straight)
    after = np.asarray(held - added + rng.normal(0.0, curve.current_noise, x.size), dtype=float)
    return Linearised(
        x,
        reported,
        after,
        np.asarray(coefficients, dtype=float),
        _off(x, reported),
        _off(x, after),
        float(coefficients[1] * a.motor_constant),
    )


def _off(x: Array, current: Array) -> float:
    slope = np.polyfit(x, current, 1)[0]
    return float(np.max(np.abs(current - slope * x)) / np.ptp(current))
