"""The library of the servo axis: one law per file. `LIBRARY` is the order of the table in the
docs.
"""

from __future__ import annotations

from pianobot_ros.axis.laws import (
    arm_gravity,
    asymmetric_friction,
    backlash,
    clock_skew,
    cogging,
    command_delay,
    command_lag,
    concave_viscous,
    coulomb,
    deadband,
    elasticity,
    encoder_ripple,
    friction_compensation,
    gravity,
    hysteresis,
    load_friction,
    payload,
    position_offset,
    sensor_latency,
    speed_limit,
    stribeck,
    torque_droop,
    torque_limit,
    warming,
)
from pianobot_ros.axis.laws.base import Scales
from pianobot_ros.gap import Effect

__all__ = ["LIBRARY", "Scales", "library", "payload"]

LIBRARY = (
    command_delay,
    command_lag,
    deadband,
    torque_limit,
    speed_limit,
    torque_droop,
    friction_compensation,
    coulomb,
    stribeck,
    load_friction,
    asymmetric_friction,
    concave_viscous,
    warming,
    gravity,
    arm_gravity,
    cogging,
    hysteresis,
    backlash,
    elasticity,
    position_offset,
    encoder_ripple,
    sensor_latency,
    clock_skew,
)


def library(scales: Scales) -> tuple[Effect, ...]:
    """All effects, sized to a log."""
    return tuple(module.build(scales) for module in LIBRARY)
