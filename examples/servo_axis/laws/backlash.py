"""Backlash: after a reversal the motor crosses a gap before it drives the load again.

The load is a rigid mass that is pushed by one flank of the gap or the other, or coasts between them under its own field
(gravity); flanks only push. An impact is inelastic. The state `load` is (position, speed, flank: -1, 0 or 1).
"""

from __future__ import annotations

from numba import njit

from examples.servo_axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.gap.types import Array


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def drive(load: Array, q: float, v: float, a: float, field: float, inertia: float, width: float, h: float) -> float:
    """Torque on the motor from its load (`inertia`, `field`) while the motor moves with q, v, a; advances `load` by h."""
    half = 0.5 * width
    if load[2] != 0.0:
        push = inertia * a + field
        if push * load[2] >= 0.0:
            load[0], load[1] = q - load[2] * half, v
            return push
        load[2] = 0.0
    load[1] -= h * field / inertia
    load[0] += h * load[1]
    apart = q - load[0]
    if abs(apart) >= half:
        load[2] = 1.0 if apart > 0 else -1.0
        load[0], load[1] = q - load[2] * half, v
    return 0.0


def build(s: Scales) -> Effect:
    """Full width of the gap (rad), the load's share of the inertia, and where the encoder sits (0 motor, 1 output)."""
    d = max(s.travel, 1e-4)
    return effect("backlash", "transmission",
                  [Parameter("backlash", 0.0, 0.0, 0.5 * d, "rad", "transmission", sd=0.02 * d),
                   Parameter("backlash_share", 0.5, 0.05, 0.95, "1", "transmission", sd=0.2),
                   Parameter("backlash_output", 0.0, 0.0, 1.0, "1", "transmission", sd=0.5)],
                  [[w * d, 0.5, out] for w in (0.004, 0.015, 0.05) for out in (0.0, 1.0)],
                  "lost motion after a reversal")  # fmt: skip
