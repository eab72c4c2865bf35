# into fast code)
"""The emulated cell without its devices: commands in, a :class:`Recording` of the real side out,
far faster than real time.

The loop is the live cell's: the controller holds each target for a cycle and moves the arm to the
cycle's end, the regulators and the plant go on in ticks of 1 ms, the arm feels the force that the
keys had at the cycle's start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.commands import CYCLE, Commands
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.instruments.arm_servo import (
    ArmParameters,
    ArmState,
    arm_cycle,
    arm_parameters,
    new_arm_state,
    servo_propagator,
)
from pianobot_ros.emulator.plant.instruments.pneumatics import (
    AirParameters,
    AirState,
    air_parameters,
    air_step,
    new_air_state,
)
from pianobot_ros.emulator.plant.instruments.sensor_noise import noise_levels
from pianobot_ros.emulator.plant.instruments.sensors import (
    FSR_MEMORY,
    Converter,
    MidiSensor,
    SensorClock,
    fsr_config,
    fsr_parameters,
    fsr_readings,
)
from pianobot_ros.emulator.plant.laws.row_layout import ANGLE, NORMAL, REACTION
from pianobot_ros.emulator.plant.mechanics.physics import (
    Simulated,
    new_state,
    physics,
    plant_parameters,
)
from pianobot_ros.emulator.plant.mechanics.plant_model import TICK, plant_tick

__all__ = ["simulate_cell", "simulate_commands", "standard_strikes"]


VACUUM_STEP = 10  # ticks: the gauge is read at 100 Hz


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _run(
    arm: ArmParameters,
    arm_state: ArmState,
    propagator: Array,
    air: AirParameters,
    air_state: AirState,
    plant: Simulated,
    steps: int,
    cycle: int,
    targets: Array,
    setpoints: Array,
    fsr_key: int,
    poses: Array,
    pressures: Array,
    forces: Array,
    angles: Array,
    events: Array,
) -> int:
    """The whole run, tick by tick. ``targets`` (cycles, 6), ``setpoints`` (ticks, 3); outputs one
    row a tick. Returns the number of trigger passages in ``events``."""
    reaction = np.zeros(3)
    pose, twist = np.empty((cycle, 6)), np.empty((cycle, 6))
    state, wrist = plant.state, np.empty((4, 6))
    wrist[2], wrist[3] = arm_state.servo[0], arm_state.servo[1]
    count = 0
    for c in range(len(targets)):
        reaction[:] = state.cell[REACTION : REACTION + 3]
        arm_cycle(arm, arm_state, targets[c], reaction, propagator, 1e-3, pose, twist)
        for i in range(cycle):
            tick = c * cycle + i
            air_step(air, air_state, setpoints[tick], 1e-3)
            for k in range(3):
                pressures[tick, k] = min(air_state.pressure[k] + air_state.leak[k], 0.0)
            wrist[0], wrist[1] = wrist[2], wrist[3]
            wrist[2], wrist[3] = pose[i], twist[i]
            count += plant_tick(
                plant, tick * 1e-3, 1e-3, steps, wrist, pressures[tick], events[count:]
            )
            poses[tick] = pose[i]
            forces[tick] = max(
                state.keys[fsr_key, NORMAL], 0.0
            )  # a pad that sticks pulls; the sensor reads 0
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

    ``effects`` by name and magnitude in units of the repeatability floor; ``parameter_errors`` by
    name and relative error (0.2 is 20 % too much). ``fingers`` limits the hand to some fingers; by
    default those that strike, or all without strike marks. ``encoder`` says whether the key with
    the force sensor has an encoder; by default as ``config/fsr.yaml`` has it. Returns a recording
    with the signals ``command/*`` and ``real/*``, the MIDI events of ``real`` and the strikes.
    """
    factors = {name: 1.0 + error for name, error in (parameter_errors or {}).items()}
    return simulate_commands(
        commands, Case(dict(effects or {}), factors, seed=seed), fingers=fingers, encoder=encoder
    )


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
    names = fingers or sorted({s.finger for s in commands.strikes}) or list(FINGERS)
    note = fsr_config().sensor.note
    played = _play(commands, case, [FINGERS.index(name) for name in names], note, step)
    random = np.random.default_rng([case.seed, 4])
    signals = commands.signals()
    signals |= _wrist_signals(played, case, random)
    signals |= _vacuum_signals(played, case, random)
    fitted = fsr_config().encoder.fitted if encoder is None else encoder
    signals |= _sensor_signals(played, case, note, fitted, random)
    sent = sorted(MidiSensor(case, rounded=rounded).notes(played.passages), key=lambda n: n.time)
    notes = [NoteEvent(n.time, n.on, n.note, n.velocity) for n in sent]  # type: ignore[arg-type]
    return Recording(
        signals, {"real": notes}, list(commands.strikes), note, source="emulated cell, offline"
    )


