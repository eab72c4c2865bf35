# ruff: noqa: PLR0912  (compiled code: flat functions over plain numbers are what the
# compiler turns into fast code)
"""What force sensor, MIDI interface and clocks make of the plant's motion, with the effects of
sensing and clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.devices.fsr import FsrCalibration, FsrConfig
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.instruments.sensor_noise import noise_levels
from pianobot_ros.emulator.plant.laws.arm import next_poll
from pianobot_ros.emulator.plant.laws.counter_random import normal, uniform
from pianobot_ros.emulator.plant.laws.sensing import (
    conductance,
    disciplined,
    drifting,
    knee_curve,
    log_curve,
    loop_of_operators,
    loop_of_state,
    power_curve,
    scanned,
    soft_ceiling,
    tanh_scale,
    two_way_gain,
    warming,
)

__all__ = [
    "FSR_MEMORY",
    "Converter",
    "FsrParameters",
    "MidiSensor",
    "Note",
    "SensorClock",
    "fsr_config",
    "fsr_parameters",
    "fsr_readings",
]


FSR_MEMORY = 10
"""Length of the array that :func:`fsr_readings` keeps its memory in: hysteresis, last force, time
under load, gain wander, three play operators or the highest force, creep, amplifier, slow creep.
"""

_LOOP_SCALE = 2.0  # N over which the loop opens
_LOADED = 0.05  # N
_CREEP_START = 0.02  # s from which decades are counted
_FAST_CREEP, _SLOW_CREEP = 0.08, 1.0  # s
_GAIN_TIME = 3.0  # s
_FRAME = 1e-3  # s, USB full-speed frame
_WANDER_PERIOD = 41.0  # s
_BEAT = 5.0  # s in which two clocks of nearly one rate come together again
_CURVES = {1: power_curve, 2: knee_curve, 3: log_curve}


class FsrParameters(NamedTuple):
    """Constants of the force sensor; effects by physical parameter."""

    gain: float
    gain_spread: float
    seed: int
    fsr_hysteresis: float
    fsr_creep: float
    fsr_saturation: float
    fsr_vacuum: float
    fsr_lag: float
    fsr_hysteresis_law: int
    fsr_creep_law: int
    fsr_saturation_law: int


def fsr_parameters(case: Case) -> FsrParameters:
    """The force sensor of a case."""
    return FsrParameters(
        gain=float(case.parameters.get("fsr_gain", 1.0)),
        gain_spread=noise_levels().fsr_gain_spread * case.repeatability,
        seed=case.seed,
        **case.constants(FsrParameters._fields),
    )


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def fsr_readings(
    p: FsrParameters,
    memory: Array,
    first: int,
    dt: float,
    force: Array,
    vacuum: Array,
    readings: Array,
) -> None:
    """Readings (n,), N by the nominal calibration and without noise, of true normal forces (n,) N
    sampled every ``dt`` s.

    ``vacuum`` (n,) is the mean gauge pressure, Pa; ``first`` the number of samples before these.
    """
    bend = tanh_scale(p.fsr_saturation) if p.fsr_saturation_law == 3 else 0.0
    for i in range(len(force)):
        f = force[i]
        value = f
        if p.fsr_hysteresis > 0.0 and p.fsr_hysteresis_law == 1:
            value -= p.fsr_hysteresis * f * 0.5 * loop_of_state(memory, f)
        elif p.fsr_hysteresis > 0.0 and p.fsr_hysteresis_law == 2:
            value += p.fsr_hysteresis * (loop_of_operators(memory, f) - f)
        elif p.fsr_hysteresis > 0.0 and p.fsr_hysteresis_law == 3:
            value = two_way_gain(memory, f, p.fsr_hysteresis)
        elif p.fsr_hysteresis > 0.0:  # Bouc and Wen: less on the way up than on the way down
            d = (f - memory[1]) / _LOOP_SCALE
            steps = max(1, int(abs(d) / 0.05) + 1)
            for _ in range(steps):
                e = d / steps
                memory[0] += e - 0.5 * abs(e) * memory[0] - 0.5 * e * abs(memory[0])
            value -= p.fsr_hysteresis * f * memory[0]
        memory[1] = f
        memory[2] = memory[2] + dt if f > _LOADED else 0.0
        if p.fsr_creep > 0.0 and p.fsr_creep_law == 1:  # a standard linear solid (Zener 1948)
            memory[7] += (f - memory[7]) * (1.0 - math.exp(-dt / 0.4))
            value += p.fsr_creep * 1.5 * memory[7]
        elif p.fsr_creep > 0.0 and p.fsr_creep_law == 2:  # a power of time (Nutting 1921)
            value += p.fsr_creep * f * ((1.0 + memory[2] / _CREEP_START) ** 0.3 - 1.0)
        elif p.fsr_creep > 0.0 and p.fsr_creep_law == 3:  # two terms of a Prony series
            memory[7] += (f - memory[7]) * (1.0 - math.exp(-dt / _FAST_CREEP))
            memory[9] += (f - memory[9]) * (1.0 - math.exp(-dt / _SLOW_CREEP))
            value += p.fsr_creep * 0.8 * (memory[7] + memory[9])
        elif p.fsr_creep > 0.0:
            value += p.fsr_creep * f * math.log10(1.0 + memory[2] / _CREEP_START)
        if p.fsr_saturation > 0.0 and value > 0.0 and p.fsr_saturation_law == 1:
            value = conductance(value, p.fsr_saturation)
        elif p.fsr_saturation > 0.0 and value > 0.0 and p.fsr_saturation_law == 2:
            value = soft_ceiling(value, p.fsr_saturation)
        elif p.fsr_saturation > 0.0 and value > 0.0 and p.fsr_saturation_law == 3:
            value = bend * math.tanh(value / bend)
        elif p.fsr_saturation > 0.0 and value > 0.0:  # p = 4 norm of the line and the ceiling
            ceiling = 5.0 / ((1.0 - min(p.fsr_saturation, 0.9)) ** -4.0 - 1.0) ** 0.25
            value /= (1.0 + (value / ceiling) ** 4.0) ** 0.25
        if p.fsr_lag > 0.0:  # the amplifier's low pass
            memory[8] += (value - memory[8]) * (1.0 - math.exp(-dt / p.fsr_lag))
            value = memory[8]
        if p.gain_spread > 0.0:
            kick = math.sqrt(2.0 * dt / _GAIN_TIME) * normal(p.seed, 51, first + i)
            memory[3] += kick - memory[3] * dt / _GAIN_TIME
        readings[i] = (
            p.gain * (1.0 + p.gain_spread * memory[3]) * value
            - p.fsr_vacuum * vacuum[i] / 100_000.0
        )


@lru_cache(maxsize=1)
def fsr_config() -> FsrConfig:
    """The force sensor and key encoder of the configuration in force."""
    return FsrConfig.load()


class Converter:
    """The microcontroller's view of force and angle: counts, and what the host makes of them."""

    def __init__(self) -> None:
        config = fsr_config()
        self._table = FsrCalibration(
            config.calibration.counts, config.calibration.force, config.sensor.bits
        ).table
        self._per_radian = config.encoder.resolution * keyboard().white.pivot

    def counts(self, reading: Array) -> NDArray[np.int64]:
        """Converter counts (n,) of readings (n,) N: the nearest in the calibration's table."""
        below = np.clip(
            np.searchsorted(self._table, np.maximum(reading, 0.0), side="right") - 1,
            0,
            len(self._table) - 2,
        )
        nearer = reading - self._table[below] > self._table[below + 1] - reading
        return np.asarray(below + nearer, dtype=np.int64)

    def force(self, counts: NDArray[np.int64]) -> Array:
        """Forces (n,), N, that the host reads from counts (n,)."""
        return np.asarray(self._table[counts])

    def angle(self, angle: Array) -> Array:
        """Angles (n,), rad, after the encoder's quantisation."""
        return np.asarray(np.rint(angle * self._per_radian) / self._per_radian)


