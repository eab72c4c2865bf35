"""The library of the servo axis: one law per file. `LIBRARY` is the order of the table in the docs."""

from __future__ import annotations

from examples.servo_axis.laws import (
    asymmetric_friction,
    backlash,
    clock_skew,
    cogging,
    command_delay,
    command_lag,
    coulomb,
    deadband,
    elasticity,
    encoder_ripple,
    gravity,
    hysteresis,
    load_friction,
    payload,
    position_offset,
    sensor_latency,
    stribeck,
    torque_droop,
    torque_limit,
)
from examples.servo_axis.laws.base import Scales
from pianobot_ros.gap import Effect

__all__ = ["LIBRARY", "Scales", "library", "payload"]

LIBRARY = (
    command_delay, command_lag, deadband, torque_limit, torque_droop,
    coulomb, stribeck, load_friction, asymmetric_friction, gravity, cogging, hysteresis,
    backlash, elasticity, position_offset, encoder_ripple, sensor_latency, clock_skew,
)  # fmt: skip


def library(scales: Scales) -> tuple[Effect, ...]:
    """All effects, sized to a log."""
    return tuple(module.build(scales) for module in LIBRARY)
