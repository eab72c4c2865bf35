# ruff: noqa: PLR0915  (compiled code: flat functions over plain numbers are what the compiler turns into fast code)
"""The emulated cell without its devices: commands in, a :class:`Recording` of the real side out, far faster than real time.

The loop is the live cell's: the controller holds each target for a cycle and moves the arm to the cycle's end, the
regulators and the plant go on in ticks of 1 ms, the arm feels the force that the keys had at the cycle's start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.geometry import FINGERS, keyboard, wrist_pose
from pianobot_ros.cell.keystroke import NoteEvent
from pianobot_ros.cell.motion import StrikeMotion
from pianobot_ros.cell.recording import Recording, Signal, Strike
from pianobot_ros.emulator.plant.arm import (
    ArmParameters,
    ArmState,
    arm_cycle,
    arm_parameters,
    new_arm_state,
    servo_propagator,
)
from pianobot_ros.emulator.plant.case import Case
from pianobot_ros.emulator.plant.layout import ANGLE, NORMAL, REACTION
from pianobot_ros.emulator.plant.model import TICK, plant_tick
from pianobot_ros.emulator.plant.noise import noise_levels
from pianobot_ros.emulator.plant.parameters import Model, State, new_state, physics, plant_parameters
from pianobot_ros.emulator.plant.pneumatics import AirParameters, AirState, air_parameters, air_step, new_air_state
from pianobot_ros.emulator.plant.sensors import (
    FSR_MEMORY,
    Converter,
    DeviceClock,
    MidiSensor,
    fsr_config,
    fsr_parameters,
    fsr_readings,
)

__all__ = ["Commands", "simulate_cell", "simulate_commands", "standard_strikes"]

Array = NDArray[np.float64]

CYCLE = 8e-3  # s, UR CB3
VACUUM_RATE = 100.0  # Hz
VACUUM_STEP = 10  # ticks


@dataclass(frozen=True)
class Commands:
    """What both cells are told.

    ``time`` (n,) s with ``position`` (n, 3) m and ``rotation`` (n, 3) rotation vector rad of the wrist frame in the base
    frame; ``vacuum_time`` (m,) s with ``pressure`` (m, 3) Pa. A command holds until the next one.
    """

    time: Array
    position: Array
    rotation: Array
    vacuum_time: Array
    pressure: Array
    strikes: Sequence[Strike] = field(default_factory=tuple)

    @classmethod
    def from_recording(cls, recording: Recording) -> Commands:
        """The commands of a recording. Raises :class:`RecordingError` if it has none."""
        position = recording.signal("command/wrist.position")
        rotation = recording.signals.get("command/wrist.rotation")
        turned = np.zeros_like(position.value) if rotation is None else rotation.value
        vacuum = recording.signals.get("command/vacuum.pressure")
        if vacuum is None or not len(vacuum.time):
            return cls(position.time, position.value, turned, np.zeros(1), np.zeros((1, 3)), tuple(recording.strikes))
        return cls(position.time, position.value, turned, vacuum.time, vacuum.value, tuple(recording.strikes))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _run(
    arm: ArmParameters, arm_state: ArmState, propagator: Array, air: AirParameters, air_state: AirState, model: Model,
    state: State, fingers: NDArray[np.int64], steps: int, cycle: int, targets: Array, setpoints: Array, fsr_key: int,
    poses: Array, pressures: Array, forces: Array, angles: Array, events: Array,
) -> int:  # fmt: skip
    """The whole run, tick by tick. ``targets`` (cycles, 6), ``setpoints`` (ticks, 3); outputs one row a tick. Returns the
    number of trigger passages in ``events``."""
    reaction = np.zeros(3)
    pose, twist = np.empty((cycle, 6)), np.empty((cycle, 6))
    last_pose, last_twist = arm_state.servo[0].copy(), arm_state.servo[1].copy()
    count = 0
    for c in range(len(targets)):
        reaction[:] = state.cell[REACTION : REACTION + 3]
        arm_cycle(arm, arm_state, targets[c], reaction, propagator, 1e-3, pose, twist)
        for i in range(cycle):
            tick = c * cycle + i
            air_step(air, air_state, setpoints[tick], 1e-3)
            for k in range(3):
                pressures[tick, k] = min(air_state.pressure[k] + air_state.leak[k], 0.0)
            count += plant_tick(
                model, state, fingers, tick * 1e-3, 1e-3, steps, last_pose, last_twist, pose[i], twist[i], pressures[tick],
                events[count:],
            )  # fmt: skip
            last_pose[:] = pose[i]
            last_twist[:] = twist[i]
            poses[tick] = pose[i]
            forces[tick] = max(state.keys[fsr_key, NORMAL], 0.0)  # a pad that sticks pulls; the sensor reads 0
            angles[tick] = state.keys[fsr_key, ANGLE]
    return count


def simulate_cell(
    commands: Commands,
    *,
    effects: Mapping[str, float] | None = None,
    parameter_errors: Mapping[str, float] | None = None,
    seed: int = 0,
    fingers: Sequence[str] | None = None,
    encoder: bool | None = None,
) -> Recording:
    """Play ``commands`` on the emulated cell.

    ``effects`` by name and magnitude in units of the repeatability floor; ``parameter_errors`` by name and relative error
    (0.2 is 20 % too much). ``fingers`` limits the hand to some fingers; by default those that strike, or all without strike
    marks. ``encoder`` says whether the key with the force sensor has an encoder; by default as ``config/fsr.yaml`` has it.
    Returns a recording with the signals ``command/*`` and ``real/*``, the MIDI events of ``real`` and the strikes.
    """
    factors = {name: 1.0 + error for name, error in (parameter_errors or {}).items()}
    return simulate_commands(commands, Case(dict(effects or {}), factors, seed=seed), fingers=fingers, encoder=encoder)


def simulate_commands(
    commands: Commands,
    case: Case,
    *,
    fingers: Sequence[str] | None = None,
    encoder: bool | None = None,
    step: float | None = None,
    rounded: bool = True,
) -> Recording:
    """As :func:`simulate_cell`, for a :class:`Case`.

    ``step`` overrides the integration step, s; ``rounded`` False leaves MIDI velocities unrounded.
    """
    if len(commands.time) < 2:
        raise RecordingError("there are no wrist commands to play: give at least two")
    origin = float(commands.time[0])
    names = fingers or sorted({s.finger for s in commands.strikes}) or list(FINGERS)
    active = np.array([FINGERS.index(name) for name in names], dtype=np.int64)
    cycle = round(CYCLE / TICK)
    cycles = int(np.ceil((float(commands.time[-1]) - origin) / CYCLE - 1e-6)) + 1
    ticks = cycles * cycle
    ends: Array = origin + TICK * np.arange(1, ticks + 1, dtype=float)

    target_at = np.searchsorted(commands.time, origin + CYCLE * np.arange(cycles) + 1e-6, side="right") - 1
    targets = np.hstack([commands.position, commands.rotation])[np.maximum(target_at, 0)]
    setpoint_at = np.searchsorted(commands.vacuum_time, ends - TICK + 1e-6, side="right") - 1
    setpoints = np.ascontiguousarray(commands.pressure[np.maximum(setpoint_at, 0)])

    strengths = case.strengths()
    model = plant_parameters(strengths, case.parameters, seed=case.seed, repeatability=case.repeatability)
    steps = max(1, round(TICK / (step or physics().step)))
    arm = arm_parameters(case)
    note = fsr_config().sensor.note
    key = keyboard().notes.index(note)
    poses, pressures = np.empty((ticks, 6)), np.empty((ticks, 3))
    forces, angles, passages = np.empty(ticks), np.empty(ticks), np.zeros((64 + 8 * cycles, 4))
    count = _run(
        arm, new_arm_state(targets[0]), servo_propagator(arm, TICK), air_parameters(case), new_air_state(setpoints[0]),
        model, new_state(model), active, steps, cycle, targets, setpoints, key, poses, pressures, forces, angles, passages,
    )  # fmt: skip
    passages[:count, 0] += origin
    readings = np.empty(ticks)
    fsr_readings(fsr_parameters(case), np.zeros(FSR_MEMORY), 0, TICK, forces, pressures.mean(axis=1), readings)

    noise = noise_levels()
    random = np.random.default_rng([case.seed, 4])
    signals = {
        "command/wrist.position": Signal(commands.time, commands.position, "m"),
        "command/wrist.rotation": Signal(commands.time, commands.rotation, "rad"),
        "command/vacuum.pressure": Signal(commands.vacuum_time, commands.pressure, "Pa"),
    }
    at_cycle = slice(cycle - 1, None, cycle)
    spread = np.repeat([noise.wrist_position, noise.wrist_rotation], 3) * case.noise
    wrist = poses[at_cycle] + spread * random.standard_normal((cycles, 6))
    signals["real/wrist/state.position"] = Signal(ends[at_cycle], wrist[:, :3], "m")
    signals["real/wrist/state.rotation"] = Signal(ends[at_cycle], wrist[:, 3:], "rad")
    at_vacuum = slice(VACUUM_STEP - 1, None, VACUUM_STEP)
    measured = pressures[at_vacuum]
    measured = measured + noise.pressure * case.noise * random.standard_normal(measured.shape)
    signals["real/vacuum/state.setpoint"] = Signal(ends[at_vacuum], setpoints[at_vacuum], "Pa")
    signals["real/vacuum/state.measured"] = Signal(ends[at_vacuum], measured, "Pa")
    # Force sensor and encoder hang on one microcontroller and share its clock.
    every = max(1, round(1.0 / (TICK * fsr_config().sensor.rate)))
    at_sample = slice(every - 1, None, every)
    stamps = origin + DeviceClock(case).read(ends[at_sample] - origin)
    converter, exact = Converter(), case.noise == 0
    reading, angle = readings[at_sample], angles[at_sample]
    counts = converter.counts(reading + noise.fsr * case.noise * random.standard_normal(len(reading)))
    signals["real/fsr.force"] = Signal(stamps, reading if exact else converter.force(counts), "N")
    signals["real/fsr.counts"] = Signal(stamps, counts.astype(float), "1")
    if fsr_config().encoder.fitted if encoder is None else encoder:
        signals[f"real/key_angle.{note}"] = Signal(stamps, angle if exact else converter.angle(angle), "rad")
    sent = sorted(MidiSensor(case, rounded=rounded).notes(passages[:count]), key=lambda n: n.time)
    notes = [NoteEvent(n.time, n.on, n.note, n.velocity) for n in sent]  # type: ignore[arg-type]
    return Recording(signals, {"real": notes}, list(commands.strikes), note, source="emulated cell, offline")


def standard_strikes(seed: int, n: int = 40, *, repeats: int = 4) -> Commands:
    """A designed set of ``n`` strikes of the middle finger on the key with the force sensor.

    Conditions cover speeds 0.05 to 0.3 m/s down and up, depths 8 to 20 mm, holds 0.1 to 0.6 s and vacuum 0, -50 and -100 kPa
    in each finger apart from the others, each spread evenly over its range and shuffled by ``seed``; each condition is played
    ``repeats`` times. The vacuum steps up and down between conditions: settled long before some strikes, while it is still
    moving for others. Rounds through all conditions take two orders in turn, so that each strike has a repeat with the same
    strike before it, and repeats with another.
    """
    random = np.random.default_rng(seed)
    conditions = max(1, -(-n // repeats))

    def spread(low: float, high: float) -> Array:
        cells = (random.permutation(conditions) + random.uniform(0.2, 0.8, conditions)) / conditions
        return np.asarray(low + (high - low) * cells)

    speeds, lifts = (np.exp(spread(np.log(0.05), np.log(0.3))) for _ in range(2))
    depths, holds = spread(0.008, 0.020), spread(0.1, 0.6)
    levels = np.resize([0.0, -50e3, -100e3], conditions)
    fingers = np.column_stack([random.permutation(levels) for _ in FINGERS])
    rounds = [random.permutation(conditions) for _ in range(2 if repeats > 3 else 1)]
    order = np.concatenate([rounds[i % len(rounds)] for i in range(repeats)])[:n]
    note = fsr_config().sensor.note
    touching = wrist_pose({"middle": note})
    rest = StrikeMotion(1.0, 0.01, 0.0).clearance
    wrist_time, height, strikes = [], [], []
    vacuum_time, pressure = [], []
    now = 0.0
    for i, c in enumerate(order):
        start_cycles = round(now / CYCLE)
        lead = 0.35 if i % conditions % 2 == 0 else 0.15  # s between the vacuum's step and the strike
        vacuum_time.append(start_cycles * CYCLE)
        pressure.append(fingers[c])
        motion = StrikeMotion(float(speeds[c]), float(depths[c]), float(holds[c]), release_speed=float(lifts[c]))
        duration = lead + motion.duration + 0.3
        cycles = int(np.ceil(duration / CYCLE))
        t = CYCLE * np.arange(cycles)
        wrist_time.append(start_cycles * CYCLE + t)
        height.append(np.where(t >= lead, motion.height(t - lead), rest))
        start = start_cycles * CYCLE + lead
        strikes.append(
            Strike(
                index=i,
                phrase="standard",
                condition=f"c{c:02d}",
                finger="middle",
                note=note,
                start=start,
                end=start + motion.duration + 0.15,
                speed=motion.speed,
                depth=motion.depth,
                hold=motion.hold,
                pressure=float(fingers[c, FINGERS.index("middle")]),
                note_length=motion.duration + 0.15,
            )
        )
        now = (start_cycles + cycles) * CYCLE
    time = np.concatenate(wrist_time)
    position = np.tile(touching.position, (len(time), 1))
    position[:, 2] += np.concatenate(height)
    rotation = np.tile(touching.rotation.as_rotvec(), (len(time), 1))
    return Commands(time, position, rotation, np.array(vacuum_time), np.array(pressure), tuple(strikes))
