"""What force sensor, MIDI interface and clocks make of the plant's motion, with the effects of sensing and clock."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pianobot_ros.cell.geometry import keyboard
from pianobot_ros.devices.fsr import Calibration, FsrConfig, load_config
from pianobot_ros.emulator.plant.case import Case
from pianobot_ros.emulator.plant.noise import noise_levels
from pianobot_ros.emulator.plant.random import normal, uniform

__all__ = [
    "FSR_MEMORY",
    "Converter",
    "DeviceClock",
    "FsrParameters",
    "MidiSensor",
    "Note",
    "fsr_config",
    "fsr_parameters",
    "fsr_readings",
]

Array = NDArray[np.float64]

FSR_MEMORY = 4
"""Length of the array that :func:`fsr_readings` keeps its memory in: hysteresis, last force, time under load, gain wander."""

_LOOP_SCALE = 2.0  # N over which the loop opens
_LOADED = 0.05  # N
_CREEP_START = 0.02  # s from which decades are counted
_GAIN_TIME = 3.0  # s
_FRAME = 1e-3  # s, USB full-speed frame
_WANDER_PERIOD = 41.0  # s


class FsrParameters(NamedTuple):
    """Constants of the force sensor; effects by physical parameter."""

    gain: float
    gain_spread: float
    seed: int
    fsr_hysteresis: float
    fsr_creep: float
    fsr_saturation: float
    fsr_vacuum: float


def fsr_parameters(case: Case) -> FsrParameters:
    """The force sensor of a case."""
    noise = noise_levels()
    value = case.strengths()
    return FsrParameters(
        float(case.parameters.get("fsr_gain", 1.0)), noise.fsr_gain_spread * case.repeatability, case.seed,
        value.get("fsr_hysteresis", 0.0), value.get("fsr_creep", 0.0), value.get("fsr_saturation", 0.0),
        value.get("fsr_vacuum", 0.0),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def fsr_readings(
    p: FsrParameters, memory: Array, first: int, dt: float, force: Array, vacuum: Array, readings: Array
) -> None:
    """Readings (n,), N by the nominal calibration and without noise, of true normal forces (n,) N sampled every ``dt`` s.

    ``vacuum`` (n,) is the mean gauge pressure, Pa; ``first`` the number of samples before these.
    """
    for i in range(len(force)):
        f = force[i]
        value = f
        if p.fsr_hysteresis > 0.0:  # Bouc and Wen: less on the way up than on the way down
            d = (f - memory[1]) / _LOOP_SCALE
            steps = max(1, int(abs(d) / 0.05) + 1)
            for _ in range(steps):
                e = d / steps
                memory[0] += e - 0.5 * abs(e) * memory[0] - 0.5 * e * abs(memory[0])
            value -= p.fsr_hysteresis * f * memory[0]
        memory[1] = f
        memory[2] = memory[2] + dt if f > _LOADED else 0.0
        if p.fsr_creep > 0.0:
            value += p.fsr_creep * f * math.log10(1.0 + memory[2] / _CREEP_START)
        if p.fsr_saturation > 0.0 and value > 0.0:  # p = 4 norm of the line and the ceiling
            ceiling = 5.0 / ((1.0 - min(p.fsr_saturation, 0.9)) ** -4.0 - 1.0) ** 0.25
            value /= (1.0 + (value / ceiling) ** 4.0) ** 0.25
        if p.gain_spread > 0.0:
            kick = math.sqrt(2.0 * dt / _GAIN_TIME) * normal(p.seed, 51, first + i)
            memory[3] += kick - memory[3] * dt / _GAIN_TIME
        readings[i] = p.gain * (1.0 + p.gain_spread * memory[3]) * value - p.fsr_vacuum * vacuum[i] / 100_000.0


@lru_cache(maxsize=1)
def fsr_config() -> FsrConfig:
    """The force sensor and key encoder of the configuration in force."""
    return load_config()


class Converter:
    """The microcontroller's view of force and angle: counts, and what the host makes of them."""

    def __init__(self) -> None:
        config = fsr_config()
        self._table = Calibration(config.calibration.counts, config.calibration.force, config.sensor.bits).table
        self._per_radian = config.encoder.resolution * keyboard().white.pivot

    def counts(self, reading: Array) -> NDArray[np.int64]:
        """Converter counts (n,) of readings (n,) N: the nearest in the calibration's table."""
        below = np.clip(
            np.searchsorted(self._table, np.maximum(reading, 0.0), side="right") - 1, 0, len(self._table) - 2
        )
        nearer = reading - self._table[below] > self._table[below + 1] - reading
        return np.asarray(below + nearer, dtype=np.int64)

    def force(self, counts: NDArray[np.int64]) -> Array:
        """Forces (n,), N, that the host reads from counts (n,)."""
        return np.asarray(self._table[counts])

    def angle(self, angle: Array) -> Array:
        """Angles (n,), rad, after the encoder's quantisation."""
        return np.asarray(np.rint(angle * self._per_radian) / self._per_radian)