@dataclass(frozen=True)
class _Played:
    """What happened, a row a tick (n): ``time`` at the tick's end and ``origin`` s, wrist ``pose``
    (n, 6), ``setpoint`` and ``pressure`` (n, 3) Pa, force N and angle rad of the key with the force
    sensor; passages of the triggers (m, 4).
    """

    origin: float
    time: Array
    pose: Array
    setpoint: Array
    pressure: Array
    force: Array
    angle: Array
    passages: Array


def _play(
    commands: Commands, case: Case, fingers: Sequence[int], note: int, step: float | None
) -> _Played:
    """Run arm, pneumatics and plant through the commands."""
    origin = float(commands.time[0])
    cycle = round(CYCLE / TICK)
    cycles = int(np.ceil((float(commands.time[-1]) - origin) / CYCLE - 1e-6)) + 1
    ticks = cycles * cycle
    ends: Array = origin + TICK * np.arange(1, ticks + 1, dtype=float)
    target_at = (
        np.searchsorted(commands.time, origin + CYCLE * np.arange(cycles) + 1e-6, side="right") - 1
    )
    targets = commands.pose[np.maximum(target_at, 0)]
    setpoint_at = np.searchsorted(commands.vacuum_time, ends - TICK + 1e-6, side="right") - 1
    setpoints = np.ascontiguousarray(commands.pressure[np.maximum(setpoint_at, 0)])
    model = plant_parameters(
        case.strengths(),
        case.parameters,
        laws=case.laws,
        seed=case.seed,
        repeatability=case.repeatability,
    )
    arm = arm_parameters(case)
    poses, pressures = np.empty((ticks, 6)), np.empty((ticks, 3))
    forces, angles, passages = np.empty(ticks), np.empty(ticks), np.zeros((64 + 8 * cycles, 4))
    count = _run(
        arm,
        new_arm_state(targets[0]),
        servo_propagator(arm, TICK),
        air_parameters(case),
        new_air_state(setpoints[0]),
        Simulated(model, new_state(model), np.array(fingers, dtype=np.int64)),
        max(1, round(TICK / (step or physics().step))),
        cycle,
        targets,
        setpoints,
        keyboard().notes.index(note),
        poses,
        pressures,
        forces,
        angles,
        passages,
    )
    passages[:count, 0] += origin
    return _Played(origin, ends, poses, setpoints, pressures, forces, angles, passages[:count])


def _wrist_signals(
    played: _Played, case: Case, random: np.random.Generator
) -> dict[str, TimeSeries]:
    """What the arm's controller reports, once a cycle."""
    noise, cycle = noise_levels(), round(CYCLE / TICK)
    at = slice(cycle - 1, None, cycle)
    time = played.time[at]
    spread = np.repeat([noise.wrist_position, noise.wrist_rotation], 3) * case.noise
    wrist = played.pose[at] + spread * random.standard_normal((len(time), 6))
    return {
        "real/wrist/state.position": TimeSeries(time, wrist[:, :3], "m"),
        "real/wrist/state.rotation": TimeSeries(time, wrist[:, 3:], "rad"),
    }


