# ruff: noqa: PLR0915  (compiled code: flat functions over plain numbers are what the compiler turns
# into fast code)
"""The whole cell: commands in, a recording of its real side out.

Finger and key move by the linearly implicit midpoint rule in steps of 50 µs; the arm, the air and
the sensors go by ticks of 1 ms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.interpolate import PchipInterpolator

from foreign_cell.arm_and_air import arm_heights, slow_noise, true_pressures, wander
from foreign_cell.key_laws import KEY_MEMORY, Key, key_torque, white_key
from foreign_cell.law_table import MECHANICAL, WRIST_COMPLIANCE, Effects, acting
from foreign_cell.pad_contact import (
    PAD_MEMORY,
    Friction,
    Pad,
    add_contact,
    contact_directions,
    friction_force,
    let_go,
    move_pad,
    pad_force,
    pad_reading,
)
from foreign_cell.planar_finger import (
    JOINT_MEMORY,
    Finger,
    Joints,
    add_joints,
    chain_equations,
    middle_finger,
    pad_offset,
    solve,
    tip_position,
    tip_velocity,
)
from foreign_cell.sensor_laws import (
    angle_shown,
    contact_angles,
    force_shown,
    mains_hum,
    notes_heard,
    sensor_clock,
)
from pianobot_ros.cell.arrays import Array, IntArray
from pianobot_ros.cell.motion.geometry import hand, keyboard
from pianobot_ros.cell.numbers.nominal import PARAMETERS, stiffness_calibration
from pianobot_ros.cell.recordings.commands import CYCLE, Commands
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.emulator.plant.instruments.sensor_noise import noise_levels
from pianobot_ros.emulator.plant.instruments.sensors import Converter, fsr_config

__all__ = ["STEP", "UnstableError", "play"]

STEP = 5e-5
"""Step of finger and key, s."""
TICK = 1e-3  # s
CYCLE_TICKS, AIR_TICKS, RIG_TICKS = 8, 10, 2  # ticks between samples of arm, air, sensors on keys
GRAVITY = 9.81  # m/s^2
VARIED_STRIKES = 64
HEIGHT_SPREAD, STIFFNESS_SPREAD, DAMPING_SPREAD = 20e-6, 0.01, 0.02  # m, 1, 1 from strike to strike
WANDER, WANDER_TIME = 15e-6, 1.5  # m, s, of the arm
GAIN_TIME = 3.0  # s, of the force sensor's wander
VARY_BEFORE = 80  # ticks before a strike at which its variation begins
LARGEST_ANGLE = 0.2  # rad
_FAST, _SLOW, _SPEED, _ACCELERATION = range(4)  # of the arm's give under load


class UnstableError(Exception):
    """The integration went out of bounds."""


class Cell(NamedTuple):
    """Numbers of the cell: ``joint_damping`` N m s/rad; ``forward`` and ``up`` are the place of the
    finger's base in the wrist's frame, m; ``note_on`` and ``note_off`` key angles, rad.
    """

    finger: Finger
    pad: Pad
    key: Key
    joint_damping: float
    forward: float
    up: float
    note_on: float
    note_off: float


class Drive(NamedTuple):
    """What moves the finger.

    Attributes:
        height: of the wrist at every step's start and the last one's end (n + 1,), m.
        speed: likewise, m/s.
        forward: of the wrist by tick (m,), m.
        stiffness: of the joints by tick (m,), N m/rad.
        pressure: of the finger's vacuum by tick (m,), Pa gauge.
        begin: ticks from which the variation of each strike holds.
        variation: by strike: height m, relative stiffness and damping of the joints (k, 3).
    """

    height: Array
    speed: Array
    forward: Array
    stiffness: Array
    pressure: Array
    begin: IntArray
    variation: Array


class Motion(NamedTuple):
    """What the cell did, by tick (n,): the ``wrist``'s height m; ``force`` on the key N; ``angle``
    rad and ``rate`` rad/s of the key; and by contact (k, 3): time s, 1 for on, rate rad/s.
    """

    wrist: Array
    force: Array
    angle: Array
    rate: Array
    contacts: Array


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _move(
    cell: Cell, drive: Drive, laws: tuple[IntArray, Array], ticks: int, substeps: int, h: float
) -> Motion:
    """Move finger and key through ``ticks`` of ``substeps`` steps of ``h`` s each."""
    law, size = laws
    finger, pad, key = cell.finger, cell.pad, cell.key
    wrist, forces = np.empty(ticks), np.empty(ticks)
    angles, rates = np.empty(ticks), np.empty(ticks)
    contacts, heard, sounding = np.zeros((2000, 3)), 0, False
    pitch, pitch_rate = finger.pitch.copy(), np.zeros(4)
    sine, cosine = np.empty(4), np.empty(4)
    theta, omega, force = 0.0, 0.0, 0.0
    matrix, vector = np.empty((5, 5)), np.empty(5)
    normal, tangent = np.zeros(5), np.zeros(5)
    joint_memory, pad_memory = np.zeros((4, JOINT_MEMORY)), np.zeros(PAD_MEMORY)
    key_memory, give = np.zeros(KEY_MEMORY), np.zeros(4)
    along, across, radius = pad_offset(law, size, finger.radius)
    offset = (along, across)
    strike = 0
    for tick in range(ticks):
        if strike + 1 < len(drive.begin) and tick >= drive.begin[strike + 1]:
            strike += 1
        lift = drive.variation[strike, 0]
        joints = Joints(
            drive.stiffness[tick] * (1.0 + drive.variation[strike, 1]),
            cell.joint_damping * (1.0 + drive.variation[strike, 2]),
            -drive.pressure[tick] / 1e5,
        )
        forward = drive.forward[tick] + cell.forward
        for step in range(substeps):
            node = tick * substeps + step
            height = 0.5 * (drive.height[node] + drive.height[node + 1])
            height = height + (give[_FAST] + give[_SLOW]) + 0.5 * h * give[_SPEED]
            height = height + lift + cell.up
            rise = (drive.height[node + 1] - drive.height[node]) / h + give[_SPEED]
            lifted = (drive.speed[node + 1] - drive.speed[node]) / h + give[_ACCELERATION]
            chain = (pitch, pitch_rate)
            y, z = tip_position(
                finger.length, offset, chain, 0.5 * h, (forward, height), sine, cosine
            )
            chain_equations(finger, GRAVITY + lifted, pitch_rate, sine, cosine, matrix, vector)
            matrix[4, 4] = key.inertia
            vector[4] = 0.0
            add_joints(finger, joints, laws, chain, joint_memory, h, matrix, vector)
            middle = theta + 0.5 * h * omega
            depth, opening, sliding = contact_directions(
                finger.length,
                offset,
                (sine, cosine, pitch_rate),
                (math.sin(middle), math.cos(middle), omega),
                (y - key.hinge_forward, z - key.hinge_up),
                radius,
                rise,
                normal,
                tangent,
            )
            force = 0.0
            friction = Friction(0.0, 0.0, 0.0, False)
            if depth > 0.0:
                pressed, stiffness, damping = pad_force(
                    law, size, pad, depth, opening, pad_memory, h
                )
                if pressed > 0.0:
                    force = pressed
                    implicit = 0.5 * h * damping + 0.25 * h * h * stiffness
                    friction = friction_force(law, size, pad, force, sliding, pad_memory, h)
                    add_contact(normal, tangent, force, implicit, friction, matrix, vector)
            torque, implicit = key_torque(laws, key, middle, omega, force, key_memory, h)
            vector[4] -= torque
            matrix[4, 4] += implicit
            solve(matrix, vector, 5)
            if force > 0.0:
                for i in range(5):
                    sliding += 0.5 * h * tangent[i] * vector[i]
                move_pad(pad_memory, friction, sliding, h)
            else:
                let_go(pad_memory)
            for i in range(4):
                pitch[i] += h * pitch_rate[i] + 0.5 * h * h * vector[i]
                pitch_rate[i] += h * vector[i]
            before, rate_before = theta, omega
            theta += h * omega + 0.5 * h * h * vector[4]
            omega += h * vector[4]
            if law[WRIST_COMPLIANCE] > 0:
                _give_way(law[WRIST_COMPLIANCE], size[WRIST_COMPLIANCE], force, give, h)
            on = not sounding and before < cell.note_on <= theta
            off = sounding and before >= cell.note_off > theta
            if on or off:
                at = ((cell.note_on if on else cell.note_off) - before) / (theta - before)
                contacts[heard, 0] = (node + at) * h
                contacts[heard, 1] = 1.0 if on else 0.0
                contacts[heard, 2] = abs(rate_before + at * (omega - rate_before))
                heard += 1
                sounding = on
        node = (tick + 1) * substeps
        height = drive.height[node] + give[_FAST] + give[_SLOW]
        wrist[tick], angles[tick], rates[tick] = height, theta, omega
        base = (forward, height + lift + cell.up)
        y, z = tip_position(finger.length, offset, (pitch, pitch_rate), 0.0, base, sine, cosine)
        rise = drive.speed[node] + give[_SPEED]
        moving = tip_velocity(finger.length, offset, pitch_rate, rise, sine, cosine)
        place = (y - key.hinge_forward, z - key.hinge_up)
        depth, opening = _tip_on_key(place, moving, radius, theta, omega)
        forces[tick] = pad_reading(law, size, pad, depth, opening, pad_memory)
    return Motion(wrist, forces, angles, rates, contacts[:heard])


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _tip_on_key(
    place: tuple[float, float],
    moving: tuple[float, float],
    radius: float,
    theta: float,
    omega: float,
) -> tuple[float, float]:
    """Depth, m, and speed of opening, m/s, of a tip of ``radius`` m at ``place`` from the hinge
    that moves at ``moving`` m/s, on a key at ``theta`` rad and ``omega`` rad/s.
    """
    sine, cosine = math.sin(theta), math.cos(theta)
    depth = sine * place[0] - cosine * place[1] + radius
    turning = (-cosine * place[0] - sine * place[1]) * omega
    return depth, -sine * moving[0] + cosine * moving[1] + turning


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _give_way(law: int, compliance: float, force: float, give: Array, h: float) -> None:
    """The arm gives way under ``force``, N. Law 1: 60 % with 12 ms, 40 % with 150 ms (springs with
    dampers, Zener 1948); law 2: by the power 0.7 of the force, with 15 ms.
    """
    if law == 1:
        fast = (compliance * 0.6 * force - give[_FAST]) / 0.012
        slow = (compliance * 0.4 * force - give[_SLOW]) / 0.15
    else:
        fast = (compliance * 1.39 * force**0.7 - give[_FAST]) / 0.015
        slow = 0.0
    give[_FAST] += h * fast
    give[_SLOW] += h * slow
    before = give[_SPEED]
    give[_SPEED] = fast + slow
    give[_ACCELERATION] = min(max((give[_SPEED] - before) / h, -20.0), 20.0)


@dataclass(frozen=True)
class _Session:
    """The time axis of a recording and its random numbers.

    ``ends`` (n,) s are the ticks' ends, ``targets`` (m, 3) m what holds in each controller's cycle,
    ``setpoints`` (n, 3) Pa; ``variation`` as in :class:`Drive`; ``wanders`` (3, n) m of the arm;
    ``gain`` (n,) is the force sensor's; ``scatter`` (512, 3) that of the regulators' dead band.
    """

    origin: float
    ends: Array
    targets: Array
    setpoints: Array
    variation: Array
    wanders: Array
    gain: Array
    scatter: Array


def _session(commands: Commands, seed: int, repeat: float) -> _Session:
    """Time axis and variation of a session; ``repeat`` scales the variation from its levels."""
    origin = float(commands.time[0])
    cycles = int(np.ceil((float(commands.time[-1]) - origin) / CYCLE - 1e-6)) + 1
    ticks = cycles * CYCLE_TICKS
    starts = origin + CYCLE * np.arange(cycles)
    at = np.searchsorted(commands.time, starts + 1e-6, side="right") - 1
    ends = origin + TICK * np.arange(1, ticks + 1)
    held = np.searchsorted(commands.vacuum_time, ends - TICK + 1e-6, side="right") - 1
    random = np.random.default_rng([seed, 0xF0])
    variation = np.column_stack(
        [
            random.standard_normal(VARIED_STRIKES) * HEIGHT_SPREAD * repeat,
            random.standard_normal(VARIED_STRIKES) * STIFFNESS_SPREAD * repeat,
            random.standard_normal(VARIED_STRIKES) * DAMPING_SPREAD * repeat,
        ]
    )
    white = random.standard_normal((4, ticks))
    spread = noise_levels().fsr_gain_spread
    return _Session(
        origin=origin,
        ends=np.asarray(ends, dtype=np.float64),
        targets=commands.position[np.maximum(at, 0)],
        setpoints=np.ascontiguousarray(commands.pressure[np.maximum(held, 0)]),
        variation=variation,
        wanders=np.array([WANDER * repeat * wander(w, TICK, WANDER_TIME) for w in white[:3]]),
        gain=1 + repeat * spread * slow_noise(white[3], TICK, GAIN_TIME),
        scatter=random.random((512, 3)),
    )


def play(
    commands: Commands,
    effects: Effects,
    parameters: Mapping[str, float],
    seed: int,
    repeat: float = 1.0,
    noise: float = 1.0,
    step: float = STEP,
) -> Recording:
    """The recording of a cell with ``effects`` and ``parameters`` (factors) that is told
    ``commands`` for the middle finger.

    ``repeat`` and ``noise`` scale the variation from strike to strike and the sensors' noise;
    velocities are whole numbers only with noise. ``step`` in s. Raises :class:`UnstableError`.
    """
    factors = {name: parameters.get(name, 1.0) for name in PARAMETERS}
    session = _session(commands, seed, repeat)
    pressures = true_pressures(session.setpoints, effects, session.scatter, TICK)
    drive = _drive(commands, session, effects, pressures[:, 2], factors["joint_stiffness"], step)
    laws = np.array([acting(effects, name).law for name in MECHANICAL])
    sizes = np.array([acting(effects, name).strength for name in MECHANICAL])
    substeps = round(TICK / step)
    ticks = len(session.ends)
    motion = _move(_cell(effects, factors), drive, (laws, sizes), ticks, substeps, step)
    if not (np.isfinite(motion.angle).all() and np.abs(motion.angle).max() < LARGEST_ANGLE):
        raise UnstableError
    return _observe(commands, session, effects, factors, motion, pressures, (seed, noise))


def _cell(effects: Effects, factors: Mapping[str, float]) -> Cell:
    """The cell's numbers by the configuration in force."""
    model, key = hand(), white_key()
    base = np.array(model.fingers["middle"].base)
    on, off = contact_angles(keyboard().midi, effects)
    return Cell(
        finger=middle_finger(),
        pad=Pad(model.pad.stiffness, model.pad.damping, model.pad.friction),
        key=key._replace(
            inertia=key.inertia * factors["key_inertia"],
            stiffness=key.stiffness * factors["key_stiffness"],
            damping=key.damping * factors["key_damping"],
        ),
        joint_damping=model.joints.damping * factors["joint_damping"],
        forward=base[1],
        up=base[2],
        note_on=on,
        note_off=off,
    )


