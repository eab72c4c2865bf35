"""The library of the servo axis: one effect per file, sized to a log by its function `effect`. Its
`law` runs compiled in the axis's kernel; where it has none, the kernel's equations need no more
than its parameters. `LIBRARY` is the order of the table in the docs.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.drive import (
    cogging,
    command_delay,
    command_lag,
    deadband,
    friction_compensation,
    speed_limit,
    torque_droop,
    torque_limit,
)
from pianobot_ros.axis.laws.friction import (
    asymmetric_friction,
    concave_viscous,
    coulomb,
    hysteresis,
    load_friction,
    stribeck,
    warming,
)
from pianobot_ros.axis.laws.load import (
    arm_gravity,
    backlash,
    carried_load,
    elasticity,
    end_stop,
    gravity,
    payload,
    spring,
)
from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.axis.laws.sensing import (
    clock_skew,
    encoder_ripple,
    position_offset,
    sensor_latency,
)
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
    carried_load,
    end_stop,
    spring,
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
    return tuple(module.effect(scales) for module in LIBRARY)
