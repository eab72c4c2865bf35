"""The keyboard in MuJoCo: wooden keys on hinges, with a spring, a damper and two stops
("Data-driven Simulation Framework", II-B).

The hinge lies at the height of the white keys' tops. A key's weight is in its spring's equilibrium,
so it is balanced out here.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Keyboard, is_black, key_centre

__all__ = [
    "FRICTION_IMPEDANCE",
    "IMPEDANCE",
    "add_key",
    "add_stops",
    "direct_solref",
    "key_geom",
    "key_inertia",
    "key_joint",
    "rest_tendon",
    "touch_sensor",
]


FRICTION_IMPEDANCE = (0.9999, 0.9999, 1e-3, 0.5, 2.0)
"""``solimp`` of dry friction: as stiff as it gets; MuJoCo's default lets light links creep."""
IMPEDANCE = 1e-4
"""Impedance d of every soft constraint here. MuJoCo's constraint force is d / ((1 - d) A) (b v + k
x - a): with the smallest d the term in the acceleration a is as small as a ten thousandth of the
body's mass, and what is left is a plain spring and damper. A is the inverse mass that MuJoCo
assumes for the constraint.
"""

WHITE, BLACK = (0.96, 0.94, 0.90, 1.0), (0.07, 0.07, 0.08, 1.0)


def key_joint(note: int) -> str:
    """Name of the key's hinge."""
    return f"key_{note}"


def key_geom(note: int) -> str:
    """Name of the key's top, the geom that fingertips touch."""
    return f"key_{note}"


def rest_tendon(note: int) -> str:
    """Name of the constraint that is the key's rest stop."""
    return f"key_{note}_rest"


def touch_sensor(note: int) -> str:
    """Name of the sensor of the normal force on the key."""
    return f"key_{note}_force"


def direct_solref(stiffness: ArrayLike, damping: ArrayLike, inverse_mass: ArrayLike) -> Array:
    """MuJoCo's ``solref`` (..., 2) that makes a soft constraint of :data:`IMPEDANCE` a spring (N/m)
    and damper (N s/m).

    For a hinge per rad instead of m.
    """
    scale = np.asarray(inverse_mass, dtype=float) * (1.0 - IMPEDANCE)
    return -np.stack([np.multiply(stiffness, scale), np.multiply(damping, scale)], axis=-1)


def key_inertia(note: int, board: Keyboard) -> float:
    """Moment of inertia about the hinge, kg m^2: a wooden box from the key's front to its hinge."""
    length, height, top = _box(note, board)
    middle = top - height / 2
    return float(_mass(note, board) * (length**2 / 3 + height**2 / 12 + middle**2))


def _box(note: int, board: Keyboard) -> tuple[float, float, float]:
    """Length, height and level of the top above the hinge, m."""
    if not is_black(note):
        return board.white.pivot, board.white.thickness, 0.0
    return (
        board.white.pivot - board.black.front,
        board.white.thickness + board.black.height,
        board.black.height,
    )


def _mass(note: int, board: Keyboard) -> float:
    length, height, _ = _box(note, board)
    return (
        board.density
        * length
        * height
        * (board.black.width if is_black(note) else board.white.width)
    )


def add_key(spec: mujoco.MjSpec, note: int, board: Keyboard) -> None:
    """Add the key with its hinge (positive downwards), touch sensor and the geom ``key_geom``; no
    mechanism yet.
    """
    length, height, top = _box(note, board)
    width = board.black.width if is_black(note) else board.white.width
    hinge = (key_centre(note, board), board.origin[1] + board.white.pivot, board.origin[2])
    body = spec.worldbody.add_body(name=key_geom(note), pos=hinge, gravcomp=1.0)
    body.add_joint(name=key_joint(note), type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1.0, 0.0, 0.0])
    centre, half = [0.0, -length / 2, top - height / 2], [width / 2, length / 2, height / 2]
    body.add_geom(
        name=key_geom(note),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=centre,
        size=half,
        density=board.density,
        contype=0,
        conaffinity=0,
        rgba=BLACK if is_black(note) else WHITE,
    )
    body.add_site(
        name=key_geom(note),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=centre,
        size=[h + 0.01 for h in half],
        group=4,
    )
    spec.add_sensor(
        name=touch_sensor(note),
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=key_geom(note),
    )


def add_stops(spec: mujoco.MjSpec, note: int, board: Keyboard) -> None:
    """Give the key the nominal mechanism: stops here, spring and damper and the stops' numbers when
    the model is set up.
    """
    mechanism = board.mechanism
    joint = spec.joint(key_joint(note))
    joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    joint.range = [
        -1.0,
        mechanism.max_angle,
    ]  # the lower stop is the tendon below, which has a stiffness of its own
    joint.solimp_limit = [IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0]
    joint.solref_limit = [-1.0, -1.0]
    joint.armature = mechanism.added_inertia
    joint.frictionloss = mechanism.friction_torque
    joint.solimp_friction = list(FRICTION_IMPEDANCE)
    joint.solref_friction = [4 * float(spec.option.timestep), 1.0]
    tendon = spec.add_tendon(name=rest_tendon(note))
    tendon.wrap_joint(key_joint(note), 1.0)
    tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    tendon.range = [mechanism.rest_angle, 1.0]
    tendon.solimp_limit = np.array([IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0])
    tendon.solref_limit = [-1.0, -1.0]
