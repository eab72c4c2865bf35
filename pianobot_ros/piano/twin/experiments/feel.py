"""What key and finger feel of each other: the tip's displacement under load (Fig. 7(a)), the force
of friction at the contact, the impedances that meet at the key (the action paper's Discussion), and
how far a hard press drives a key past its bed; and what the assumed numbers of the keys move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import root

from pianobot_ros.cell.arrays import Array, ComplexArray
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import Keyboard, hand
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.numbers.config import load_provenance, load_section
from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.twin.experiments.single_note import DEGREE, MOTION, NOTE
from pianobot_ros.piano.twin.model.arm import ArmTracker
from pianobot_ros.piano.twin.model.hand import tip_geom
from pianobot_ros.piano.twin.model.keyboard import key_geom
from pianobot_ros.piano.twin.reduced.strike_geometry import finger_model, key_model, stiffness_of
from pianobot_ros.piano.twin.reduced.strike_model import StrikeModel, Stroke, key_strokes
from pianobot_ros.piano.twin.reduced.strike_records import FingerModel, KeyModel
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin
from pianobot_ros.piano.twin.stepping.rollout import reduced, strike_commands

__all__ = [
    "JAMMED",
    "LOADS",
    "Assumed",
    "FeelSource",
    "Friction",
    "HardPress",
    "assumed",
    "contact_friction",
    "finger_impedance",
    "key_impedance",
    "presses",
    "second_order",
    "sources",
    "tip_displacement",
]

LOADS = np.linspace(0.0, 4.0, 21)  # N
STIFFNESSES = (0.05, 0.2, 0.5, 2.0)  # N m/deg
FRICTION_STIFFNESS = 0.5  # N m/deg
HARD = StrikeMotion(speed=0.3, depth=0.018, hold=0.2)
HARD_STIFFNESSES = (0.1, 0.5, 2.0)  # N m/deg
USUAL = StrikeMotion(speed=0.2, depth=0.012, hold=0.2)
USUAL_STIFFNESS = 0.5  # N m/deg
TICK = 1e-3  # s
HUMAN = ((0.006, 2.0, 100.0), (0.006, 2.0, 400.0))
"""kg, N s/m, N/m of a human finger: Hajian and Howe 1997, as the action paper quotes them."""

JAMMED = (
    ("bead-string jamming, a finger's joint: Westermann and others, arXiv 2502.04190", 0.48, 1.95),
    ("the soft-hand paper's range, 0.05 to 2 N m/deg", 0.05 * DEGREE, 2.0 * DEGREE),
)
"""Published joint stiffness (N m/rad), lowest and highest."""


def tip_displacement(
    stiffness: float, loads: Sequence[float] | Array = LOADS, finger: str = "middle"
) -> Array:
    """How far (m) the tip of ``finger`` rises under vertical ``loads`` (n,) N with joints of
    ``stiffness`` N m/rad, the pad's compression included; the wrist stands still, the tip may slide
    along. Raises :class:`PianobotError` where the finger gives way.
    """
    model = finger_model(finger)
    n = len(model.length)
    rest = _down(model, np.zeros(n))
    found, angles = [], np.zeros(n)
    for load in loads:
        solved = root(
            lambda q, f=float(load): stiffness * q - f * _levers(model, q), angles, tol=1e-10
        )
        if not solved.success:
            raise PianobotError(f"the finger gives way under {load:.1f} N: stiffen its joints")
        angles = solved.x
        found.append(rest - _down(model, angles) + load / model.pad_stiffness)
    return np.array(found)


def _down(model: FingerModel, bend: Array) -> float:
    """Depth (m) of the tip's centre under the finger's base when the joints yield by ``bend``
    (n,).
    """
    return float(np.sum(model.length * np.sin(model.pitch - np.cumsum(bend))))


def _levers(model: FingerModel, bend: Array) -> Array:
    """Levers (n,) m of a vertical force at the tip about the joints."""
    reach = model.length * np.cos(model.pitch - np.cumsum(bend))
    return np.asarray(np.cumsum(reach[::-1])[::-1])


def finger_impedance(stiffness: float, frequency: Array, finger: str = "middle") -> ComplexArray:
    """Vertical driving-point impedance (N s/m) at the tip of the soft hand's ``finger`` with joints
    of ``stiffness`` N m/rad, at ``frequency`` (n,) Hz; linear about rest, pad in series.
    """
    model = finger_model(finger)
    lever = _levers(model, np.zeros(len(model.length)))
    mass = model.mass[1:, 1:]
    mobility = []
    for s in 2j * np.pi * np.asarray(frequency):
        joints = s**2 * mass + (s * model.damping + stiffness) * np.eye(len(lever))
        yields = lever @ np.linalg.solve(joints, lever) + 1 / (
            model.pad_stiffness + s * model.pad_damping
        )
        mobility.append(s * yields)
    return np.asarray(1.0 / np.array(mobility), dtype=complex)


def second_order(mass: float, damping: float, stiffness: float, frequency: Array) -> ComplexArray:
    """Impedance (N s/m) of a mass, damper and spring side by side at ``frequency`` (n,) Hz."""
    s = 2j * np.pi * np.asarray(frequency)
    return np.asarray(mass * s + damping + stiffness / s, dtype=complex)


def key_impedance(p: ActionParameters, frequency: Array) -> ComplexArray:
    """Driving-point impedance (N s/m) of the prepared action at the key, without the armature."""
    s = 2j * np.pi * np.asarray(frequency)
    coupler = p.hammer.coupler_damping + p.hammer.coupler_stiffness / s
    hammer = p.hammer.mass * s + p.hammer.bushing_damping
    own = (p.key.mass + p.key.whippen_mass) * s + p.key.damping
    return np.asarray(own + 1.0 / (1.0 / coupler + 1.0 / hammer), dtype=complex)


@dataclass(frozen=True)
class FeelSource:
    """What presses the key: ``impedance`` (n,) N s/m at the frequencies; static ``stiffness``
    N/m.
    """

    name: str
    stiffness: float
    impedance: ComplexArray


def sources(frequency: Array, p: ActionParameters | None = None) -> list[FeelSource]:
    """Human finger, voice coil and soft hand, and the key itself as the last."""
    p = p or load_parameters()
    found = [
        FeelSource(f"human finger, {k:g} N/m", k, second_order(m, b, k, frequency))
        for m, b, k in HUMAN
    ]
    a = p.armature
    coil = second_order(a.mass, a.damping, a.stiffness, frequency)
    found.append(FeelSource("voice coil (armature)", a.stiffness, coil))
    for k in (STIFFNESSES[0], STIFFNESSES[1], STIFFNESSES[-1]):
        static = 1.0 / (float(tip_displacement(k * DEGREE, [1e-3])[0]) / 1e-3)
        name = f"soft finger, k = {k:g} N m/deg"
        found.append(FeelSource(name, static, finger_impedance(k * DEGREE, frequency)))
    found.append(FeelSource("prepared action at the key", 0.0, key_impedance(p, frequency)))
    return found


@dataclass(frozen=True)
class Friction:
    """Contact between tip and key: ``time`` (n,) s, ``normal`` and ``friction`` (n,) N, the latter
    along the key, positive where it pushes the tip towards the hinge; ``coefficient`` of the pad.
    """

    time: Array
    normal: Array
    friction: Array
    coefficient: float

    @property
    def slipping(self) -> float:
        """Share of the time in contact in which friction is at its limit."""
        touching = self.normal > 0.02 * self.normal.max()
        share = np.abs(self.friction[touching]) / (self.coefficient * self.normal[touching])
        return float(np.mean(share > 0.98))


def contact_friction(stiffness: float = FRICTION_STIFFNESS) -> Friction:
    """The single note of Fig. 8(a) with joints of ``stiffness`` N m/deg, step by step, with both
    forces of the contact.
    """
    commands = strike_commands({"middle": NOTE}, MOTION)
    twin = CellTwin(reduced("middle", NOTE), commands.pose[0])
    twin.command_vacuum({"middle": 0.0})
    twin.cell.set_stiffness("middle", stiffness * DEGREE)
    model, data = twin.cell.model, twin.data
    tip, key = model.geom(tip_geom("middle")).id, model.geom(key_geom(NOTE)).id
    rows = []
    for target in commands.at_steps(twin.cell.timestep):
        twin.step(1, target[None])
        along, normal, wrench = 0.0, 0.0, np.zeros(6)
        for i in range(data.ncon):
            contact = data.contact[i]
            if {contact.geom1, contact.geom2} == {tip, key}:
                mujoco.mj_contactForce(model, data, i, wrench)
                force = contact.frame.reshape(3, 3).T @ wrench[:3]  # on the second body
                upward = 1.0 if contact.geom2 == tip else -1.0
                normal += float(wrench[0])
                along += upward * float(force[1] - wrench[0] * contact.frame[1])
        rows.append((twin.time, normal, along))
    time, normal_, along_ = np.array(rows).T
    return Friction(time, normal_, along_, hand().pad.friction)


@dataclass(frozen=True)
class HardPress:
    """The largest ``force`` (N) of a strike, how far it drove the key past its bed (``past``, m, at
    the stops' radius), and the same with springs for stops.
    """

    preset: str
    stiffness: float  # N m/deg
    force: float
    past: float
    past_springs: float


def _strike(key: KeyModel, stiffness: float, motion: StrikeMotion = HARD) -> Stroke:
    """A strike of E4 by the middle finger with joints of ``stiffness`` N m/deg."""
    model = StrikeModel(finger_model("middle"), key)
    commands = strike_commands({"middle": NOTE}, motion)
    _, pose, _ = ArmTracker(TICK, commands.pose[0]).advance(commands.at_steps(TICK))
    time = np.asarray(TICK * np.arange(1, len(pose) + 1), dtype=np.float64)
    given = model.input(time, pose[:, :3], pose[0, 3:], 0.0, 0.02, float(time[-1]) - 0.02)
    factor = stiffness * DEGREE / float(stiffness_of(0.0))
    return model.strike(given, {"joint_stiffness": factor})


def presses() -> list[HardPress]:
    """Hard strikes of E4 by the middle finger: every preset of the keys, hands soft to stiff."""
    board = load_section("keyboard.yaml", Keyboard)
    found = []
    for name in board.presets:
        key = key_model(NOTE, board.with_keys(name))
        springs = key_model(NOTE, board.with_keys(name, felt_power=1.0))
        for stiffness in HARD_STIFFNESSES:
            strokes = [_strike(k, stiffness) for k in (key, springs)]
            force = float(strokes[0].force.max())
            past = [key.stop_radius * (float(s.angle.max()) - key.max_angle) for s in strokes]
            found.append(HardPress(name, stiffness, force, past[0], past[1]))
    return found


@dataclass(frozen=True)
class Assumed:
    """What ``value`` (in ``unit``) of the number ``name`` changes in a strike on keys of
    ``preset``, which have ``configured``: fractions of peak force, V_pre, V_rel and T_hold.
    """

    preset: str
    name: str
    configured: float
    value: float
    unit: str
    changes: tuple[float, ...]


def assumed() -> list[Assumed]:
    """All alternatives that ``config/keyboard.yaml`` names for the numbers of its keys, one at a
    time, on E4 struck by the middle finger.
    """
    board, provenance = load_section("keyboard.yaml", Keyboard), load_provenance("keyboard.yaml")
    found = []
    for preset in board.presets:
        own, before = f"presets.{preset}.", _heard(board.with_keys(preset))
        entries = {
            n.removeprefix("mechanism."): e for n, e in provenance.items() if n[:4] == "mech"
        }
        entries |= {n.removeprefix(own): e for n, e in provenance.items() if n.startswith(own)}
        for name, entry in entries.items():
            for value in entry.get("alternatives", []):
                after = _heard(board.with_keys(preset, **{name: value}))
                changes = tuple(float(x) for x in after / before - 1)
                found.append(Assumed(preset, name, entry["value"], value, entry["unit"], changes))
    return found


def _heard(board: Keyboard) -> Array:
    """Peak force N, V_pre and V_rel m/s, T_hold s of a strike on ``board``."""
    key = key_model(NOTE, board)
    stroke = _strike(key, USUAL_STIFFNESS, USUAL)
    sounded = key_strokes(stroke, NOTE, key.radius, board.midi)[0]
    return np.array([stroke.force.max(), sounded.v_pre, sounded.v_rel, sounded.t_hold])
