"""Motions that could be recorded next, as blocks: what the joint would do is predicted by the
commissioned twin.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.signals.segment import whole
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.gap import Block, GapError
from pianobot_ros.gap.problem.types import Array


def motions(
    travel: float, centre: float, seconds: float = 6.0, rate: float = 200.0
) -> dict[str, Array]:
    """Commands (n,) in rad within the travel that was already used: slow, fast, reversals, steps,
    holds, sweep.
    """
    t = np.arange(0, seconds, 1 / rate)
    half = 0.45 * travel
    ease = np.minimum(1, t / 0.5)

    def sine(amplitude: float, hz: float) -> Array:
        return np.asarray(centre + amplitude * np.sin(2 * np.pi * hz * t) * ease)

    return {
        "slow sweep of the whole travel": sine(half, 0.1),
        "medium sine": sine(half, 0.5),
        "fast small sine": sine(0.25 * half, 2.0),
        "small reversals": sine(0.08 * half, 0.4),
        "steps with holds": np.asarray(
            centre + half * np.round(2 * np.sin(2 * np.pi * 0.25 * t)) / 2
        ),
        "rising frequency": np.asarray(
            centre + 0.5 * half * np.sin(2 * np.pi * (0.1 * t + 0.25 * t**2)) * ease
        ),
    }


def candidates(twin: ServoAxis) -> list[Block]:
    """One block per motion, ready for `propose_experiment`. One that does not move the joint, since
    friction holds it, is none.
    """
    out: list[Block] = []
    scales = twin.joint.scales
    for name, command in motions(scales.travel, scales.middle).items():
        log = twin.rehearse(name, command, 200.0)
        with suppress(GapError):
            out.append(whole(clean(log), name))
    return out
