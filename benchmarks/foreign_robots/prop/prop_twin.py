"""Twin of a propeller on a thrust stand: throttle, speed controller (ESC), current, rotor speed,
thrust and torque on a load cell.

Thrust and drag torque grow with the square of rotor speed (Leishman, Principles of Helicopter
Aerodynamics).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from foreign_robots.twin_tools import (
    Array,
    BlockCache,
    effect,
    lagged,
    magnitude,
    nuisance,
    packed,
    smoothed,
)
from pianobot_ros.gap import Block, Observable, Signal, Stage

MOTOR_CONSTANT = 0.011  # V s/rad and N m/A
EDGE = 6  # samples at either end where smoothing is poor
HORIZON = 30  # samples
WHOLE_BLOCK = 10**6  # samples
SUB_STEPS = 5


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def motor_current(t: Array, throttle: Array, rotor: Array, supply: Array, size: Array) -> Array:
    """Current (A) by throttle (0 to 1) and measured rotor speed (rad/s)."""
    voltage, resistance, bend, sag = supply[0], supply[1], size[0], size[1]
    out = np.empty(t.size)
    dt = t[1] - t[0]
    h = dt / SUB_STEPS
    drop = 0.0
    i = (voltage * throttle[0] - MOTOR_CONSTANT * rotor[0]) / resistance
    for k in range(t.size):
        out[k] = i
        if k == t.size - 1:
            break
        for j in range(SUB_STEPS):
            f = (j + 0.5) / SUB_STEPS
            c = throttle[k] + (throttle[k + 1] - throttle[k]) * f
            w = rotor[k] + (rotor[k + 1] - rotor[k]) * f
            x = min(max(c, 0.0), 1.0)
            x = x + bend * x * (1 - x)
            settled = ((voltage - drop) * x - MOTOR_CONSTANT * w) / resistance
            i += (1 - math.exp(-h / 0.002)) * (settled - i)
            drop += h * (sag * i - drop) / 0.3
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def rotor_torque(i: float, w: float, rotor: Array, size: Array) -> float:
    """Torque (N m) that accelerates the rotor at a current (A) and a speed (rad/s)."""
    drag, b, friction, magnets = rotor[1], rotor[2], size[0], size[1]
    motor = MOTOR_CONSTANT * i * (1 - magnets * abs(i))
    return float(motor - drag * w * w - b * w - friction * math.tanh(w / 20.0))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def rotor_speed(
    t: Array, current: Array, measured: Array, span: int, rotor: Array, size: Array
) -> Array:
    """Rotor speed (rad/s) by measured current, from the measured one every ``span`` samples."""
    inertia = rotor[0]
    out = np.empty(t.size)
    dt = t[1] - t[0]
    h = dt / SUB_STEPS
    w = measured[0]
    for k in range(t.size):
        if k % span == 0:
            w = measured[k]
        out[k] = w
        if k == t.size - 1:
            break
        for j in range(SUB_STEPS):
            f = (j + 0.5) / SUB_STEPS
            i = current[k] + (current[k + 1] - current[k]) * f
            middle = w + 0.5 * h * rotor_torque(i, w, rotor, size) / inertia
            w += h * rotor_torque(i, middle, rotor, size) / inertia
    return out


class PropellerSignals(NamedTuple):
    """What a block says, in SI units."""

    t: Array
    dt: float
    command_t: Array
    throttle: Array
    current: Array
    speed: Array
    acceleration: Array


def signals_of(block: Block) -> PropellerSignals:
    """The signals, rotor speed smoothed."""
    outputs, command = block.outputs, block.inputs["c"]
    t, speed = outputs["w"].t, outputs["w"].y
    dt = float(t[1] - t[0])
    return PropellerSignals(
        t,
        dt,
        command.t,
        command.y,
        outputs["i"].y.copy(),
        smoothed(speed, dt, 0, 9, 3),
        smoothed(speed, dt, 1, 9, 3),
    )


class PropellerTwin:
    """Current from throttle, speed and torque from current, thrust from speed."""

    stages = (Stage("esc"), Stage("rotor"), Stage("propeller"), Stage("loadcell"))
    observables = (
        Observable("current", "esc", "i", "A", floor_hint=0.02, tolerance=0.05),
        Observable("speed", "rotor", "w", "rad/s", floor_hint=0.5, tolerance=1.0),
        Observable(
            "speed_short", "rotor", "w", "rad/s", mode="horizon", floor_hint=0.5, tolerance=1.0
        ),
        Observable("thrust", "propeller", "f", "N", floor_hint=0.005, tolerance=0.01),
        Observable("torque", "rotor", "q", "N m", floor_hint=1e-4, tolerance=2e-4),
    )
    parameters = (
        nuisance("V", 12.0, "V", "esc", 0.05),
        nuisance("R", 0.12, "ohm", "esc"),
        nuisance("J", 6.0e-5, "kg m2", "rotor"),
        nuisance("kq", 1.9e-7, "N m s2", "rotor"),
        nuisance("b", 2.0e-5, "N m s", "rotor"),
        nuisance("ct", 1.1e-5, "N s2", "propeller", 0.05),
        nuisance("cell", 0.012, "s", "loadcell"),
    )
    effects = (
        effect(
            "esc_delay",
            "esc",
            magnitude("delay", 0.02, 0.2, "s"),
            (0.005, 0.03),
            "the ESC answers late",
        ),
        effect(
            "throttle_curve",
            "esc",
            magnitude("expo", 0.1, 0.9, "1", signed=True),
            (-0.08, 0.03, 0.15),
            "throttle is not linear",
        ),
        effect(
            "battery_sag",
            "esc",
            magnitude("sag", 0.02, 0.3, "ohm"),
            (0.006, 0.04),
            "battery voltage sags within 0.3 s",
        ),
        effect(
            "bearing_friction",
            "rotor",
            magnitude("tc", 0.006, 0.08, "N m"),
            (0.002, 0.012),
            "Coulomb friction of the bearings",
        ),
        effect(
            "magnet_saturation",
            "rotor",
            magnitude("msat", 0.004, 0.02, "1/A"),
            (0.002, 0.008),
            "torque constant falls with current",
        ),
        effect(
            "tip_loss",
            "propeller",
            magnitude("tip", 2e-4, 1e-3, "s"),
            (5e-5, 3e-4),
            "thrust falls short of the square law at speed",
        ),
        effect(
            "inflow_lag",
            "propeller",
            magnitude("inflow", 0.03, 0.4, "s"),
            (0.01, 0.06),
            "thrust follows speed late: induced flow",
        ),
        effect(
            "cell_creep",
            "loadcell",
            magnitude("creep", 0.04, 0.5, "1", signed=True),
            (-0.03, 0.03),
            "load cells creep with 0.4 s",
        ),
        effect(
            "rpm_lag",
            "rotor",
            magnitude("wlag", 0.01, 0.15, "s"),
            (0.004, 0.02),
            "speed reading lags",
        ),
    )

    def __init__(self) -> None:
        self.signals = BlockCache(signals_of)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Array]]:
        """Current, rotor speed, thrust and torque of every block."""
        supply, supply_size = packed(values, "V", "R"), packed(values, "expo", "sag")
        rotor, rotor_size = packed(values, "J", "kq", "b"), packed(values, "tc", "msat")
        delay, lag = packed(values, "delay", "wlag")
        out = []
        for s in map(self.signals, blocks):
            # The true speed is ahead of a reading that lags.
            w = s.speed + lag * s.acceleration if lag else s.speed
            throttle = np.interp(s.t - delay, s.command_t, s.throttle)
            long = rotor_speed(s.t, s.current, w, WHOLE_BLOCK, rotor, rotor_size)
            short = rotor_speed(s.t, s.current, w, HORIZON, rotor, rotor_size)
            if lag:
                long = lagged(long, s.dt, lag)
                for k in range(0, s.t.size, HORIZON):
                    piece = np.concatenate([[s.speed[k]], short[k : k + HORIZON]])
                    short[k : k + HORIZON] = lagged(piece, s.dt, lag)[1:]
            predicted = {
                "current": motor_current(s.t, throttle, w, supply, supply_size),
                "speed": long,
                "speed_short": short,
            }
            out.append(predicted | self._load_cell(s, w, values))
        return out

    @staticmethod
    def _load_cell(s: PropellerSignals, w: Array, values: Mapping[str, float]) -> dict[str, Array]:
        """Thrust (N) and the reaction on the stand (N m), which follows from measured current."""
        tip, inflow, creep = packed(values, "tip", "inflow", "creep")
        magnets, friction = packed(values, "msat", "tc")
        i = s.current
        thrust = lagged(values["ct"] * w * w * (1 - tip * w), s.dt, inflow)
        torque = MOTOR_CONSTANT * i * (1 - magnets * np.abs(i)) - values["b"] * w
        torque = torque - friction * np.tanh(w / 20.0)
        out = {}
        for name, load in (("thrust", thrust), ("torque", torque)):
            crept = load + creep * lagged(load, s.dt, 0.4) if creep else load
            y = lagged(crept, s.dt, values["cell"])
            y[:EDGE] = y[-EDGE:] = np.nan
            out[name] = y
        return out

    def features(self, block: Block) -> dict[str, Signal]:
        """Rotor speed and its rate, current, throttle, thrust and time."""
        s = self.signals(block)
        return {
            "speed": Signal(s.t, s.speed),
            "acceleration": Signal(s.t, s.acceleration),
            "current": block.outputs["i"],
            "throttle": block.inputs["c"],
            "thrust": block.outputs["f"],
            "time": Signal(s.t, s.t),
        }