class DeviceClock:
    """The clock of the force sensor's microcontroller: nominally the host's."""

    def __init__(self, case: Case) -> None:
        self._skew = case.strengths().get("clock_skew", 0.0)
        self._w = 2.0 * math.pi / _WANDER_PERIOD
        self._phase = 2.0 * math.pi * uniform(case.seed, 61, 0)

    def read(self, time: Array) -> Array:
        """Times (n,) s on the microcontroller at host times (n,) s since the start: a rate error that wanders by a fifth."""
        wander = math.sin(self._phase) - np.sin(self._w * time + self._phase)
        return np.asarray(time + self._skew * (time + 0.2 / self._w * wander))


@dataclass(frozen=True)
class Note:
    """A note message: ``time`` s at which the instrument sends it, ``on``, ``note``, ``velocity`` 1 to 127, whole unless rounding
    is switched off."""

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
        self._noise = noise_levels()
        self._board = keyboard()
        self._gain = self._board.midi.velocity_gain * case.parameters.get("midi_velocity_gain", 1.0)
        self._last_velocity: float = 64  # whole, as MIDI has it
        self._lost: set[int] = set()
        self._random = np.random.default_rng([case.seed, 3])

    def notes(self, passages: Iterable[Array]) -> list[Note]:
        """Messages for trigger passages, rows of (time, on, key index, speed at the contact point), in order of time."""
        found = (self._note(float(t), bool(on > 0.5), int(key), float(speed)) for t, on, key, speed in passages)
        return [note for note in found if note is not None]

    def _note(self, t: float, on: bool, key: int, speed: float) -> Note | None:
        random, noise = self._random, self._noise
        # Draw everything always, so that switching one effect on does not shift the others' random numbers.
        scatter, late, gamma, chance = (
            random.standard_normal(),
            random.standard_normal(),
            random.gamma(1.5),
            random.random(),
        )
        velocity = self._gain * speed
        if share := self._value.get("midi_velocity_curve", 0.0):  # a logistic through 0 and 127
            low, high = 1.0 / (1.0 + math.exp(2.2)), 1.0 / (1.0 + math.exp(-5.0))
            x = min(max(velocity / 127.0, 0.0), 1.0)
            bent = 127.0 * (1.0 / (1.0 + math.exp(-7.2 * x + 2.2)) - low) / (high - low)
            velocity += share * (bent - velocity)
        velocity += noise.midi_velocity * self.case.noise * scatter
        value = min(max(round(velocity) if self._rounded else velocity, 1), 127)
        t += noise.midi_time * self.case.noise * abs(late)
        if wait := self._value.get("midi_latency", 0.0):
            t += wait * (1.1 - 0.2 * value / 127.0)
            frame = min(_FRAME, wait)
            t = math.ceil(t / frame) * frame
        if jitter := self._value.get("midi_jitter", 0.0):
            t += jitter * gamma / 1.5
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
