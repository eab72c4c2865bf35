"""The twin's own parameters with their priors, and what it is compared by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np

from pianobot_ros.axis.commissioning.commissioned import Commissioned
from pianobot_ros.axis.laws.friction import presliding
from pianobot_ros.axis.laws.kernel import JOINT
from pianobot_ros.axis.signals.cleaning import (
    effort_noise,
    motion_noise,
    quantisation,
    vibration,
)
from pianobot_ros.axis.signals.lateness import beyond_delay
from pianobot_ros.gap import Observable, Parameter
from pianobot_ros.gap.floor.estimate import resolution

COMMISSIONED = (*JOINT, "command_gain", "command_hold", "model_scale")
"""Parameters that may be given as nominal."""
HORIZON = 0.1
"""Seconds of free motion between two re-initialisations from the measured state."""
INEXACT = 0.05
"""Share of an observable's spread that a twin of this kind leaves even where it is right."""
INEXACT_MOTION = 0.04
"""The same of the distance that free motion goes within a horizon."""
STAMPED = 1.0
"""Samples by which an effort may act before or behind its stamp: a half, as a row may hold the one
that made its position or the one that answers it, and another half where it is a cycle's mean.
"""
LUMPED = 0.12
"""The same of the following error beyond a delay, where nothing but the log is known of the joint:
a geared servo is no linear loop with one inertia.
"""


def drowned(joint: Commissioned) -> bool:
    """Whether the efforts' noise alone would move the joint further than its acceleration does.

    Then free motion tells of the noise: the larger the inertia, the less of it comes through, and
    a fit takes ten times the inertia that there is.
    """
    return joint.has("effort") and _pushed(joint) > _travel(joint)


def _travel(joint: Commissioned) -> float:
    """RMS distance that the joint's own acceleration makes of a horizon, on average over it."""
    return 0.25 * float(np.std(np.concatenate([c.a for c in joint.logs]))) * HORIZON**2


def _pushed(joint: Commissioned) -> float:
    """The same of the efforts' noise: white, and integrated twice."""
    pull = effort_noise(joint.logs) / joint.nominal["inertia"]
    return pull * math.sqrt(HORIZON**3 / 12.0)


def _twisted(joint: Commissioned) -> float:
    """RMS twist between motor and link, about its mean."""
    return max(float(np.std(c.twist[c.valid])) for c in joint.logs if c.twist is not None)


def nuisances(joint: Commissioned, trust: float) -> tuple[Parameter, ...]:
    """The parameters that are refitted with every candidate."""
    out = [*_mechanics(joint, trust), *(_loop(joint, trust) if joint.has("command") else ())]
    if joint.has("effort"):
        out.append(_stamped(joint))
        if not any(c.blurred for c in joint.logs):  # its trace lasts for milliseconds
            out.append(presliding.distance(joint.scales))
    if joint.has("velocity"):
        out.append(Parameter("velocity_lag", 0.0, -0.05, 0.2, "s", "sensing", 0.01))
    if joint.has("twist"):
        spread = 3.0 * _twisted(joint)
        out += [
            Parameter("link_offset", 0.0, -spread, spread, joint.unit, "sensing", spread / 3.0),
            Parameter("link_lag", 0.0, -0.05, 0.05, "s", "sensing", 0.25 * joint.scales.dt),
        ]
    if joint.has("model"):
        scale = joint.nominal["model_scale"]
        unit = f"{joint.scales.effort_unit}/Nm"
        out.append(
            Parameter("model_scale", scale, 0.1 * scale, 10 * scale, unit, "mechanics", 0.3, True)
        )
    return tuple(out)


def _stamped(joint: Commissioned) -> Parameter:
    """By how much efforts act before their stamps, s (negative: behind them).

    An effort is held for a sample, and acts in the middle of it on average. Whether the position
    beside it was read where that sample begins or where it ends is the logger's choice, and no
    cause.
    """
    step = joint.logs[0].log.interval
    reach = STAMPED * step
    return Parameter("effort_stamp", 0.0, -reach, reach, "s", "sensing", 0.25 * step)


def _mechanics(joint: Commissioned, trust: float) -> list[Parameter]:
    n, s, tight = joint.nominal, joint.scales, bool(joint.given)
    offset = n.get("effort_offset", 0.0)
    spread = (0.03 if tight else 0.1) * s.effort
    if not joint.has("effort"):  # the loop's damping holds what is viscous
        spread = max(spread, 0.3 * abs(offset), 0.3 * n.get("coulomb", 0.0))
        reach = 3 * s.effort + 3 * abs(offset)
        return [Parameter("effort_offset", offset, -reach, reach, s.effort_unit, "drive", spread)]
    inertia, unit = n["inertia"], f"{s.effort_unit}·s²/{s.unit}"
    sd = trust if "inertia" in joint.given else 0.3
    viscous = n["viscous"]
    most = max(20 * viscous, 5 * s.effort / s.speed)
    return [
        Parameter("inertia", inertia, inertia / 8.0, inertia * 8.0, unit, "mechanics", sd, True),
        Parameter(
            "viscous",
            viscous,
            0.0,
            most,
            f"{s.effort_unit}·s/{s.unit}",
            "mechanics",
            max(0.2 * viscous, (0.02 if tight else 0.1) * s.effort / s.speed),
        ),
        Parameter(
            "effort_offset", offset, -3 * s.effort, 3 * s.effort, s.effort_unit, "drive", spread
        ),
    ]