def _vacuum_signals(
    played: _Played, case: Case, random: np.random.Generator
) -> dict[str, TimeSeries]:
    """What the regulator reports."""
    at = slice(VACUUM_STEP - 1, None, VACUUM_STEP)
    measured = played.pressure[at]
    spread = noise_levels().pressure * case.noise
    measured = measured + spread * random.standard_normal(measured.shape)
    return {
        "real/vacuum/state.setpoint": TimeSeries(played.time[at], played.setpoint[at], "Pa"),
        "real/vacuum/state.measured": TimeSeries(played.time[at], measured, "Pa"),
    }


def _sensor_signals(
    played: _Played, case: Case, note: int, fitted: bool, random: np.random.Generator
) -> dict[str, TimeSeries]:
    """Force sensor and encoder, if one is ``fitted``: they hang on one microcontroller and share
    its clock.
    """
    readings, pressure = np.empty(len(played.time)), played.pressure.mean(axis=1)
    memory = np.zeros(FSR_MEMORY)
    fsr_readings(fsr_parameters(case), memory, 0, TICK, played.force, pressure, readings)
    every = max(1, round(1.0 / (TICK * fsr_config().sensor.rate)))
    at = slice(every - 1, None, every)
    stamps = played.origin + SensorClock(case).read(played.time[at] - played.origin)
    converter, exact = Converter(), case.noise == 0
    reading, angle = readings[at], played.angle[at]
    spread = noise_levels().fsr * case.noise
    counts = converter.counts(reading + spread * random.standard_normal(len(reading)))
    force = reading if exact else converter.force(counts)
    signals = {
        "real/fsr.force": TimeSeries(stamps, force, "N"),
        "real/fsr.counts": TimeSeries(stamps, counts.astype(float), "1"),
    }
    if fitted:
        angle = angle if exact else converter.angle(angle)
        signals[f"real/key_angle.{note}"] = TimeSeries(stamps, angle, "rad")
    return signals


def standard_strikes(seed: int, n: int = 40, *, repeats: int = 4) -> Commands:
    """A designed set of ``n`` strikes of the middle finger on the key with the force sensor.

    Conditions cover speeds 0.05 to 0.3 m/s down and up, depths 8 to 20 mm, holds 0.1 to 0.6 s and
    vacuum 0, -50 and -100 kPa in each finger apart from the others, each spread evenly over its
    range and shuffled by ``seed``; each condition is played
    ``repeats`` times. The vacuum steps up and down between conditions: settled long before some
    strikes, while it is still moving for others. Rounds through all conditions take two orders in
    turn, so that each strike has a repeat with the same strike before it, and repeats with another.
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
    motions = [
        StrikeMotion(float(speed), float(depth), float(hold), release_speed=float(lift))
        for speed, depth, hold, lift in zip(speeds, depths, holds, lifts, strict=True)
    ]
    return _in_order(order, motions, fingers, fsr_config().sensor.note)


def _in_order(order: Array, motions: Sequence[StrikeMotion], fingers: Array, note: int) -> Commands:
    """The strikes of the conditions in ``order``, each with its motion and the fingers' pressures
    (conditions, 3) Pa.
    """
    rest = StrikeMotion(1.0, 0.01, 0.0).clearance
    wrist_time, height, strikes = [], [], []
    vacuum_time, pressure = [], []
    now = 0.0
    for i, c in enumerate(order):
        start_cycles = round(now / CYCLE)
        # s between the vacuum's step and the strike
        lead = 0.35 if i % len(motions) % 2 == 0 else 0.15
        vacuum_time.append(start_cycles * CYCLE)
        pressure.append(fingers[c])
        motion = motions[c]
        cycles = int(np.ceil((lead + motion.duration + 0.3) / CYCLE))
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
    touching = wrist_pose({"middle": note})
    time = np.concatenate(wrist_time)
    position = np.tile(touching.position, (len(time), 1))
    position[:, 2] += np.concatenate(height)
    rotation = np.tile(touching.rotation.as_rotvec(), (len(time), 1))
    return Commands(
        time, position, rotation, np.array(vacuum_time), np.array(pressure), tuple(strikes)
    )