def _drive(
    commands: Commands,
    session: _Session,
    effects: Effects,
    pressure: Array,
    stiffness_factor: float,
    step: float,
) -> Drive:
    """What moves the finger, whose vacuum has ``pressure`` (n,), Pa."""
    ticks = len(session.ends)
    steps = ticks * round(TICK / step)
    heights, speeds = arm_heights(np.ascontiguousarray(session.targets[:, 2]), effects, steps, step)
    nodes, marks = np.arange(steps + 1) * step, np.arange(1, ticks + 1) * TICK
    calibration = stiffness_calibration()
    order = np.argsort(calibration.pressure)
    curve = PchipInterpolator(
        np.array(calibration.pressure)[order], np.array(calibration.stiffness)[order]
    )
    begin = [round((s.start - session.origin) * 1000) - VARY_BEFORE for s in commands.strikes]
    return Drive(
        height=heights + np.interp(nodes, marks, session.wanders[2]),
        speed=speeds,
        forward=session.targets[0, 1] + session.wanders[1],
        stiffness=curve(np.clip(pressure, -1e5, 0)) * stiffness_factor,
        pressure=pressure.copy(),
        begin=np.array(begin),
        variation=session.variation,
    )


def _observe(
    commands: Commands,
    session: _Session,
    effects: Effects,
    factors: Mapping[str, float],
    motion: Motion,
    pressures: Array,
    drawn: tuple[int, float],
) -> Recording:
    """What is recorded of a motion; ``drawn`` are the seed and the factor of the noise."""
    seed, noise = drawn
    levels, random = noise_levels(), np.random.default_rng([seed, 0xF1])
    signals = commands.signals()
    at = slice(CYCLE_TICKS - 1, None, CYCLE_TICKS)
    time, wanders = session.ends[at], session.wanders
    position = np.column_stack(
        [
            session.targets[0, 0] + wanders[0][at],
            (session.targets[0, 1] + wanders[1])[at],
            motion.wrist[at],
        ]
    )
    position = position + noise * levels.wrist_position * random.standard_normal((len(time), 3))
    rotation = np.tile(commands.rotation[0], (len(time), 1))
    rotation = rotation + noise * levels.wrist_rotation * random.standard_normal((len(time), 3))
    signals["real/wrist/state.position"] = TimeSeries(time, position, "m")
    signals["real/wrist/state.rotation"] = TimeSeries(time, rotation, "rad")
    at = slice(AIR_TICKS - 1, None, AIR_TICKS)
    time, measured = session.ends[at], pressures[at]
    measured = measured + noise * levels.pressure * random.standard_normal(measured.shape)
    signals["real/vacuum/state.setpoint"] = TimeSeries(time, session.setpoints[at], "Pa")
    signals["real/vacuum/state.measured"] = TimeSeries(time, measured, "Pa")
    radius, note = white_key().radius, fsr_config().sensor.note
    force = force_shown(motion.force, np.gradient(motion.rate, TICK), radius, effects, TICK)
    force = force * factors["fsr_gain"] * session.gain
    if "mains_hum" in effects:
        force = force + mains_hum(session.ends, effects)
    at = slice(RIG_TICKS - 1, None, RIG_TICKS)
    stamps = session.origin + sensor_clock(session.ends[at] - session.origin, effects)
    angle = angle_shown(motion.angle, effects)[at]
    converter = Converter()
    counts = converter.counts(force[at] + noise * levels.fsr * random.standard_normal(len(stamps)))
    shown = converter.force(counts) if noise else force[at]
    signals["real/fsr.force"] = TimeSeries(stamps, shown, "N")
    signals["real/fsr.counts"] = TimeSeries(stamps, counts.astype(float), "1")
    shown = converter.angle(angle) if noise else angle
    signals[f"real/key_angle.{note}"] = TimeSeries(stamps, shown, "rad")
    gain = keyboard().midi.velocity_gain * factors["midi_velocity_gain"]
    heard = notes_heard(motion.contacts, (gain, radius), effects, (seed, noise))
    notes = [NoteEvent(session.origin + t, on, note, velocity) for t, on, velocity in heard]
    notes.sort(key=lambda n: n.time)
    return Recording(signals, {"real": notes}, list(commands.strikes), note, source="cell")