class SensorClock:
    """The clock of the force sensor's microcontroller: nominally the host's."""

    def __init__(self, case: Case) -> None:
        value = case.strengths()
        self._skew = value.get("clock_skew", 0.0)
        self._law = case.laws.get("clock_skew", 0)
        self._error = value.get("clock_discipline", 0.0)
        self._w = 2.0 * math.pi / _WANDER_PERIOD
        self._phase = 2.0 * math.pi * uniform(case.seed, 61, 0)

    def read(self, time: Array) -> Array:
        """Times (n,) s on the microcontroller at host times (n,) s since the start: a rate error
        that wanders by a fifth.
        """
        if self._error:
            time = time + self._error * disciplined(time)
        if not self._skew:
            return time
        if self._law == 1:  # a constant rate error
            return np.asarray(time + self._skew * time)
        if self._law == 2:
            return np.asarray(time + self._skew * warming(time))
        if self._law == 3:
            return np.asarray(time + self._skew * drifting(time))
        wander = math.sin(self._phase) - np.sin(self._w * time + self._phase)
        return np.asarray(time + self._skew * (time + 0.2 / self._w * wander))


@dataclass(frozen=True)
class Note:
    """A note message: ``time`` s at which the instrument sends it, ``on``, ``note``, ``velocity`` 1
    to 127, whole unless rounding is switched off."""

    time: float
    on: bool
    note: int
    velocity: float


