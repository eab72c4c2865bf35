"""The twin as a cell that runs: commands in, samples, MIDI events and keystrokes out, in chunks of steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.geometry import FINGERS, Midi
from pianobot_ros.cell.keystroke import Keystroke, NoteEvent, midi_velocity
from pianobot_ros.twin.arm import ArmTracker, home_pose
from pianobot_ros.twin.model import TwinModel, TwinOptions, build_twin, switchboard

__all__ = ["KeyTrigger", "Samples", "Twin", "TwinDivergedError", "check_pose", "check_pressure", "warning_count"]

Array = NDArray[np.float64]


class TwinDivergedError(PianobotError):
    """The physics became unstable."""


def warning_count(data: mujoco.MjData) -> int:
    """How many warnings MuJoCo has counted: a diverging state, a full buffer."""
    return int(np.sum(data.warning.number))


def check_pose(pose: ArrayLike) -> Array:
    """``pose`` as an array (6,). Raises PianobotError unless it is six finite numbers."""
    target = np.array(pose, dtype=float)
    if target.shape != (6,) or not np.isfinite(target).all():
        raise PianobotError("a wrist command needs six finite numbers: position in m and rotation vector in rad")
    return target


def check_pressure(pressure: Mapping[str, float]) -> dict[str, float]:
    """``pressure`` by finger, Pa gauge. Raises PianobotError for unknown fingers and numbers that are not finite."""
    for name, value in pressure.items():
        if name not in FINGERS or not np.isfinite(value):
            raise PianobotError(f"vacuum of '{name}' set to {value}: give finite Pa for {', '.join(FINGERS)}")
    return dict(pressure)


class KeyTrigger:
    """Note events of all keys from their angles, chunk by chunk (Fig. 2(c) and Eq. 2)."""

    def __init__(self, notes: tuple[int, ...], radius: Array, midi: Midi, gain: float = 1.0) -> None:
        self.notes, self.radius = notes, radius
        self.midi = midi.model_copy(update={"velocity_gain": midi.velocity_gain * gain})
        self.reset()

    def reset(self) -> None:
        """All keys up."""
        self._time: float | None = None
        self._angle: Array = np.zeros(len(self.notes))
        self._down = np.zeros(len(self.notes), dtype=bool)
        self._start: dict[int, tuple[float, float]] = {}
        self._peak = np.zeros(len(self.notes))

    def feed(self, time: Array, angle: Array, force: Array) -> tuple[list[NoteEvent], list[Keystroke]]:
        """Events and finished keystrokes in the samples ``time`` (n,), ``angle`` and ``force`` (n, keys)."""
        if self._time is None:
            self._time, self._angle = float(time[0]), angle[0].copy()
        np.maximum(self._peak, force.max(axis=0), out=self._peak)
        events: list[NoteEvent] = []
        strokes: list[Keystroke] = []
        on, off = self.midi.trigger_on, self.midi.trigger_off
        may = np.where(self._down, angle.min(axis=0) < off, angle.max(axis=0) >= on)
        for key in np.flatnonzero(may | self._down & (angle.max(axis=0) >= on)).tolist():
            t = np.concatenate([[self._time], time])
            a = np.concatenate([[self._angle[key]], angle[:, key]])
            for i in range(1, len(t)):
                if not self._down[key] and a[i - 1] < on <= a[i]:
                    self._press(key, *_crossing(t, a, i, on), events)
                elif self._down[key] and a[i - 1] >= off > a[i]:
                    self._release(key, *_crossing(t, a, i, off), events, strokes)
        resting = ~self._down & (force[-1] == 0.0) & (angle[-1] < off)
        self._peak[resting] = 0.0
        self._time, self._angle = float(time[-1]), angle[-1].copy()
        return sorted(events, key=lambda e: e.time), sorted(strokes, key=lambda s: s.onset)

    def _press(self, key: int, time: float, slope: float, events: list[NoteEvent]) -> None:
        speed = float(self.radius[key]) * slope
        self._down[key], self._start[key] = True, (time, speed)
        events.append(NoteEvent(time, True, self.notes[key], midi_velocity(speed, self.midi)))

    def _release(self, key: int, time: float, slope: float, events: list[NoteEvent], strokes: list[Keystroke]) -> None:
        onset, v_pre = self._start.pop(key)
        v_rel, self._down[key] = float(self.radius[key]) * abs(slope), False
        events.append(NoteEvent(time, False, self.notes[key], midi_velocity(v_rel, self.midi)))
        strokes.append(Keystroke(self.notes[key], onset, v_pre, v_rel, time - onset, peak_force=float(self._peak[key])))
        self._peak[key] = 0.0


def _crossing(t: Array, a: Array, i: int, level: float) -> tuple[float, float]:
    slope = (a[i] - a[i - 1]) / (t[i] - t[i - 1])
    return float(t[i - 1] + (level - a[i - 1]) / slope), float(slope)


@dataclass(frozen=True)
class Samples:
    """A chunk of the twin's life at every physics step: ``time`` (n,) s since reset; ``angle`` rad, ``rate`` rad/s and contact
    ``force`` N (n, keys); arm ``joint`` rad (n, 6); wrist ``pose`` (n, 6) and its ``twist`` (n, 6)."""

    time: Array
    angle: Array
    rate: Array
    force: Array
    joint: Array
    pose: Array
    twist: Array
    events: list[NoteEvent] = field(default_factory=list)
    strokes: list[Keystroke] = field(default_factory=list)


class Twin:
    """One simulated cell. ``parameters`` may be changed between chunks; ``reset`` starts over.

    ``switches`` holds the memory of the keys' actions and what happened in them, where the options give them parts.
    """

    def __init__(self, options: TwinOptions | None = None, pose: ArrayLike | None = None) -> None:
        self.cell: TwinModel = build_twin(options)
        self.data = mujoco.MjData(self.cell.model)
        self.switches = switchboard(self.cell)
        self._home = np.array(home_pose() if pose is None else pose, dtype=float)
        self.tracker = ArmTracker(self.cell.timestep, self._home)
        self.pressure: Array = np.zeros(3)
        self.trigger = self._new_trigger()
        self.reset()

    def _new_trigger(self) -> KeyTrigger:
        gain = self.cell.options.factor("midi_velocity_gain")
        return KeyTrigger(self.cell.notes, self.cell.radius, self.cell.board.midi, gain)

    @property
    def time(self) -> float:
        """Simulated time since reset, s."""
        return float(self.data.time)

    @property
    def pose(self) -> Array:
        """Pose (6,) of the wrist now."""
        return np.array(self.tracker.pose)

    def reset(self, pose: ArrayLike | None = None) -> None:
        """At rest at ``pose`` (6,), by default the last starting pose; the vacuum stays as it is."""
        if pose is not None:
            self._home = np.array(pose, dtype=float)
        self.tracker.reset(self._home)
        mujoco.mj_resetData(self.cell.model, self.data)
        self.data.qpos[:6] = self.tracker.joint
        self.target = self._home.copy()
        self.trigger.reset()
        if self.switches:
            self.switches.reset()
        self.steps = 0

    def command_wrist(self, pose: ArrayLike) -> None:
        """Wanted wrist pose (6,), held until the next one. Raises PianobotError for numbers that are not finite."""
        self.target = check_pose(pose)

    def command_vacuum(self, pressure: Mapping[str, float]) -> None:
        """Wanted vacuum by finger, Pa gauge, obeyed at once. Raises PianobotError for unknown fingers."""
        for name, value in check_pressure(pressure).items():
            self.pressure[FINGERS.index(name)] = value
        self.cell.set_pressure(self.pressure)

    def set_parameters(self, parameters: Mapping[str, float]) -> None:
        """Set the parameters' factors; what is not named becomes nominal."""
        self.cell.set_parameters(parameters)
        self.cell.set_pressure(self.pressure)
        gain = self.cell.options.factor("midi_velocity_gain")
        self.trigger.midi = self.cell.board.midi.model_copy(
            update={"velocity_gain": self.cell.board.midi.velocity_gain * gain}
        )

    def step(self, count: int, targets: Array | None = None) -> Samples:
        """Advance by ``count`` steps, towards ``targets`` (count, 6) or the last commanded pose.

        Raises TwinDivergedError if MuJoCo warns, PianobotError if the arm cannot reach; the state is then that before.
        """
        wanted = np.broadcast_to(self.target, (count, 6)) if targets is None else targets
        cell = self.cell
        before = self.tracker.pose.copy(), self.tracker.rate.copy()
        control, ahead, ahead_rate = self.tracker.advance(wanted)
        # like angles and forces, at the start of each step
        pose, twist = np.vstack([before[0], ahead[:-1]])[:count], np.vstack([before[1], ahead_rate[:-1]])[:count]
        model, data = cell.model, self.data
        time, nv = np.empty(count), model.nv
        qpos, qvel, sensed = np.empty((count, model.nq)), np.empty((count, nv)), np.empty((count, model.nsensordata))
        # The fields' views are taken once: a step in Python costs little more than the step itself.
        q, v, s, u, mj_step = data.qpos, data.qvel, data.sensordata, data.ctrl, mujoco.mj_step
        switches = self.switches
        for k in range(count):
            time[k], qpos[k], qvel[k] = data.time, q, v
            u[:6] = control[k]
            if switches:
                switches.update(data)
            mj_step(model, data)
            sensed[k] = s  # of the state before the step
        if warning_count(data):
            raise TwinDivergedError("the physics became unstable: reset it, with a smaller step or softer joints")
        self.steps += count
        angle = qpos[:, cell.key_qpos]
        force = sensed[:, cell.force_index] * cell.options.factor("fsr_gain")
        events, strokes = self.trigger.feed(time, angle, force)
        return Samples(time, angle, qvel[:, cell.key_dof], force, qpos[:, :6], pose, twist, events, strokes)