def _loop(joint: Commissioned, trust: float) -> list[Parameter]:
    n, tight = joint.nominal, bool(joint.given)

    def log(name: str, unit: str, sd: float, span: float) -> Parameter:
        sd = trust if name in joint.given else sd
        value = n[name]
        return Parameter(name, value, value / span, value * span, unit, "drive", sd, True)

    out = [log("bandwidth", "rad/s", 0.4, 8.0), log("damping", "1", 0.3, 6.0)]
    ff, ki, hold = n["feedforward"], n["integral"], n["command_hold"]
    out.append(
        Parameter(
            "feedforward", ff, min(-0.2, ff), max(1.3, ff), "1", "drive", 0.1 if tight else 0.2
        )
    )
    if ki > 0.0:  # without any, a constant load is not held: another structure, not another value
        sd = max(0.3 * ki, 0.3)
        out.append(Parameter("integral", ki, 0.02 * ki, max(60.0, ki), "1/s", "drive", sd))
        # The structure of a loop whose values are believed is, too: a free weight would take the
        # place of a delay.
        if not tight or "command_weight" in joint.given:
            weight = n["command_weight"]
            low, high = min(-0.2, weight), max(1.3, weight)
            out.append(Parameter("command_weight", weight, low, high, "1", "drive", 0.2))
    for name in ("inertia_feedforward", "load_feedforward"):
        if (share := n.get(name, 0.0)) > 0.0:  # none is another structure, too
            out.append(Parameter(name, share, -0.2, 1.3, "1", "drive", 0.2))
    gain = n.get("command_gain", 1.0)
    out.append(Parameter("command_gain", gain, 0.5, 2.0, "1", "command", 0.01))
    # How a log stamps its commands is only open where the twin was made from it: with believed
    # values a hold that is free would take the place of a delay.
    if not tight or "command_hold" in joint.given:
        first = next(c for c in joint.logs if c.command is not None)
        step = first.log.interval
        low, high = min(-0.25 * step, hold), max(1.25 * step, hold)
        out.append(Parameter("command_hold", hold, low, high, "s", "command", 0.25 * step))
    return out


def observables(
    joint: Commissioned, missed: Mapping[str, float], repeated: bool
) -> tuple[Observable, ...]:
    """What is compared; `tolerance` is the twin's own error, the encoder's steps, what the
    reference left open (`missed`), and where no motion is `repeated`, whose scatter would hold it,
    the encoder's noise and that of the efforts as the free motion integrates it.
    """
    s, logs = joint.scales, joint.logs
    out: list[Observable] = []
    unsure = quantisation if repeated else motion_noise
    steps = np.max([unsure(c) for c in logs], axis=0)

    def add(
        name: str,
        stage: str,
        signal: str,
        unit: str,
        mode: Literal["forward", "inverse", "horizon"],
        own: float,
        sensed: float,
    ) -> None:
        tolerance = math.sqrt(own**2 + sensed**2 + missed.get(name, 0.0) ** 2)
        out.append(
            Observable(
                name, stage, signal, unit, mode=mode, floor_hint=1e-6 * own, tolerance=tolerance
            )
        )

    if joint.has("command"):
        step = max(resolution(c.log.position[np.isfinite(c.log.position)]) for c in logs)
        own = INEXACT * s.error
        if not joint.given:  # made from the log itself, so that it is late by as much
            left = [beyond_delay(c)[c.valid] for c in logs if c.command is not None]
            own = LUMPED * float(np.sqrt(np.mean(np.concatenate(left) ** 2)))
        own = math.hypot(own, 0.1 * s.dt * s.speed)
        add("tracking", "drive", "position", s.unit, "forward", own, step / math.sqrt(12.0))
    if joint.has("effort"):
        efforts = [c.effort for c in logs if c.effort is not None]
        coarse = max(
            resolution(c.log.effort[np.isfinite(c.log.effort)])
            for c in logs
            if c.log.effort is not None
        )
        inertial, drag = joint.nominal["inertia"] * steps[2], joint.nominal["viscous"] * steps[1]
        sensed = math.sqrt(inertial**2 + drag**2 + coarse**2 / 12.0)
        own = INEXACT * float(np.std(np.concatenate(efforts)))
        add("effort", "mechanics", "effort", s.effort_unit, "inverse", own, sensed)
        if not drowned(joint):
            own = INEXACT_MOTION * _travel(joint)
            sensed = math.hypot(vibration(logs), steps[0], 0.6 * HORIZON * steps[1])
            if not repeated:
                sensed = math.hypot(sensed, _pushed(joint))
            add("free motion", "mechanics", "position", s.unit, "horizon", own, sensed)
    if joint.has("velocity"):
        speeds = [c.velocity for c in logs if c.velocity is not None]
        own = INEXACT * float(np.std(np.concatenate(speeds)))
        add("velocity", "sensing", "velocity", f"{s.unit}/s", "inverse", own, steps[1])
    if joint.has("twist"):
        sides = [unsure(c, c.log.link)[0] for c in logs if c.log.link is not None]
        sensed = math.hypot(steps[0], max(sides))
        add("twist", "transmission", "twist", s.unit, "inverse", INEXACT * _twisted(joint), sensed)
    return tuple(out)
