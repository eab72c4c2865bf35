"""The twin as a cell that runs: commands in, samples, MIDI events and keystrokes out, in chunks of
steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.recordings.keystroke import Keystroke, NoteEvent
from pianobot_ros.piano.twin.model.arm import ArmTracker, home_pose
from pianobot_ros.piano.twin.model.cell_model import TwinModel, TwinOptions, build_twin, switchboard
from pianobot_ros.piano.twin.stepping.key_trigger import KeyTrigger
from pianobot_ros.piano.twin.stepping.laws import Laws
from pianobot_ros.piano.twin.stepping.step_laws import StepLaws

__all__ = [
    "CellTwin",
    "Samples",
    "TwinDivergedError",
    "check_pose",
    "check_pressure",
    "warning_count",
]


EVEN = 1.0  # Pa: a smaller change of pressure waits for more of it
BREATHING = 4e-3  # s between two pressures, where they depart from their setpoints


class TwinDivergedError(PianobotError):
    """The physics became unstable."""


def warning_count(data: mujoco.MjData) -> int:
    """How many warnings MuJoCo has counted: a diverging state, a full buffer."""
    return int(sum(data.warning.number.tolist()))


def check_pose(pose: ArrayLike) -> Array:
    """``pose`` as an array (6,). Raises PianobotError unless it is six finite numbers."""
    target = np.array(pose, dtype=float)
    if target.shape != (6,) or not all(map(math.isfinite, target.tolist())):
        raise PianobotError(
            "a wrist command needs six finite numbers: position in m and rotation vector in rad"
        )
    return target


def check_pressure(pressure: Mapping[str, float]) -> dict[str, float]:
    """``pressure`` by finger, Pa gauge. Raises PianobotError for unknown fingers and numbers that
    are not finite.
    """
    for name, value in pressure.items():
        if name not in FINGERS or not np.isfinite(value):
            raise PianobotError(
                f"vacuum of '{name}' set to {value}: give finite Pa for {', '.join(FINGERS)}"
            )
    return dict(pressure)


@dataclass(frozen=True)
class Samples:
    """A chunk of the twin's life at every physics step: ``time`` (n,) s since reset; ``angle`` rad,
    ``rate`` rad/s and contact ``force`` N (n, keys); arm ``joint`` rad and its ``speed`` rad/s (n,
    6); wrist ``pose`` (n, 6), its ``twist`` (n, 6) and its ``target`` (n, 6), which it is told.
    """

    time: Array
    angle: Array
    rate: Array
    force: Array
    joint: Array
    speed: Array
    pose: Array
    twist: Array
    target: Array
    events: list[NoteEvent] = field(default_factory=list)
    strokes: list[Keystroke] = field(default_factory=list)


class _Kept(NamedTuple):
    """What is kept of steps: times (n,) and MuJoCo's state and sensors (n, …) at their starts."""

    time: Array
    q: Array
    v: Array
    sensed: Array


