"""The fingertip on a keyboard with piano actions: strikes from soft to loud, and a note repeated
from half-way.

The hand of the one paper plays the action of the other, with the parts that the latter leaves for
later.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.action.hybrid.action_model import PARTS
from pianobot_ros.piano.action.mujoco.mujoco_parts import ActionEvent
from pianobot_ros.piano.twin.model.cell_model import TwinOptions
from pianobot_ros.piano.twin.stepping.rollout import Run, play, strike_commands

__all__ = ["NOTE", "Repetition", "Struck", "grand", "half_way", "repetition", "strike_action"]

NOTE = 64
PRESSURE = -50e3  # Pa
SPEEDS = (0.1, 0.15, 0.2, 0.3)  # m/s of the wrist
RETURN = 0.4  # s: a key returned by weights alone takes longer than one on a spring
# The wrist's height (m) over touching: press, ease by 7 mm so that the key comes back by about half
# its way, press, lift.
KNOTS = (
    (0.0, 0.004),
    (0.3, 0.004),
    (0.38, -0.013),
    (0.53, -0.013),
    (0.61, -0.006),
    (0.71, -0.006),
    (0.79, -0.013),
    (1.04, -0.013),
    (1.12, 0.004),
    (1.4, 0.004),
)


@dataclass(frozen=True)
class Struck:
    """One strike: the wrist's ``speed`` and that of the hammer's head on meeting the string, m/s;
    ``lag`` from let-off to string and ``bottom`` from string to key bottom (negative: before), s;
    V_pre m/s and T_hold s of the key.
    """

    speed: float
    hammer_speed: float
    lag: float
    bottom: float
    v_pre: float
    t_hold: float


@dataclass(frozen=True)
class Repetition:
    """The repeated note with and without the repetition lever, and ``strikes`` from soft to
    loud.
    """

    with_lever: Run
    without: Run
    strikes: tuple[Struck, ...]


def grand(parts: Iterable[str] = PARTS, note: int = NOTE) -> TwinOptions:
    """The middle finger on one key with the piano action and ``parts``."""
    return TwinOptions(
        fingers=("middle",), notes=(note,), mechanism="action", parts=frozenset(parts)
    )


def half_way() -> Commands:
    """Press, ease so that the key returns only part of its way, and press again."""
    t, z = np.array(KNOTS).T
    time = np.arange(0.0, t[-1], 1e-3)
    i = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 2)
    share = (1 - np.cos(np.pi * (time - t[i]) / (t[i + 1] - t[i]))) / 2
    touching = wrist_pose({"middle": NOTE})
    position = np.tile(touching.position, (time.size, 1))
    position[:, 2] += z[i] + (z[i + 1] - z[i]) * share
    rotation = np.tile(touching.rotation.as_rotvec(), (time.size, 1))
    pressure = np.full((1, 3), PRESSURE)
    return Commands(time, position, rotation, pressure=pressure, tail=float(t[-1] - time[-1]))


def strike_action(speed: float, options: TwinOptions | None = None) -> Run:
    """One strike of the wrist at ``speed`` m/s on the action, until the key is back."""
    options = options or grand()
    (note,) = options.notes or (NOTE,)
    commands = strike_commands(
        {"middle": note}, StrikeMotion(speed, 0.014, 0.15), pressure=PRESSURE
    )
    return play(replace(commands, tail=RETURN), options)


def repetition() -> Repetition:
    """Play the repeated note with and without the lever, and the strikes with all parts."""
    commands = half_way()
    runs = [play(commands, grand(parts)) for parts in (PARTS, PARTS - {"repetition_lever"})]
    return Repetition(runs[0], runs[1], tuple(_struck(speed) for speed in SPEEDS))


def _struck(speed: float) -> Struck:
    run = strike_action(speed)
    string, jack, bottom = (
        _first(run.action, rule) for rule in ("string made", "jack out", "bottom")
    )
    advantage = load_parameters().hammer.advantage
    (stroke,) = run.strokes
    return Struck(
        speed,
        string.hammer_velocity * advantage,
        string.time - jack.time,
        bottom.time - string.time,
        stroke.v_pre,
        stroke.t_hold,
    )


def _first(events: Iterable[ActionEvent], rule: str) -> ActionEvent:
    return next(e for e in events if e.rule == rule)
