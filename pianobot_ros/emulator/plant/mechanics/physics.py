"""The plant's numbers in the form that its compiled code takes, and its mutable state."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import (
    FINGERS,
    hand,
    is_black,
    key_centre,
    keyboard,
    pivot_radius,
)
from pianobot_ros.cell.numbers.config import Section, configured, quantity
from pianobot_ros.cell.numbers.nominal import stiffness_calibration
from pianobot_ros.emulator.plant.laws import row_layout

__all__ = [
    "GRAVITY",
    "NO_EFFECTS",
    "Model",
    "Physics",
    "Plant",
    "Simulated",
    "State",
    "new_state",
    "physics",
    "plant_parameters",
]


GRAVITY = 9.81


class Physics(Section):
    """What the nominal laws leave open, and the repeatability of the cell (``config/plant.yaml:
    physics``).
    """

    step: float = quantity("s", low=1e-6, high=2e-4)
    hinge_height: float = quantity("m")
    friction_stiffness: float = quantity("N/m", low=0)
    friction_damping: float = quantity("N*s/m", low=0)
    height_spread: float = quantity("m", low=0)
    stiffness_spread: float = quantity("1", low=0)
    damping_spread: float = quantity("1", low=0)


physics = configured("plant.yaml", Physics, "physics")
"""What the nominal laws leave open, by the configuration in force."""


_JOINT_EFFECTS = (
    "joint_friction",
    "joint_backlash",
    "joint_hardening",
    "jamming_hysteresis",
    "joint_creep",
)

MECHANICAL_LAWS = (
    *_JOINT_EFFECTS,
    "pad_compliance",
    "tip_slip",
    "tip_offset",
    "key_friction",
    "key_preload",
    "hammer",
    "let_off",
    "felt_nonlinear",
    "trigger_offset",
)
"""Effects inside the mechanics that have several laws."""

_ONE_LAW = (
    "stiffness_temperature",
    "magnetic_snap",
    "loose_hinge",
    "pad_adhesion",
    "palm_sag",
    "grain_fatigue",
    "finger_coupling",
    "pad_mullins",
    "felt_set",
    "thixotropic_grease",
)

NO_EFFECTS: dict[str, float] = dict.fromkeys((*MECHANICAL_LAWS, *_ONE_LAW), 0.0)
"""The effects that act inside the mechanics, all off; their physical parameters are described in
``effects.py``.
"""


class Plant(NamedTuple):
    """Scalar constants of the mechanics, SI; effects by their physical parameter (``effects.py``),
    0 for none; ``…_law`` says by which of its laws an effect acts (``laws/table.py``).
    """

    stiffness_scale: float
    joint_damping: float
    abduction_ratio: float
    pad_stiffness: float
    pad_damping: float
    friction: float
    bristle_stiffness: float
    bristle_damping: float
    hinge_y: float
    hinge_z: float
    key_stiffness: float
    key_damping: float
    resting_torque: float  # N m: presses a key up at angle 0
    max_angle: float
    stop_stiffness: float  # N m/rad
    stop_damping: float
    rest_stiffness: float
    rest_damping: float
    rest_angle: float  # up to which the rest stop reaches
    felt_power: float  # of both stops; 1: springs and dampers
    felt_force: float  # N at which the felt is as stiff and as lossy as these
    reference_radius: float
    trigger_on: float
    trigger_off: float
    height_spread: float
    stiffness_spread: float
    damping_spread: float
    seed: int
    joint_effects: bool
    joint_friction: float
    joint_backlash: float
    joint_hardening: float
    jamming_hysteresis: float
    joint_creep: float
    pad_compliance: float
    tip_slip: float
    tip_offset: float
    key_friction: float
    key_preload: float
    hammer: float
    let_off: float
    felt_nonlinear: float
    trigger_offset: float
    stiffness_temperature: float
    magnetic_snap: float
    loose_hinge: float
    pad_adhesion: float
    palm_sag: float
    grain_fatigue: float
    finger_coupling: float
    pad_mullins: float
    felt_set: float
    thixotropic_grease: float
    joint_friction_law: int
    joint_backlash_law: int
    joint_hardening_law: int
    jamming_hysteresis_law: int
    joint_creep_law: int
    pad_compliance_law: int
    tip_slip_law: int
    tip_offset_law: int
    key_friction_law: int
    key_preload_law: int
    hammer_law: int
    let_off_law: int
    felt_nonlinear_law: int
    trigger_offset_law: int


class Model(NamedTuple):
    """All constants: scalars, and arrays by the columns of ``row_layout.py``. Fingers are thumb,
    index, middle; keys lowest first.
    """

    plant: Plant
    hand: Array  # (3, FINGER_CONSTANTS)
    board: Array  # (12, KEY_CONSTANTS)
    curve: Array  # (5, m) stiffness against pressure, see hand.stiffness_at


class State(NamedTuple):
    """What the mechanics remember, by the columns of ``row_layout.py``. Changed in place."""

    fingers: Array  # (3, FINGER_STATE)
    keys: Array  # (12, KEY_STATE)
    cell: Array  # (CELL_STATE,)


class Simulated(NamedTuple):
    """A plant that runs: its constants, its state, and the indices of the fingers that it has."""

    model: Model
    state: State
    fingers: NDArray[np.int64]


_OF_MECHANISM = ("max_angle", "rest_angle", "felt_power", "felt_force", "reference_radius")
_OF_STOPS = ("stop_stiffness", "stop_damping", "rest_stiffness", "rest_damping")
_SPREADS = ("height_spread", "stiffness_spread", "damping_spread")


def plant_parameters(
    effects: Mapping[str, float] | None = None,
    factors: Mapping[str, float] | None = None,
    *,
    laws: Mapping[str, int] | None = None,
    seed: int = 0,
    repeatability: float = 1.0,
) -> Model:
    """The plant's constants from ``config/``; ``effects`` by physical parameter, ``factors`` of
    wrong parameters; ``laws`` by effect, 0 where nothing is said.
    """
    pad, joints, m, midi = hand().pad, hand().joints, keyboard().mechanism, keyboard().midi
    open_points = physics()
    factor = dict(factors or {})
    squared = m.reference_radius**2
    strength: dict[str, Any] = {
        **NO_EFFECTS,
        **{k: float(v) for k, v in (effects or {}).items() if k in NO_EFFECTS},
    }
    strength["key_friction"] += m.friction_torque
    plant = Plant(
        **strength,
        **{f"{name}_law": int((laws or {}).get(name, 0)) for name in MECHANICAL_LAWS},
        joint_effects=any(strength[name] != 0.0 for name in _JOINT_EFFECTS),
        stiffness_scale=float(factor.get("joint_stiffness", 1.0)),
        joint_damping=joints.damping * float(factor.get("joint_damping", 1.0)),
        abduction_ratio=joints.abduction_ratio,
        pad_stiffness=pad.stiffness,
        pad_damping=pad.damping,
        friction=pad.friction,
        bristle_stiffness=open_points.friction_stiffness,
        bristle_damping=open_points.friction_damping,
        hinge_y=keyboard().origin[1] + keyboard().white.pivot,
        hinge_z=keyboard().origin[2] + open_points.hinge_height,
        key_stiffness=m.stiffness * float(factor.get("key_stiffness", 1.0)),
        key_damping=m.damping * float(factor.get("key_damping", 1.0)),
        resting_torque=m.preload_torque * float(factor.get("key_stiffness", 1.0)),
        **{name: getattr(m, name) for name in _OF_MECHANISM},
        **{name: squared * getattr(m, name) for name in _OF_STOPS},
        trigger_on=midi.trigger_on,
        trigger_off=midi.trigger_off,
        **{name: repeatability * getattr(open_points, name) for name in _SPREADS},
        seed=int(seed),
    )
    return Model(
        plant,
        _hand_rows(),
        _key_rows(open_points.hinge_height, factor.get("key_inertia", 1.0)),
        _stiffness_curve(),
    )


def _hand_rows() -> Array:
    model = hand()
    rows = np.zeros((3, row_layout.FINGER_CONSTANTS))
    for f, name in enumerate(FINGERS):
        finger = model.fingers[name]
        n = len(finger.lengths)
        inertia, moment = _chain(
            np.array(finger.lengths), finger.radius, model.density, model.pad.mass
        )
        square = np.zeros((4, 4))
        square[:n, :n] = inertia
        rows[f, [row_layout.COUNT, row_layout.YAW, row_layout.RADIUS]] = (
            n,
            finger.yaw,
            finger.radius,
        )
        rows[f, row_layout.BASE : row_layout.BASE + 3] = finger.base
        rows[f, row_layout.LENGTH : row_layout.LENGTH + n] = finger.lengths
        rows[f, row_layout.MOMENT : row_layout.MOMENT + n] = moment
        rows[f, row_layout.REST : row_layout.REST + n] = [finger.pitch, *finger.bends]
        rows[f, row_layout.INERTIA : row_layout.INERTIA + 16] = square.ravel()
    return rows


def _key_rows(hinge_height: float, inertia_factor: float) -> Array:
    board = keyboard()
    rows = np.zeros((12, row_layout.KEY_CONSTANTS))
    for j, note in enumerate(board.notes):
        black = is_black(note)
        half = (board.black.width if black else board.white.width) / 2
        centre = key_centre(note, board)
        front = board.origin[1] + (board.black.front if black else 0.0)
        rows[j] = (
            centre - half,
            centre + half,
            front,
            board.origin[1] + board.white.length,
            (board.black.height if black else 0.0) - hinge_height,
            (_key_inertia(black, hinge_height) + board.mechanism.added_inertia) * inertia_factor,
            pivot_radius(note, board),
        )
    return rows


@lru_cache(maxsize=1)
def _stiffness_curve() -> Array:
    calibration = stiffness_calibration()
    order = np.argsort(calibration.pressure)
    levels = np.array(calibration.pressure)[order]
    cubic = PchipInterpolator(levels, np.array(calibration.stiffness)[order])
    curve = np.zeros((5, len(levels)))
    curve[:4, :-1] = cubic.c
    curve[4] = levels
    return curve


def _chain(lengths: Array, radius: float, density: float, pad: float) -> tuple[Array, Array]:
    """Inertia coefficients (n, n) kg m^2 and first moments (n,) kg m of capsules in a row with the
    pad's mass at the end.
    """
    n = len(lengths)
    tube = density * np.pi * radius**2 * lengths
    ball = density * 4 / 3 * np.pi * radius**3  # the two half spheres of a capsule together
    mass = tube + ball
    # About its own middle, across: a cylinder, and half spheres whose centre of mass is 3/8 radius
    # beyond the flat face.
    own = tube * (radius**2 / 4 + lengths**2 / 12) + ball * (
        0.4 * radius**2 + lengths**2 / 4 + 3 / 8 * lengths * radius
    )
    about_joint = own + mass * (lengths / 2) ** 2
    beyond = np.array([mass[i + 1 :].sum() + pad for i in range(n)])
    moment = mass * lengths / 2 + lengths * beyond
    inertia = np.diag(about_joint + lengths**2 * beyond)
    for i in range(n):
        for j in range(i + 1, n):
            inertia[i, j] = inertia[j, i] = lengths[i] * moment[j]
    return inertia, moment


def _key_inertia(black: bool, hinge_height: float) -> float:
    """Inertia of a wooden key stick about the hinge, kg m^2: a box from its front to the hinge."""
    board = keyboard()
    white, sharp = board.white, board.black
    length = white.pivot - (sharp.front if black else 0.0)
    width = sharp.width if black else white.width
    height = white.thickness + (sharp.height if black else 0.0)
    middle = (sharp.height if black else 0.0) - height / 2 - hinge_height
    mass = board.density * length * width * height
    return float(mass * (length**2 / 3 + height**2 / 12 + middle**2))


def new_state(model: Model) -> State:
    """Everything at rest, fingers unloaded and without sag."""
    fingers = np.zeros((3, row_layout.FINGER_STATE))
    rest = model.hand[:, row_layout.REST : row_layout.REST + 4]
    fingers[:, row_layout.PHI : row_layout.PHI + 4] = np.cumsum(rest, axis=1)
    fingers[:, row_layout.CLEAR] = -1.0
    return State(fingers, np.zeros((12, row_layout.KEY_STATE)), np.zeros(row_layout.CELL_STATE))