class CellTwin:
    """One simulated cell. ``parameters`` may be changed between chunks; ``reset`` starts over.

    ``switches`` holds the memory of the keys' actions and what happened in them, where the options
    give them parts. ``laws`` are its departures from the nominal cell (None: none); see
    :meth:`correct`.
    """

    def __init__(
        self,
        options: TwinOptions | None = None,
        pose: ArrayLike | None = None,
        laws: Laws | None = None,
    ) -> None:
        self.cell: TwinModel = build_twin(options)
        self.data = mujoco.MjData(self.cell.model)
        self.switches = switchboard(self.cell)
        self._home = np.array(home_pose() if pose is None else pose, dtype=float)
        self.tracker = ArmTracker(self.cell.timestep, self._home)
        self.pressure: Array = np.zeros(3)
        self.vacuum: Array = np.zeros(3)
        self._own = dict(self.cell.options.parameters)
        self.laws: Laws | None = None
        self._acting = StepLaws(self.cell, self.data, {})
        self.trigger = KeyTrigger(self.cell.notes, self.cell.radius, self.cell.board.midi)
        self.reset()
        self.correct(laws)

    @property
    def time(self) -> float:
        """Simulated time since reset, s."""
        return float(self.data.time)

    @property
    def pose(self) -> Array:
        """Pose (6,) of the wrist now."""
        return np.array(self.tracker.pose)

    def reset(self, pose: ArrayLike | None = None) -> None:
        """At rest at ``pose`` (6,), by default the last starting pose; the vacuum stays as it
        is.
        """
        if pose is not None:
            self._home = np.array(pose, dtype=float)
        self.tracker.reset(self._home)
        mujoco.mj_resetData(self.cell.model, self.data)
        self.data.qpos[:6] = self.tracker.joint
        self.target = self._home.copy()
        self._felt = 0.0
        self.trigger.reset()
        if self.switches:
            self.switches.reset()
        self._acting.reset()
        self._begin()
        self.steps = 0

    def _begin(self) -> None:
        """The laws' session begins now, with the vacuum that there is."""
        if self.laws:
            self.laws.reset()
            if self.laws.vacuum:
                self.laws.pressure(np.array([self.time]), self.vacuum)

    def correct(self, laws: Laws | None) -> None:
        """Depart from the nominal cell by ``laws`` from now on, or no more (None)."""
        self._acting.remove()
        self.laws = laws
        self._begin()
        self._acting = StepLaws(self.cell, self.data, laws.numbers if laws else {})
        self.set_parameters(self._own)

    def command_wrist(self, pose: ArrayLike) -> None:
        """Wanted wrist pose (6,), held until the next one. Raises PianobotError for numbers that
        are not finite.
        """
        self.target = check_pose(pose)

    def command_vacuum(self, pressure: Mapping[str, float]) -> None:
        """Wanted vacuum by finger, Pa gauge. Raises PianobotError for unknown fingers."""
        for name, value in check_pressure(pressure).items():
            self.pressure[FINGERS.index(name)] = value
        if not self.laws or not self.laws.vacuum:
            self._obey(self.pressure)

    def _obey(self, pressure: Array) -> None:
        self.vacuum = pressure.copy()
        self.cell.set_pressure(pressure, self.laws.stiffness(pressure) if self.laws else 1.0)

    def set_parameters(self, parameters: Mapping[str, float]) -> None:
        """Set the parameters' factors, but for those that the laws set; what is not named becomes
        nominal.
        """
        self._own = dict(parameters)
        self.cell.set_parameters(self._own | dict(self.laws.parameters if self.laws else {}))
        self._acting.set_model()
        self._obey(self.vacuum)
        midi, gain = self.cell.board.midi, self.cell.options.factor("midi_velocity_gain")
        if self.laws:
            on, off = self.laws.triggers()
            on = max(midi.trigger_on + on, 1e-3)
            off = min(max(midi.trigger_off + off, 5e-4), on)
            midi = midi.model_copy(update={"trigger_on": on, "trigger_off": off})
        law = (self.laws.velocity, self.laws.late) if self.laws else (None, None)
        self.trigger.set(midi, gain, *law)

    def step(self, count: int, targets: Array | None = None) -> Samples:
        """Advance by ``count`` steps, towards ``targets`` (count, 6) or the last commanded pose.

        Raises TwinDivergedError if MuJoCo warns, PianobotError if the arm cannot reach; the state
        is then that before.
        """
        wanted = np.broadcast_to(self.target, (count, 6)) if targets is None else targets
        cell, model = self.cell, self.cell.model
        kept = _Kept(
            np.empty(count),
            np.empty((count, model.nq)),
            np.empty((count, model.nv)),
            np.empty((count, model.nsensordata)),
        )
        pose, twist = np.empty((count, 6)), np.empty((count, 6))
        piece = self._piece(count)
        for i in range(0, count, piece):
            part = slice(i, min(i + piece, count))
            control = self._move(wanted[part], pose[part], twist[part])
            self._run(control, kept, i)
        if warning_count(self.data):
            raise TwinDivergedError(
                "the physics became unstable: reset it, with a smaller step or softer joints"
            )
        angle, force = kept.q[:, cell.key_qpos], kept.sensed[:, cell.force_index]
        reading = self._read(kept.time, force * cell.options.factor("fsr_gain"))
        events, strokes = self.trigger.feed(kept.time, angle, reading)
        rate, arm = kept.v[:, cell.key_dof], (kept.q[:, :6], kept.v[:, :6])
        told = (pose, twist, wanted)
        return Samples(kept.time, angle, rate, reading, *arm, *told, events, strokes)

    def _piece(self, count: int) -> int:
        """How many of ``count`` steps may pass until the laws look again."""
        if not self.laws:
            return count
        length = min(self.laws.feeling, BREATHING if self.laws.vacuum else np.inf)
        return int(min(max(1.0, length / self.cell.timestep + 1e-6), count))

    def _run(self, control: Array, kept: _Kept, first: int) -> None:
        """Steps with ``control`` (n, 6), kept from place ``first`` on."""
        model, data = self.cell.model, self.data
        time, qpos, qvel, sensed = kept
        # The fields' views are taken once: a step in Python costs little more than the step itself.
        q, v, s, u, mj_step = data.qpos, data.qvel, data.sensordata, data.ctrl[:6], mujoco.mj_step
        switches = self.switches
        acting = self._acting if self._acting.acts else None
        for k, row in enumerate(control, first):
            time[k], qpos[k], qvel[k] = data.time, q, v
            u[:] = row
            if switches:
                switches.update(data)
            if acting:
                acting()
            mj_step(model, data)
            sensed[k] = s  # of the state before the step
        self.steps += len(control)
        if self.laws and np.isfinite(self.laws.feeling):
            self._felt = float(s[self.cell.force_index].sum())

    def _move(self, wanted: Array, pose: Array, twist: Array) -> Array:
        """Controls for the steps towards ``wanted`` (n, 6); ``pose`` and ``twist`` (n, 6) become
        the wrist's at the start of each, like angles and forces.
        """
        tracker, laws, count = self.tracker, self.laws, len(wanted)
        pose[0], twist[0] = tracker.pose, tracker.rate
        pose[0, 2] += tracker.lift
        lift = None
        if laws and laws.wrist:
            z = tracker.heights(wanted)
            time = self.data.time + self.cell.timestep * np.arange(1, count + 1)
            lift = laws.height(time, z, self._felt) - z
        if laws and laws.vacuum:
            time = self.data.time + self.cell.timestep * np.arange(count)
            now = laws.pressure(time, self.pressure)
            if np.abs(now - self.vacuum).max() > EVEN:
                self._obey(now)
        control, ahead, ahead_rate = tracker.advance(wanted, lift)
        pose[1:], twist[1:] = ahead[:-1], ahead_rate[:-1]
        return control

    def _read(self, time: Array, force: Array) -> Array:
        if self.laws and self.laws.reading:
            for key in range(force.shape[1]):
                force[:, key] = self.laws.read(key, time, force[:, key])
        return force
