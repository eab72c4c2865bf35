"""Position error that repeats once per turn or more often: an eccentric encoder disc or gear."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from pianobot_ros.axis.laws.scales import PHASE, Scales
from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.gap.problem.types import Array


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(q: float, amplitude: float, waves: float, phase: float) -> float:
    """Reading minus true angle, rad."""
    return amplitude * math.sin(waves * q + phase) if amplitude != 0.0 else 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def slope(q: float, amplitude: float, waves: float, phase: float) -> float:
    """Change of the law with the angle: by this share a speed is read too high."""
    return amplitude * waves * math.cos(waves * q + phase)


def undone(
    raw: Array,
    smoothed: tuple[Array, Array, Array],
    ripple: tuple[float, float, float],
    smooth: Callable[[Array], Array],
) -> tuple[Array, Array, Array]:
    """True angle, speed and acceleration (n,) by readings that are raw (n,) and smoothed by
    `smooth`, and the ripple with them: at speed it is quicker than that, and little of it is left.
    """
    amplitude, waves, phase = ripple
    q, v, a = smoothed
    angle, speed, bend = raw, v, a
    for _ in range(3):  # each leaves a share of the error that is the law's slope
        angle = raw - amplitude * np.sin(waves * angle + phase)
    turn = waves * angle + phase
    rise, height = amplitude * waves * np.cos(turn), amplitude * np.sin(turn)
    for _ in range(3):
        bent = rise * bend - waves**2 * height * speed**2
        speed, bend = v - smooth(rise * speed), a - smooth(bent)
    return q - smooth(height), speed, bend


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
            Parameter("encoder_phase", 0.0, -PHASE, PHASE, "rad", sd=3.0),
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
