"""The motion-driven check: one motion of the key in, the force that it answers with out.

Pressed by a force, any model of an action looks right, because force over inertia hides the rest
(Thorin, Boutillon and Lozada 2014). So every mechanism makes the same motion here: the keys of
config/keyboard.yaml, the paper's hybrid action exactly and in MuJoCo, the action with all parts,
and the action with felt. The hybrid models move with an armature so heavy that the action does not
change its path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Keyboard
from pianobot_ros.cell.numbers.config import load_section
from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.action.felt import STEP, FeltAction
from pianobot_ros.piano.action.hybrid.action_model import PAPER, PARTS, build_model
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Simulator
from pianobot_ros.piano.action.mujoco.mujoco_hybrid import simulate_mujoco
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.twin.reduced.strike_geometry import key_model

__all__ = ["Reaction", "motion", "reaction_rows", "reactions"]

NOTE = 64
TRAVEL, DOWN = 0.009, 0.1  # m, s: a half cosine that stays off the front rail
HEAVY = 1e3  # kg: 4 N move it by 20 um in that time
TICK = 1e-3  # s for which an acceleration holds
EVERY = 25  # steps of the felt model for each that is compared


@dataclass(frozen=True)
class Reaction:
    """Force (n,) N of a mechanism at ``time`` (n,) s; ``name`` says which."""

    name: str
    time: Array
    force: Array

    @property
    def peak(self) -> float:
        """The largest, N."""
        return float(self.force.max())


def motion(step: float) -> tuple[Array, Array, Array, Array]:
    """Time (n,) s, path m, speed m/s and acceleration m/s² of the imposed motion: a half cosine
    whose acceleration holds for :data:`TICK`.
    """
    time = np.asarray(np.arange(round(DOWN / step)) * step, dtype=np.float64)
    middle = (np.floor(time / TICK + 1e-6) + 0.5) * TICK
    acceleration = TRAVEL / 2 * (np.pi / DOWN) ** 2 * np.cos(np.pi * middle / DOWN)
    speed = np.concatenate([[0.0], np.cumsum(acceleration[:-1]) * step])
    path = np.concatenate([[0.0], np.cumsum(speed[:-1] * step + acceleration[:-1] * step**2 / 2)])
    return time, np.asarray(path), np.asarray(speed), np.asarray(acceleration)


def reactions(p: ActionParameters | None = None) -> list[Reaction]:
    """What every mechanism answers to :func:`motion`."""
    p = p or load_parameters()
    board = load_section("keyboard.yaml", Keyboard)
    found = [_spring(name, board) for name in board.presets]
    heavy = p.vary("armature", mass=HEAVY)
    ticks = np.arange(0.0, DOWN, TICK)
    pushes = HEAVY * motion(TICK)[3]
    profile = ForceProfile.steps(list(zip(ticks.tolist(), pushes.tolist(), strict=True)))
    for name, parts in (("hybrid action, exact", PAPER), ("with all parts, exact", PARTS)):
        history = Simulator(build_model(heavy, parts)).run(profile, DOWN).sample(STEP * EVERY)
        found.append(Reaction(name, history.time, history.load_cell))
    found.append(_in_mujoco(heavy, profile))
    time, _, _, acceleration = motion(STEP)
    felt = FeltAction(p).follow(acceleration)
    found.append(Reaction("action with felt", time[::EVERY], felt.force[::EVERY]))
    return found


def _spring(preset: str, board: Keyboard) -> Reaction:
    """A key of config/keyboard.yaml, force at its reference radius."""
    key = key_model(NOTE, board.with_keys(preset))
    time, path, speed, acceleration = motion(STEP * EVERY)
    torque = key.inertia * acceleration + key.damping * speed + key.stiffness * path
    force = torque / key.stop_radius**2 + (key.preload + key.friction) / key.stop_radius
    return Reaction(f"key `{preset}`", time, np.asarray(force))


def _in_mujoco(heavy: ActionParameters, profile: ForceProfile) -> Reaction:
    history = simulate_mujoco(heavy, profile, DOWN, step=TICK / 5)
    h, key = heavy.hammer, heavy.key
    gap, rate = history.key - history.hammer, history.key_velocity - history.hammer_velocity
    coupler = np.maximum(h.coupler_stiffness * gap + h.coupler_damping * rate, 0.0)
    acceleration = np.interp(history.time, *motion(STEP)[::3])
    force = key.mass * acceleration + key.damping * history.key_velocity + coupler
    return Reaction("hybrid action, MuJoCo", history.time, np.asarray(force))


def reaction_rows() -> list[dict[str, str]]:
    """Peak and RMS of each mechanism's answer."""
    return [
        {
            "quantity": r.name,
            "peak": f"{r.peak:.2f} N",
            "rms": f"{float(np.sqrt(np.mean(r.force**2))):.2f} N",
        }
        for r in reactions()
    ]
