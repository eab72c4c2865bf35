# ruff: noqa: PLR0912, PLR0915  (compiled code: flat functions over plain numbers are what the
# compiler turns into fast code)
"""The vacuum regulators: from setpoint to pressure in each finger, with the effects of the
pneumatic stage.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.instruments.held import held
from pianobot_ros.emulator.plant.instruments.sensor_noise import noise_levels
from pianobot_ros.emulator.plant.laws.air import (
    RELAYS,
    choked_leak,
    laminar_leak,
    play,
    relay_loop,
    seal_leak,
)
from pianobot_ros.emulator.serving.bus import PlantBus

__all__ = [
    "AirParameters",
    "AirState",
    "RegulatorModel",
    "air_parameters",
    "air_step",
    "new_air_state",
]


ATMOSPHERE = 101_325.0  # Pa
CRITICAL_RATIO = 0.528  # of ISO 6358 for an ideal nozzle
BAND = 8_000.0  # Pa of error over which the valve opens fully
RESERVE_TIME = 4.0  # s in which the pump makes up for what was drawn
REGULATION = 0.03  # s, how fast the regulator makes up for a leak
VENTING = 0.4  # time of letting air in over that of drawing it out


class AirParameters(NamedTuple):
    """Constants of the compiled regulators; effects by physical parameter."""

    pressure_lag: float  # s
    pressure_leak: float  # Pa
    regulator_hysteresis: float  # Pa
    pressure_crosstalk: float  # 1
    pump_depletion: float  # Pa
    pressure_lag_law: int
    pressure_leak_law: int
    regulator_hysteresis_law: int


class AirState(NamedTuple):
    """What the regulators remember, (3,) each: ``pressure``, ``valve`` command, ``memory`` of
    hysteresis, ``leak``, ``second`` volume; Pa; ``drawn`` (1,) of the pump's reserve; ``relays``
    (3, 4) of its law 3, in units of the range.
    """

    pressure: Array
    valve: Array
    memory: Array
    leak: Array
    second: Array
    drawn: Array
    relays: Array


def air_parameters(case: Case) -> AirParameters:
    """The regulators of a case."""
    return AirParameters(**case.constants(AirParameters._fields))


def new_air_state(pressure: ArrayLike) -> AirState:
    """Settled at ``pressure`` (3,) Pa."""
    start = np.array(pressure, dtype=float)
    level, widths = np.clip(-start / 100_000.0, 0.0, 1.0), np.array(RELAYS)
    relays = np.clip(level[:, None], widths, 1.0 - widths)
    memory, leak, drawn = np.zeros(3), np.zeros(3), np.zeros(1)
    return AirState(start.copy(), start.copy(), memory, leak, start.copy(), drawn, relays)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def air_step(p: AirParameters, s: AirState, setpoint: Array, dt: float) -> None:
    """Advance all channels by ``dt`` s."""
    mean = (setpoint[0] + setpoint[1] + setpoint[2]) / 3.0
    for i in range(3):
        aim = setpoint[i]
        if p.pressure_crosstalk > 0.0:  # one manifold: neighbours pull along
            aim += p.pressure_crosstalk * 1.5 * (mean - setpoint[i])
        before = s.pressure[i]
        if p.pump_depletion > 0.0:  # a small reserve: what was drawn lately is missing now
            aim -= p.pump_depletion * s.drawn[0] * setpoint[i] / 100_000.0
        if p.regulator_hysteresis > 0.0 and p.regulator_hysteresis_law == 1:
            s.valve[i] = play(s.valve[i], aim, p.regulator_hysteresis)
            aim = s.valve[i]
        elif p.regulator_hysteresis > 0.0 and p.regulator_hysteresis_law == 2:
            # three operators, of which the widest forgets last (Prandtl, Ishlinskii; Kuhnen 2003)
            s.valve[i] = play(s.valve[i], aim, 0.5 * p.regulator_hysteresis)
            s.memory[i] = play(s.memory[i], aim, 1.5 * p.regulator_hysteresis)
            aim = 0.5 * (s.valve[i] + s.memory[i])
        elif p.regulator_hysteresis > 0.0 and p.regulator_hysteresis_law == 3:
            aim = relay_loop(s.relays[i], aim, p.regulator_hysteresis)
        elif p.regulator_hysteresis > 0.0:  # Bouc and Wen's hysteresis of the spool
            move = (aim - s.valve[i]) / 12_000.0
            steps = max(1, int(abs(move) / 0.05) + 1)
            for _ in range(steps):
                d = move / steps
                s.memory[i] += d - 0.6 * abs(d) * s.memory[i] - 0.4 * d * abs(s.memory[i])
            s.valve[i] = aim
            aim += -p.regulator_hysteresis * s.memory[i]
        if p.pressure_lag > 0.0 and p.pressure_lag_law == 1:  # a linear restriction and a volume
            s.pressure[i] += (aim - s.pressure[i]) * (1.0 - math.exp(-dt / p.pressure_lag))
        elif p.pressure_lag > 0.0 and p.pressure_lag_law == 2:
            # the hose is a volume of its own (Richer and Hurmuzlu 2000)
            part = 1.0 - math.exp(-2.0 * dt / p.pressure_lag)
            s.second[i] += (aim - s.second[i]) * part
            s.pressure[i] += (s.second[i] - s.pressure[i]) * part
        elif p.pressure_lag > 0.0 and p.pressure_lag_law == 3:
            # air comes in faster than the pump draws it out (charging, discharging: Andersen 1967)
            time = p.pressure_lag * (1.0 if aim < s.pressure[i] else VENTING)
            s.pressure[i] += (aim - s.pressure[i]) * (1.0 - math.exp(-dt / time))
        elif p.pressure_lag > 0.0:  # a nozzle, choked where the pressure ratio is below critical
            now = ATMOSPHERE + s.pressure[i]
            opening = min(max((aim - s.pressure[i]) / BAND, -1.0), 1.0)
            if opening > 0.0:
                upstream, ratio = ATMOSPHERE, now / ATMOSPHERE
            else:
                upstream, ratio = now, 500.0 / max(now, 1.0)
            flow = upstream * opening / p.pressure_lag
            if ratio > CRITICAL_RATIO:
                part = (ratio - CRITICAL_RATIO) / (1.0 - CRITICAL_RATIO)
                flow *= math.sqrt(max(1.0 - part * part, 0.0))
            change = dt * flow
            room = aim - s.pressure[i]
            s.pressure[i] += change if abs(change) < abs(room) else room
        else:
            s.pressure[i] = aim
        if (
            p.pressure_leak > 0.0
        ):  # flow through a crack goes with the root of the pressure difference
            if p.pressure_leak_law == 1:
                droop = laminar_leak(s.pressure[i], p.pressure_leak)
            elif p.pressure_leak_law == 2:
                droop = seal_leak(s.pressure[i], p.pressure_leak)
            elif p.pressure_leak_law == 3:
                droop = choked_leak(s.pressure[i], p.pressure_leak)
            else:
                droop = p.pressure_leak * math.sqrt(max(-s.pressure[i], 0.0) / 100_000.0)
            s.leak[i] += (droop - s.leak[i]) * (dt / (REGULATION + dt))
        else:
            s.leak[i] = 0.0
        s.drawn[0] += max(before - s.pressure[i], 0.0) / 100_000.0
    s.drawn[0] *= math.exp(-dt / RESERVE_TIME)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _air_steps(regulators: Any, setpoint: Array, dt: float, steps: int) -> None:
    """``steps`` steps of ``dt`` s of the parameters and the state held: to enter compiled code
    costs as much as ten of them.
    """
    p, s = regulators[0]
    for _ in range(steps):
        air_step(p, s, setpoint, dt)


class RegulatorModel:
    """Three vacuum regulators, stepped at the device's rate.

    ``pressure`` (3,) Pa is the true pressure: write it to the bus. What :meth:`step` returns is the
    device's own
    measurement of it, with sensor noise: report it.
    """

    def __init__(self, pressure: ArrayLike = (0.0, 0.0, 0.0), case: Case | None = None) -> None:
        self.case = case or Case()
        self._state = new_air_state(pressure)
        self._held = held((air_parameters(self.case), self._state))
        self._spread = noise_levels().pressure * self.case.noise
        self._random = np.random.default_rng([self.case.seed, 2])
        self.pressure: Array = np.array(pressure, dtype=float)

    @classmethod
    def from_bus(cls, bus: PlantBus, pressure: ArrayLike = (0.0, 0.0, 0.0)) -> RegulatorModel:
        """The regulators of the cell behind ``bus``, with the effects that its case gives them."""
        return cls(pressure, Case.from_json(bus.case()))

    def step(self, dt: float, setpoint: ArrayLike) -> Array:
        """Advance by ``dt`` s with ``setpoint`` (3,) Pa held; returns the measured pressure (3,),
        Pa.
        """
        aim = np.array(setpoint, dtype=float)
        n = max(1, math.ceil(dt / 1e-3 - 1e-6))
        _air_steps(self._held, aim, dt / n, n)
        self.pressure = np.minimum(self._state.pressure + self._state.leak, 0.0)
        return np.asarray(self.pressure + self._spread * self._random.standard_normal(3))