class MidiSensor:
    """Turns passages of the key triggers into MIDI messages."""

    def __init__(self, case: Case, *, rounded: bool = True) -> None:
        self.case = case
        self._rounded = rounded
        self._value = case.strengths()
        self._laws = case.laws
        self._drawn = 0
        self._noise = noise_levels()
        self._board = keyboard()
        self._gain = self._board.midi.velocity_gain * case.parameters.get("midi_velocity_gain", 1.0)
        self._last_velocity: float = 64  # whole, as MIDI has it
        self._lost: set[int] = set()
        self._random = np.random.default_rng([case.seed, 3])

    def notes(self, passages: Iterable[Array]) -> list[Note]:
        """Messages for trigger passages, rows of (time, on, key index, speed at the contact point),
        in order of time.
        """
        found = (
            self._note(float(t), bool(on > 0.5), int(key), float(speed))
            for t, on, key, speed in passages
        )
        return [note for note in found if note is not None]

    def _delayed(self, t: float, wait: float, velocity: float) -> float:
        """When a note that happened at ``t`` is sent, s."""
        match self._laws.get("midi_latency", 0):
            case 1:  # a constant wait
                return t + wait
            case 2:  # half of it on the line, then the next round of a poll (Törngren 1998)
                return float(next_poll(t + 0.5 * wait, 0.5 * wait))
            case 3:  # a constant part, and how far two clocks have run apart
                return t + wait * (0.7 + 0.6 * math.fmod(t / _BEAT, 1.0))
        t += wait * (1.1 - 0.2 * velocity / 127.0)
        frame = min(_FRAME, wait)
        return math.ceil(t / frame) * frame

    def _wait(self, gamma: float) -> float:
        """An extra wait, 1 on average."""
        self._drawn += 1
        match self._laws.get("midi_jitter", 0):
            case 1:  # evenly up to twice the mean, as behind a poll
                return 2.0 * float(uniform(self.case.seed, 71, self._drawn))
            case 2:  # most notes at once, some behind a full buffer (Kleinrock 1975)
                return 4.0 if uniform(self.case.seed, 72, self._drawn) < 0.25 else 0.0
            case 3:  # many small ones: normal, cut off at none (central limit, Laplace 1812)
                return max(1.0 + 0.5 * float(normal(self.case.seed, 73, self._drawn)), 0.0)
        return gamma

    def _note(self, t: float, on: bool, key: int, speed: float) -> Note | None:
        random, noise = self._random, self._noise
        # Draw everything always, so that switching one effect on does not shift the others' random
        # numbers.
        scatter, late, gamma, chance = (
            random.standard_normal(),
            random.standard_normal(),
            random.gamma(1.5),
            random.random(),
        )
        velocity = self._gain * speed
        if scan := self._value.get("velocity_scan", 0.0):
            velocity = scanned(velocity, speed, scan)
        share = self._value.get("midi_velocity_curve", 0.0)
        curve = _CURVES.get(self._laws.get("midi_velocity_curve", 0))
        if share and curve is not None:
            velocity += share * (curve(velocity) - velocity)
        elif share:  # a logistic through 0 and 127
            low, high = 1.0 / (1.0 + math.exp(2.2)), 1.0 / (1.0 + math.exp(-5.0))
            x = min(max(velocity / 127.0, 0.0), 1.0)
            bent = 127.0 * (1.0 / (1.0 + math.exp(-7.2 * x + 2.2)) - low) / (high - low)
            velocity += share * (bent - velocity)
        velocity += noise.midi_velocity * self.case.noise * scatter
        value = min(max(round(velocity) if self._rounded else velocity, 1), 127)
        t += noise.midi_time * self.case.noise * abs(late)
        if wait := self._value.get("midi_latency", 0.0):
            t = self._delayed(t, wait, value)
        if jitter := self._value.get("midi_jitter", 0.0):
            t += jitter * self._wait(gamma / 1.5)
        note = self._board.notes[key]
        if share := self._value.get("stuck_contact", 0.0):
            if on and chance < 0.25 * share:
                self._lost.add(note)
                return None
            if not on and note in self._lost:
                self._lost.discard(note)
                return None
            if chance < share:
                value = self._last_velocity
        if on:
            self._last_velocity = value
        return Note(t, on, note, value)
