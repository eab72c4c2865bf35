"""From wanted dynamics to wrist motion and vacuum: the inverse that the soft-hand paper names as
future work.

For every wanted keystroke (MIDI velocity and hold time) the twin is solved for the wrist's peak
speed and its time at the bottom. The shallowest stroke and the softest vacuum level that reach the
velocity within the wrist's speed limit are taken: they press the key bed least.

The twin is the nominal one, or the one that a recording of the cell tells (:mod:`belief`); how far
the cell may answer otherwise stands beside each strike as a 90 % interval.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from pianobot_ros.cell.errors import PianobotError, ScoreError
from pianobot_ros.cell.motion.geometry import keyboard, pivot_radius
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.nominal import wrist_servo
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.cell.recordings.commands import CYCLE
from pianobot_ros.cell.recordings.keystroke import Keystroke, midi_velocity
from pianobot_ros.piano.identify.cell.belief import (
    Belief,
    as_played,
    belief_before,
    mechanics_and_effects,
    spread_of,
    stiffness_factor,
)
from pianobot_ros.piano.identify.cell.cell_fit import shifted
from pianobot_ros.piano.twin.reduced.splicing import servo_response
from pianobot_ros.piano.twin.reduced.strike_model import GRID, Stroke, key_strokes, strike_model

__all__ = [
    "Played",
    "Wanted",
    "play",
    "solve",
    "velocity_scale",
    "wanted_from_midi",
    "write_phrase",
]

LEVELS = (0.0, -50e3, -100e3)  # Pa: the three jamming levels, softest first
SPEEDS = (0.02, 0.60)  # m/s: range of peak wrist speeds searched
DEPTHS = (0.010, 0.014, 0.018, 0.024)  # m
SETTLE = 0.25  # s after the motion: servo and key come to rest
USED = 0.95  # of the arm's acceleration limit
PP_TO_FF = (20, 100)  # MIDI velocities


@dataclass(frozen=True)
class Wanted:
    """A keystroke to be played: MIDI ``velocity`` 1 to 127 and ``t_hold`` s of ``note``."""

    note: int
    velocity: int
    t_hold: float


@dataclass(frozen=True)
class Played:
    """What to command for it, and what the twin says it gives: ``keystroke`` and ``peak_force``
    N. ``velocity_error`` and ``t_hold_error`` (s): half widths of the 90 % intervals by what is not
    known of the cell; NaN where the note may fail to sound within them.
    """

    wanted: Wanted
    motion: StrikeMotion
    pressure: float
    finger: str
    keystroke: Keystroke
    velocity: float
    peak_force: float
    velocity_error: float = float("nan")
    t_hold_error: float = float("nan")

    def as_dict(self) -> dict[str, Any]:
        """The strike as plain data for JSON."""
        return asdict(self)


def velocity_scale(note: int = 64, count: int = 12, t_hold: float = 0.3) -> list[Wanted]:
    """``count`` velocities from pp to ff, evenly spaced."""
    return [Wanted(note, round(v), t_hold) for v in np.linspace(*PP_TO_FF, count)]


def play(
    motion: StrikeMotion,
    note: int,
    pressure: float,
    finger: str = "middle",
    values: Mapping[str, float] | None = None,
) -> tuple[Keystroke | None, Stroke]:
    """The keystroke (None: the key does not sound) and stroke that the twin gives for a commanded
    strike; ``values`` as in :class:`~pianobot_ros.piano.identify.cell.belief.Belief`, nominal if
    left out.
    """
    values = values or {}
    servo = wrist_servo()
    pose = wrist_pose({finger: note})
    time = np.arange(0.0, motion.duration + SETTLE, GRID)
    # The controller holds each command for a cycle.
    commanded = motion.height(np.floor(time / CYCLE + 1e-9) * CYCLE)
    height = servo_response(
        np.ascontiguousarray(commanded), GRID, servo.natural_frequency, servo.damping_ratio
    )
    wrist = np.tile(pose.position, (time.size, 1))
    wrist[:, 2] += height
    model = strike_model(finger, note)
    given = model.input(time, wrist, pose.rotation.as_rotvec(), pressure, 0.0, float(time[-1]))
    factor = stiffness_factor(values, pressure, finger)
    given = replace(given, stiffness=np.ascontiguousarray(given.stiffness * factor))
    stroke = model.strike(given, mechanics_and_effects(values))
    midi = keyboard().midi
    found = [
        k
        for k in key_strokes(stroke, note, pivot_radius(note), shifted(midi, values))
        if np.isfinite(k.t_hold)
    ]
    return (as_played(found[0], midi, values) if found else None), stroke


def solve(
    wanted: Sequence[Wanted],
    *,
    finger: str = "middle",
    depths: Sequence[float] = DEPTHS,
    max_speed: float = SPEEDS[1],
    levels: Sequence[float] = LEVELS,
    belief: Belief | None = None,
) -> list[Played]:
    """Wrist motion and vacuum for each wanted keystroke.

    ``depths`` m are the commanded travels below the touching height that are tried, shallowest
    first: a louder stroke needs a deeper one, because the half cosine is slow again at its end.
    ``belief``: what is known of the cell, by default config/priors.yaml.
    Raises :class:`ScoreError` naming the first keystroke that no vacuum level reaches within
    ``max_speed`` m/s, or whose hold is shorter than the stroke itself.
    """
    known = belief or belief_before()
    return [_solve_one(w, finger, depths, max_speed, levels, known) for w in wanted]


def _solve_one(
    wanted: Wanted,
    finger: str,
    depths: Sequence[float],
    max_speed: float,
    levels: Sequence[float],
    belief: Belief,
) -> Played:
    reached, values = 0.0, belief.values()
    for depth, pressure in itertools.product(depths, levels):
        motion = _speed_for(wanted, finger, depth, pressure, max_speed, values)
        if isinstance(motion, float):
            reached = max(reached, motion)
            continue
        motion = _hold_for(wanted, motion, finger, pressure, values)
        keystroke, stroke = play(motion, wanted.note, pressure, finger, values)
        if keystroke is None:
            continue
        velocity = keystroke.v_pre * keyboard().midi.velocity_gain
        errors = _errors(wanted, motion, finger, pressure, belief)
        peak = float(stroke.force.max())
        return Played(wanted, motion, pressure, finger, keystroke, velocity, peak, *errors)
    raise ScoreError(
        f"velocity {wanted.velocity} on note {wanted.note} is out of reach: up to {max_speed:.2f}"
        f" m/s, within the arm's acceleration, the wrist gives at most {reached:.0f}; allow a"
        " faster wrist or ask for less"
    )


def _errors(
    wanted: Wanted, motion: StrikeMotion, finger: str, pressure: float, belief: Belief
) -> tuple[float, float]:
    """Half widths of the 90 % intervals of velocity and T_hold (s)."""
    gain = keyboard().midi.velocity_gain

    def predict(values: Mapping[str, float]) -> tuple[float, ...] | None:
        keystroke, _ = play(motion, wanted.note, pressure, finger, values)
        return (gain * keystroke.v_pre, keystroke.t_hold) if keystroke else None

    velocity, t_hold = spread_of(belief, predict)
    return velocity, t_hold


def _speed_for(
    wanted: Wanted,
    finger: str,
    depth: float,
    pressure: float,
    max_speed: float,
    values: Mapping[str, float],
) -> StrikeMotion | float:
    """The motion whose note-on velocity is the wanted one, or the largest velocity that was
    reached.
    """
    gain = keyboard().midi.velocity_gain

    def miss(log_speed: float) -> float:
        motion = StrikeMotion(float(np.exp(log_speed)), depth, wanted.t_hold)
        keystroke, _ = play(motion, wanted.note, pressure, finger, values)
        return (keystroke.v_pre * gain if keystroke else 0.0) - wanted.velocity

    # Fast strikes need not be monotonic in speed, so look for the first crossing instead of
    # trusting the ends.
    limits = wrist_limits()
    travel = depth + StrikeMotion(1.0, depth, 0.0).clearance
    # A half cosine of peak speed v over a travel A accelerates by 2 v^2 / A.
    fastest = min(
        max_speed, SPEEDS[1], limits.speed, float(np.sqrt(USED * limits.acceleration * travel / 2))
    )
    grid = np.linspace(np.log(SPEEDS[0]), np.log(fastest), 9)
    misses = [miss(u) for u in grid]
    for i in range(len(grid) - 1):
        if misses[i] <= 0 < misses[i + 1]:
            speed = float(np.exp(brentq(miss, grid[i], grid[i + 1], xtol=1e-3)))
            return StrikeMotion(speed, depth, wanted.t_hold)
    if misses[0] > 0:  # the slowest wrist is already too loud; shallower strokes would be needed
        return StrikeMotion(float(np.exp(grid[0])), depth, wanted.t_hold)
    return max(misses) + wanted.velocity


def _hold_for(
    wanted: Wanted,
    motion: StrikeMotion,
    finger: str,
    pressure: float,
    values: Mapping[str, float],
) -> StrikeMotion:
    """The same motion with the time at the bottom that gives the wanted T_hold."""
    held = motion
    for _ in range(6):
        keystroke, _ = play(held, wanted.note, pressure, finger, values)
        if keystroke is None:
            raise PianobotError(
                f"note {wanted.note} does not sound at {held.speed:.3f} m/s: strike deeper"
            )
        miss = wanted.t_hold - keystroke.t_hold
        if abs(miss) < 5e-4:
            break
        if held.hold + miss < 0:
            shortest = keystroke.t_hold - held.hold
            if held.hold == 0:
                raise ScoreError(
                    f"a hold of {wanted.t_hold:.2f} s at velocity {wanted.velocity} is out of"
                    f" reach: the stroke alone takes {shortest:.2f} s; ask for a longer note or a"
                    " louder one"
                )
        held = StrikeMotion(held.speed, held.depth, float(max(0.0, held.hold + miss)))
    return held


def wanted_from_midi(path: str | Path) -> list[Wanted]:
    """The notes of a standard MIDI file that are on the keyboard. Raises :class:`ScoreError` for a
    file that is none.
    """
    from pianobot_ros.piano.identify.takes.references import midi_keystrokes

    midi = keyboard().midi
    return [
        Wanted(k.note, midi_velocity(k.v_pre, midi), k.t_hold)
        for k in midi_keystrokes(path)
        if k.note in keyboard().notes
    ]


def write_phrase(played: Sequence[Played], path: str | Path) -> Path:
    """The strikes as a phrase file, in order."""
    strikes = [
        {
            "note": p.wanted.note,
            "finger": p.finger,
            "speed": round(float(p.motion.speed), 5),
            "depth": p.motion.depth,
            "hold": round(float(p.motion.hold), 5),
            "clearance": p.motion.clearance,
            "pressure": p.pressure,
            "condition": f"v{p.wanted.velocity}",
        }
        for p in played
    ]
    text = yaml_text({"description": "Solved for wanted dynamics.", "strikes": strikes})
    return write_whole(path, text)
