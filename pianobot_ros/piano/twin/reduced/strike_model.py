"""The reduced one-finger strike: milliseconds instead of a whole hand, for searches that need
thousands of strikes.

It has the same nominal laws as the whole-hand twin (docs/architecture.md, *The nominal cell*) and
three ways of running: the whole strike from wrist motion; the hand alone on a key that moves as
measured; the key alone under a measured force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import Midi
from pianobot_ros.cell.recordings.keystroke import Keystroke
from pianobot_ros.piano.twin.reduced.strike_geometry import finger_model, key_model, stiffness_of
from pianobot_ros.piano.twin.reduced.strike_kernel import FREE, HELD_KEY, drive_key, roll
from pianobot_ros.piano.twin.reduced.strike_laws import KEY_FRICTION, vector
from pianobot_ros.piano.twin.reduced.strike_records import Drive, FingerModel, KeyModel

__all__ = ["GRID", "StrikeInput", "StrikeModel", "Stroke", "key_strokes", "strike_model"]


GRID = 1e-3  # s: spacing of inputs and outputs
SUBSTEPS = 5  # 0.2 ms inside


@dataclass(frozen=True)
class StrikeInput:
    """Motion of the finger's base on a grid of :data:`GRID` s from ``start`` s: position, velocity,
    acceleration (n, 3) in the base frame; ``frame`` (3, 3): the finger's directions (across,
    heading, up) as columns; ``stiffness`` (n,) N m/rad.
    """

    start: float
    position: Array
    velocity: Array
    acceleration: Array
    frame: Array
    stiffness: Array

    @property
    def time(self) -> Array:
        """The grid (n,), s."""
        return np.asarray(self.start + GRID * np.arange(len(self.position)), dtype=np.float64)


@dataclass(frozen=True)
class Stroke:
    """What a rollout gives on the grid: key ``angle`` rad, ``rate`` rad/s, contact ``force`` N,
    ``lever`` m, each (n,).
    """

    start: float
    angle: Array
    rate: Array
    force: Array
    lever: Array

    @property
    def time(self) -> Array:
        """The grid (n,), s."""
        return np.asarray(self.start + GRID * np.arange(self.angle.size), dtype=np.float64)


class StrikeModel:
    """One finger on one key of the configured cell."""

    def __init__(self, finger: FingerModel, key: KeyModel, substeps: int = SUBSTEPS) -> None:
        self.finger, self.key, self.substeps = finger, key, substeps

    def input(
        self,
        time: Array,
        wrist: Array,
        rotation: Array,
        pressure: float | Array,
        start: float,
        end: float,
    ) -> StrikeInput:
        """Input from wrist positions (n, 3) m and rotation vectors (n, 3) or (3,) at ``time`` (n,)
        s.

        Positions are interpolated by a cubic spline, so smooth measured ones first. ``pressure``:
        Pa, one number or one for each grid point. Small changes of rotation within the strike move
        the base as they would move the resting tip.
        """
        if len(time) < 4:
            raise PianobotError("a strike needs at least four samples of the wrist's motion")
        grid = start + GRID * np.arange(max(2, round((end - start) / GRID) + 1))
        inside = np.clip(grid, time[0], time[-1])
        turns = np.asarray(rotation, dtype=float)
        mean = Rotation.from_rotvec(turns if turns.ndim == 1 else turns.mean(0))
        base = np.asarray(wrist, dtype=float) + mean.apply(self.finger.base)
        if turns.ndim == 2 and np.ptp(turns, axis=0).max() > 1e-4:
            tip = self.finger.base + _rest_reach(self.finger)
            base = base + Rotation.from_rotvec(turns).apply(tip) - mean.apply(tip)
        spline = CubicSpline(time, base, axis=0)
        outside = (grid < time[0]) | (grid > time[-1])
        velocity, acceleration = spline(inside, 1), spline(inside, 2)
        velocity[outside] = acceleration[outside] = 0.0
        cy, sy = np.cos(self.finger.yaw), np.sin(self.finger.yaw)
        frame = mean.as_matrix() @ np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        stiffness = np.full(grid.shape, stiffness_of(pressure))
        arrays = [
            np.ascontiguousarray(x)
            for x in (spline(inside), velocity, acceleration, frame, stiffness)
        ]
        return StrikeInput(start, arrays[0], arrays[1], arrays[2], arrays[3], arrays[4])

    def strike(
        self, given: StrikeInput, values: Mapping[str, float] | None = None, resting: float = 0.0
    ) -> Stroke:
        """The whole strike: finger and key, which starts at ``resting`` rad where friction holds
        it.
        """
        return self._roll(FREE, given, np.array([resting]), np.zeros(1), values)

    def press(
        self,
        given: StrikeInput,
        angle: Array,
        rate: Array,
        values: Mapping[str, float] | None = None,
    ) -> Stroke:
        """Hand and contact alone: the key moves as given (``angle`` rad, ``rate`` rad/s on the grid
        of ``given``).
        """
        return self._roll(
            HELD_KEY, given, np.ascontiguousarray(angle), np.ascontiguousarray(rate), values
        )

    def drive(
        self,
        start: float,
        force: Array,
        lever: float | Array,
        values: Mapping[str, float] | None = None,
        resting: float = 0.0,
    ) -> Stroke:
        """The key alone under a given contact force (n,) N on the grid, at a lever (m) from its
        hinge.

        It starts at ``resting`` rad where friction holds it.
        """
        out = np.zeros((2, force.size))
        arm = np.ascontiguousarray(np.broadcast_to(lever, force.shape), dtype=float)
        parameters = self._vector(values)
        if drive_key(
            GRID,
            np.ascontiguousarray(force),
            arm,
            resting,
            self.key,
            parameters,
            self.substeps,
            out,
        ):
            raise PianobotError("the key model became unstable at these parameters")
        return Stroke(start, out[0], out[1], np.asarray(force), arm)

    def _vector(self, values: Mapping[str, float] | None) -> Array:
        parameters = vector(dict(values or {}))
        parameters[KEY_FRICTION] += self.key.friction
        return parameters

    def _roll(
        self,
        mode: int,
        given: StrikeInput,
        angle: Array,
        rate: Array,
        values: Mapping[str, float] | None,
    ) -> Stroke:
        out = np.zeros((4, len(given.position)))
        motion = given.position, given.velocity, given.acceleration, given.frame
        drive = Drive(GRID, *motion, given.stiffness, angle, rate)
        parameters = self._vector(values)
        failed = roll(mode, drive, self.finger, self.key, parameters, self.substeps, out)
        if failed:
            raise PianobotError("the strike model became unstable at these parameters")
        return Stroke(given.start, *out)


@lru_cache(maxsize=64)
def strike_model(finger: str, note: int) -> StrikeModel:
    """The model of ``finger`` on the key ``note`` of the configured cell."""
    return StrikeModel(finger_model(finger), key_model(note))


def key_strokes(stroke: Stroke, note: int, radius: float, midi: Midi) -> list[Keystroke]:
    """Keystrokes of a rollout by the trigger of Fig. 2(c), crossings by cubic Hermite interpolation
    of angle and rate.
    """
    a, w, t = stroke.angle, stroke.rate, stroke.time
    found: list[Keystroke] = []
    begun: tuple[float, float] | None = None
    rising = (a[:-1] < midi.trigger_on) & (a[1:] >= midi.trigger_on)
    falling = (a[:-1] >= midi.trigger_off) & (a[1:] < midi.trigger_off)
    for i in np.flatnonzero(rising | falling):
        if rising[i] and begun is None:
            begun = _crossing(t[i], a[i], a[i + 1], w[i], w[i + 1], midi.trigger_on)
        elif falling[i] and begun is not None:
            end, rate = _crossing(t[i], a[i], a[i + 1], w[i], w[i + 1], midi.trigger_off)
            found.append(
                Keystroke(
                    note, begun[0], radius * abs(begun[1]), radius * abs(rate), end - begun[0]
                )
            )
            begun = None
    if begun is not None:
        found.append(Keystroke(note, begun[0], radius * abs(begun[1]), float("nan"), float("nan")))
    return found


def _crossing(
    t: float, a0: float, a1: float, w0: float, w1: float, level: float
) -> tuple[float, float]:
    """Time and rate at which a cubic between two grid points meets ``level``."""
    f = (level - a0) / (a1 - a0)
    for _ in range(3):
        h = f * f * (3 - 2 * f)
        value = a0 + h * (a1 - a0) + GRID * f * (1 - f) * ((1 - f) * w0 - f * w1)
        slope = 6 * f * (1 - f) * (a1 - a0) + GRID * (
            (1 - f) * (1 - 3 * f) * w0 - f * (2 - 3 * f) * w1
        )
        if abs(slope) < 1e-12:
            break
        f = min(1.0, max(0.0, f - (value - level) / slope))
    rate = (6 * f * (1 - f) * (a1 - a0)) / GRID + (1 - f) * (1 - 3 * f) * w0 - f * (2 - 3 * f) * w1
    return t + f * GRID, rate


def _rest_reach(finger: FingerModel) -> Array:
    """From the finger's base to its tip at rest, (3,) m in the wrist frame."""
    out = float(np.sum(finger.length * np.cos(finger.pitch)))
    down = float(np.sum(finger.length * np.sin(finger.pitch)))
    return np.array([-np.sin(finger.yaw) * out, np.cos(finger.yaw) * out, -down])
