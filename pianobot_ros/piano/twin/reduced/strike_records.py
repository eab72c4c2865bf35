"""Records that the compiled reduced strike is given, and those that its stages hand on.

They are named tuples, which numba passes as plain structs. Numbers are floats (but those of a
step), so that each record has one type; arrays are contiguous.
"""

from __future__ import annotations

from typing import NamedTuple

from pianobot_ros.cell.arrays import Array

__all__ = [
    "Drive",
    "FingerModel",
    "Grip",
    "KeyModel",
    "Scaled",
    "StrikeState",
    "System",
    "TimeStep",
    "Tip",
    "TipContact",
]


class Drive(NamedTuple):
    """What moves the strike, on a grid of ``dt`` s: position, velocity and acceleration (n, 3) of
    the finger's base; ``frame`` (3, 3), the finger's directions (across, heading, up) as columns;
    ``stiffness`` (n,) N m/rad; angle rad and rate rad/s of a key that is given, (n,) each. A free
    key starts at ``key_angle[0]`` where friction holds it.
    """

    dt: float
    position: Array
    velocity: Array
    acceleration: Array
    frame: Array
    stiffness: Array
    key_angle: Array
    key_rate: Array


class FingerModel(NamedTuple):
    """A finger as a chain of hinges: abduction about the palm's normal at the MCP joint, then one
    flexion for each phalanx.

    ``base`` (3,) m in the wrist frame; ``yaw`` rad; ``pitch`` (n,) absolute pitch of each phalanx
    at rest, rad, a tuple, whose length compiled code knows; ``length`` (n,) m; ``moment`` (n,)
    kg m: mass that each phalanx carries times lever, so that sum(moment_j u_j) is the first moment
    of mass; ``mass`` (n+1, n+1) generalised mass at rest, kg m²; ``radius`` m of the tip; stiffness
    of abduction over that of flexion; damping of the joints N m s/rad; the pad's stiffness N/m,
    damping N s/m and friction.
    """

    base: Array
    yaw: float
    pitch: tuple[float, ...]
    length: Array
    moment: Array
    mass: Array
    radius: float
    abduction_ratio: float
    damping: float
    pad_stiffness: float
    pad_damping: float
    pad_friction: float


class KeyModel(NamedTuple):
    """A key. Its hinge is at (``hinge_y``, ``hinge_z``) m in the base frame, at the height of the
    white keys' tops; ``height`` m of its surface above it; inertia kg m², spring N m/rad, damper
    N m s/rad, largest angle rad. The stop's stiffness and damping and those of the rest, N m/rad
    and N m s/rad, at ``stop_radius`` m; power of the stops' felt (1: they are springs) and the
    force N at which it is as stiff as they (:class:`~pianobot_ros.cell.motion.geometry.Mechanism`).
    ``radius`` m at which a fingertip meets it; dry ``friction`` and
    ``preload`` at angle 0, N m, borne by a rest stop that reaches up to ``rest_angle`` rad.
    """

    hinge_y: float
    hinge_z: float
    inertia: float
    stiffness: float
    damping: float
    max_angle: float
    stop_stiffness: float
    stop_damping: float
    rest_stiffness: float
    rest_damping: float
    stop_radius: float
    height: float
    felt_power: float
    felt_force: float
    radius: float
    friction: float
    preload: float
    rest_angle: float


class Scaled(NamedTuple):
    """Numbers of finger and key with the strike's parameters put in.

    ``along`` and ``across``: where the tip is off the last phalanx, m. ``radius2``: the stop's
    radius squared, which turns N/m into N m/rad.
    """

    joint_damping: float
    pad_stiffness: float
    friction: float
    along: float
    across: float
    inertia: float
    key_stiffness: float
    key_preload: float
    key_damping: float
    top: float
    radius2: float
    felt_stiffness: float
    hammer_inertia: float
    hammer_weight: float


class TimeStep(NamedTuple):
    """A step of ``h`` s: whether it only lets the hand come to rest (``settle``), how many of the
    coordinates are joints, and how many there are; the key's stands behind the joints.
    """

    h: float
    settle: bool
    joints: int
    size: int


class StrikeState(NamedTuple):
    """Angles rad and rates rad/s (abduction, flexions, key, hammer), and what the laws remember:
    friction, jamming and creep of the joints, and ``contact`` (3,), the key's friction and the
    bristles of the tip along and across the key.
    """

    q: Array
    v: Array
    friction: Array
    jam: Array
    creep: Array
    contact: Array


class System(NamedTuple):
    """The linear system of a step (``a`` x = ``rhs``), and what is needed to set it up: the tip's
    Jacobian (joints, 3); gradients of the gap, of the slip along and of that across the key; sine
    and cosine of the phalanges' pitch; angles whose sine and cosine are known (most, 3).
    """

    a: Array
    rhs: Array
    jacobian: Array
    normal: Array
    along: Array
    across: Array
    sine: Array
    cosine: Array
    turns: Array


class Tip(NamedTuple):
    """Where the tip's centre is in the plane of the key (m), the base's velocity (m/s), and the
    axes of flexion and of abduction.
    """

    y: float
    z: float
    base_x: float
    base_y: float
    base_z: float
    flexion_x: float
    flexion_y: float
    flexion_z: float
    abduction_x: float
    abduction_y: float
    abduction_z: float


class TipContact(NamedTuple):
    """Gap of tip and key m and its rate m/s; ``own``, what of the rate is due to joints and key;
    slip along and across the key m/s; the lever arm of the normal force about the hinge m; sine and
    cosine of the key's angle.
    """

    gap: float
    rate: float
    own: float
    slip_y: float
    slip_x: float
    lever: float
    sine: float
    cosine: float


class Grip(NamedTuple):
    """Friction at the tip: whether it slides, and where to; force N along and across the key; the
    largest force N, and its part of the normal force.
    """

    slides: bool
    y: float
    x: float
    to_y: float
    to_x: float
    limit: float
    share: float
