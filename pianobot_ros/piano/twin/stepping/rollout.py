"""Strikes offline: commands in, what the cell would have measured out; one after the other, or many
on several threads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from mujoco import rollout

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.keystroke import Keystroke, NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.piano.action.mujoco.mujoco_parts import ActionEvent
from pianobot_ros.piano.twin.model.arm import ArmTracker
from pianobot_ros.piano.twin.model.cell_model import TwinModel, TwinOptions, build_twin
from pianobot_ros.piano.twin.stepping.cell_twin import (
    CellTwin,
    TwinDivergedError,
    warning_count,
)
from pianobot_ros.piano.twin.stepping.key_trigger import KeyTrigger
from pianobot_ros.piano.twin.stepping.laws import Laws

__all__ = ["BatchJob", "Run", "play", "play_batch", "reduced", "strike_commands"]


SETTLE = 0.3  # s before a strike's motion, in which the fingers come to rest under gravity
AFTER = 0.15  # s after it


def strike_commands(
    targets: Mapping[str, int], motion: StrikeMotion, *, pressure: float = 0.0, period: float = 1e-3
) -> Commands:
    """One strike of the ``targets`` (finger to note), commanded every ``period`` s, with
    ``pressure`` Pa in all fingers.
    """
    touching = wrist_pose(targets)
    time = np.arange(0.0, SETTLE + motion.duration + AFTER, period)
    position = np.tile(touching.position, (time.size, 1))
    position[:, 2] += motion.height(time - SETTLE)
    rotation = np.tile(touching.rotation.as_rotvec(), (time.size, 1))
    return Commands(time, position, rotation, pressure=np.full((1, 3), pressure))


@dataclass(frozen=True)
class Run:
    """A run: ``time`` (n,) s at every step; ``angle`` rad, ``rate`` rad/s, ``force`` N (n, keys) of
    the ``notes``; wrist ``pose`` (n, 6); note ``events`` and ``strokes``; what happened in the
    keys' actions, if they have parts.
    """

    notes: tuple[int, ...]
    time: Array
    angle: Array
    rate: Array
    force: Array
    pose: Array
    events: list[NoteEvent]
    strokes: list[Keystroke]
    action: list[ActionEvent] = field(default_factory=list)

    def key(self, note: int) -> tuple[Array, Array, Array]:
        """Angle, rate and force of one key, each (n,)."""
        i = self.notes.index(note)
        return self.angle[:, i], self.rate[:, i], self.force[:, i]

    def recording(self, commands: Commands, fsr_note: int = 64, rate: float = 500.0) -> Recording:
        """As a recording of the cell ``sim``, sampled at ``rate`` Hz."""
        every = max(1, round(1.0 / (rate * (self.time[1] - self.time[0]))))
        t = self.time[::every]
        signals = {
            **commands.signals(),
            "sim/wrist/state.position": TimeSeries(t, self.pose[::every, :3], "m"),
            "sim/wrist/state.rotation": TimeSeries(t, self.pose[::every, 3:], "rad"),
        }
        for i, note in enumerate(self.notes):
            signals[f"sim/key_angle.{note}"] = TimeSeries(t, self.angle[::every, i], "rad")
        if fsr_note in self.notes:
            signals["sim/fsr.force"] = TimeSeries(t, self.key(fsr_note)[2][::every], "N")
        return Recording(
            signals, {"sim": self.events}, list(commands.strikes), fsr_note, source="twin"
        )


def reduced(finger: str, note: int, **options: float) -> TwinOptions:
    """Options of the model that has only the striking finger and its key."""
    return TwinOptions(fingers=(finger,), notes=(note,), **options)  # type: ignore[arg-type]


def play(
    commands: Commands,
    options: TwinOptions | None = None,
    stiffness: float | None = None,
    laws: Laws | None = None,
) -> Run:
    """What the twin does when told ``commands``. ``stiffness`` N m/rad of all joints replaces the
    one by pressure; ``laws``: its departures from the nominal cell.

    Raises TwinDivergedError, and PianobotError where the arm cannot reach.
    """
    twin = CellTwin(options, commands.pose[0], laws)
    targets = commands.at_steps(twin.cell.timestep)
    cuts = np.round(commands.vacuum_time / twin.cell.timestep).astype(int)
    ends = [*np.clip(cuts[1:], 0, len(targets)).tolist(), len(targets)]
    parts = []
    for start, end, pressure in zip(
        np.clip(cuts, 0, len(targets)).tolist(), ends, commands.pressure, strict=True
    ):
        twin.command_vacuum(dict(zip(FINGERS, pressure.tolist(), strict=True)))
        if stiffness is not None:
            for finger in twin.cell.options.fingers:
                twin.cell.set_stiffness(finger, stiffness)
        if end > start:
            parts.append(twin.step(end - start, targets[start:end]))

    def joined(name: str) -> Array:
        return np.concatenate([getattr(p, name) for p in parts])

    events, strokes = [e for p in parts for e in p.events], [s for p in parts for s in p.strokes]
    return Run(
        twin.cell.notes,
        joined("time"),
        joined("angle"),
        joined("rate"),
        joined("force"),
        joined("pose"),
        events,
        strokes,
        list(twin.switches.events) if twin.switches else [],
    )


@dataclass(frozen=True)
class BatchJob:
    """One run of a batch: commands and the joint stiffness (N m/rad) of all fingers, or None for
    that of the first pressure.
    """

    commands: Commands
    stiffness: float | None = None


def play_batch(
    jobs: Sequence[BatchJob], options: TwinOptions | None = None, threads: int = 2
) -> list[Run]:
    """Play all jobs with the same model on ``threads`` threads. Vacuum is that of each job's first
    pressure throughout.

    Actions with parts are switched between steps and keys with felt are pressed by it, which
    threads cannot: they are played one after the other. Raises TwinDivergedError if any becomes
    unstable.
    """
    if not jobs:
        return []
    options = options or TwinOptions()
    felted = options.mechanism == "felt" or (
        options.mechanism == "spring" and keyboard().mechanism.acts_by_steps
    )
    if options.parts or felted:
        return [play(_held(job.commands), options, job.stiffness) for job in jobs]
    twin = build_twin(options)
    step = twin.timestep
    count = max(round(j.commands.duration / step) for j in jobs)
    controls = np.zeros((len(jobs), count, twin.model.nu))
    tracks, models, states = [], [], []
    data = mujoco.MjData(twin.model)
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    arms: dict[
        int, tuple[Array, Array, Array]
    ] = {}  # jobs often share their commands and differ in stiffness
    for i, job in enumerate(jobs):
        if id(job.commands) not in arms:
            arms[id(job.commands)] = _arm(job.commands, step, count)
        start, controls[i, :, :6], pose = arms[id(job.commands)]
        data.qpos[:6] = start
        state = np.empty(mujoco.mj_stateSize(twin.model, spec))
        mujoco.mj_getState(twin.model, data, state, spec)
        states.append(state)
        tracks.append(pose)
        twin.set_pressure(job.commands.pressure[0])
        if job.stiffness is not None:
            for finger in twin.options.fingers:
                twin.set_stiffness(finger, job.stiffness)
        # A copy of the model for each run; it shares nothing, so that threads do not wait for one
        # another.
        models.append(mujoco.MjModel.__copy__(twin.model))
    datas = [mujoco.MjData(twin.model) for _ in range(max(1, threads))]
    with rollout.Rollout(nthread=threads) as pool:
        after, sensed = pool.rollout(models, datas, np.array(states), controls)
    if any(warning_count(d) for d in datas) or not np.isfinite(after).all():
        raise TwinDivergedError("the physics became unstable: take a smaller step or softer joints")
    return [
        _run(twin, job, np.vstack([states[i], after[i, :-1]]), sensed[i], tracks[i])
        for i, job in enumerate(jobs)
    ]


def _arm(commands: Commands, step: float, count: int) -> tuple[Array, Array, Array]:
    """The arm's joints at the start (6,), and its controls and the wrist's poses at the start of
    ``count`` steps (count, 6).
    """
    wanted = commands.at_steps(step)
    wanted = np.vstack([wanted, np.tile(wanted[-1], (count - len(wanted), 1))])
    tracker = ArmTracker(step, wanted[0])
    joint, pose = tracker.joint.copy(), tracker.pose.copy()
    control, ahead, _ = tracker.advance(wanted)
    return joint, control, np.vstack([pose, ahead[:-1]])


def _held(commands: Commands) -> Commands:
    """The same commands with the first pressure throughout."""
    return replace(commands, vacuum_time=commands.vacuum_time[:1], pressure=commands.pressure[:1])


def _run(twin: TwinModel, job: BatchJob, state: Array, sensed: Array, pose: Array) -> Run:
    n = round(job.commands.duration / twin.timestep)
    if n < 2:
        raise PianobotError("a run needs a duration of at least two steps")
    state, nq = state[:n], twin.model.nq
    angle = state[:, 1 + twin.key_qpos]
    force = sensed[:n, twin.force_index] * twin.options.factor("fsr_gain")
    trigger = KeyTrigger(
        twin.notes, twin.radius, twin.board.midi, twin.options.factor("midi_velocity_gain")
    )
    events, strokes = trigger.feed(state[:, 0], angle, force)
    return Run(
        twin.notes,
        state[:, 0],
        angle,
        state[:, 1 + nq + twin.key_dof],
        force,
        pose[:n],
        events,
        strokes,
    )
