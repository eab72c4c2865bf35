"""Position error that repeats once per turn or more often: an eccentric encoder disc or gear."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(q: float, amplitude: float, waves: float, phase: float) -> float:
    """Reading minus true angle, rad."""
    return amplitude * math.sin(waves * q + phase) if amplitude != 0.0 else 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def slope(q: float, amplitude: float, waves: float, phase: float) -> float:
    """Change of the law with the angle: by this share a speed is read too high."""
    return amplitude * waves * math.cos(waves * q + phase)


def effect(s: Scales) -> Effect:
    """Amplitude (rad), periods per radian, phase, and how much of the error the controller's own
    reading has.
    """
    e = max(s.error, 1e-5)
    return Effect(
        "encoder_ripple",
        "sensing",
        [
            Parameter("encoder_ripple", 0.0, 0.0, 0.2, "rad", sd=0.3 * e),
            Parameter("encoder_waves", 1.0, 1.0, 200.0, "1/rad", sd=1.0, log=True),
            Parameter("encoder_phase", 0.0, -7.0, 7.0, "rad", sd=3.0),
            Parameter("encoder_loop", 0.0, 0.0, 1.0, "1", sd=0.5),
        ],
        [
            {
                "encoder_ripple": 0.2 * e,
                "encoder_waves": waves,
                "encoder_phase": phase,
                "encoder_loop": loop,
            }
            for loop in (0.0, 1.0)
            for waves in (1.0, 2.0, 4.0, 8.0, 16.0)
            for phase in (0.0, 1.57, 3.14, -1.57)
        ],
        description="the encoder's reading errs with position",
        law=law,
    )
