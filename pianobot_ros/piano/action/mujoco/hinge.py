"""The action as the mechanism of a hinged key: what a finger at a distance r from the pivot feels.

With x = r * angle, a mass m at the contact point is an inertia m r^2 about the pivot, a damping b
is b r^2 and a stiffness k is k r^2. The finger takes the armature's place, so only the key, the
rails and the hammer are mapped. Zero angle and zero hammer position are the state of rest, in which
the hammer's weight already presses key and felt together. Let-off, repetition lever, backcheck and
string are added on demand and need a switchboard (``mujoco_parts``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.piano.action.hybrid.action_model import PAPER, ActionModel, build_model
from pianobot_ros.piano.action.mujoco.mujoco_hybrid import add_coupler, add_hammer, set_rail
from pianobot_ros.piano.action.mujoco.mujoco_parts import Attachment, add_parts, has_memory
from pianobot_ros.piano.action.parameters import ActionParameters, Armature, load_parameters

__all__ = [
    "HingeMechanism",
    "add_action_mechanism",
    "attachment",
    "balance",
    "find_hinge",
    "hinge_mechanism",
    "hinged_action",
]


@dataclass(frozen=True)
class HingeMechanism:
    """The action about a key's pivot, for contact at ``radius`` [m].

    ``inertia`` [kg*m^2] and ``damping`` [N*m*s/rad] of the key; ``rest_torque`` [N*m] with which
    the weights return it; ``dip`` [rad] from rest to the front rail; rails in N*m/rad and
    N*m*s/rad, the back rail ``lost`` [rad] above rest because they sink the key into its felt.
    """

    radius: float
    inertia: float
    damping: float
    rest_torque: float
    dip: float
    rail_stiffness: float
    rail_damping: float
    lost: float


def hinge_mechanism(
    parameters: ActionParameters, radius: float, parts: frozenset[str] | set[str] = PAPER
) -> HingeMechanism:
    """The action of ``parameters`` about a pivot ``radius`` [m] from the contact point.

    Raises :class:`ConfigError` for a radius that is not positive, and for a back rail that differs
    from the front rail: MuJoCo gives both limits of a joint one felt.
    """
    p = parameters
    if not radius > 0:
        raise ConfigError(
            f"the distance from pivot to contact point must be positive, not {radius} m"
        )
    if (p.back_rail.stiffness, p.back_rail.damping) != (
        p.front_rail.stiffness,
        p.front_rail.damping,
    ):
        raise ConfigError(
            "back_rail and front_rail must have one stiffness and damping to be mapped to a hinge"
        )
    square = radius**2
    return HingeMechanism(
        radius=radius,
        inertia=(p.key.mass + p.key.whippen_mass) * square,
        damping=p.key.damping * square,
        rest_torque=(p.hammer.weight + _returning(p, parts)) * radius,
        dip=p.key.dip / radius,
        rail_stiffness=p.front_rail.stiffness * square,
        rail_damping=p.front_rail.damping * square,
        lost=_sunk(p, parts) / radius,
    )


def hinged_action(parameters: ActionParameters, parts: frozenset[str] | set[str]) -> ActionModel:
    """The exact model that a hinged key with extra ``parts`` follows; its back rail is always
    there.

    The exact model counts from the untouched felt and the hinge from the state of rest, so the dip
    is less by what the hammer's weight sinks the key. Raises :class:`ConfigError` for unknown
    parts.
    """
    p = parameters
    dip = p.key.dip - _sunk(p, parts)
    return build_model(p.vary("key", dip=dip), frozenset(parts) | {"back_rail"}, rail_pulls=False)


def _returning(p: ActionParameters, parts: frozenset[str] | set[str]) -> float:
    """What of key and whippen returns the key [N]: needed where the jack leaves the hammer, which
    did it until then.
    """
    return p.key.return_weight if "let_off" in parts else 0.0


def _sunk(p: ActionParameters, parts: frozenset[str] | set[str]) -> float:
    """How far the weights sink the key into its back rail at rest [m]."""
    return (p.hammer.weight + _returning(p, parts)) / p.back_rail.stiffness


def attachment(
    parameters: ActionParameters,
    key_joint: str,
    radius: float,
    sign: float = 1.0,
    parts: frozenset[str] | set[str] = PAPER,
) -> Attachment:
    """Where :func:`add_action_mechanism` puts the action of ``key_joint``."""
    sunk = _sunk(parameters, parts)
    felt = parameters.hammer.weight / parameters.hammer.coupler_stiffness
    return Attachment(
        key_joint, key_joint, f"{key_joint}_hammer", sign * radius, (-sunk, -sunk - felt)
    )


def add_action_mechanism(
    spec: mujoco.MjSpec,
    key_body: str,
    key_joint: str,
    *,
    radius: float,
    parameters: ActionParameters | None = None,
    sign: float = 1.0,
    carries: Armature | None = None,
    parts: frozenset[str] | set[str] = PAPER,
) -> HingeMechanism:
    """Give the hinged key ``key_body`` of ``spec`` the piano action: hammer, coupler and felt
    rails.

    ``key_joint`` is its hinge, whose angle is 0 at rest and has the ``sign`` of ``sign`` when
    pressed; ``radius`` [m] is the distance from hinge to the point of contact. What the joint had
    as spring, damping, limits and armature is replaced, and so is the inertia of the body's
    geometry, because the paper's effective mass already holds it; its weight is balanced out, as
    the balance rail does. Mass and damping of an armature that the key ``carries`` at the point of
    contact come on top.

    Adds a body and slider ``<key_joint>_hammer`` (m at the key, up) and a tendon and actuator
    ``<key_joint>_coupler``, which takes no command: one more entry of ``ctrl``, to be left at 0.
    With ``parts`` come more such entries, which a
    :class:`~pianobot_ros.piano.action.mujoco.mujoco_parts.Switchboard` sets. Gravity must
    point along -z. Raises :class:`ConfigError` if body or joint do not exist or are not a hinge.
    """
    p = parameters if parameters is not None else load_parameters()
    body, joint = find_hinge(spec, key_body, key_joint)
    if sign not in (1.0, -1.0):
        raise ConfigError(f"sign must be 1 or -1, not {sign}")
    hinge = hinge_mechanism(p, radius, parts)
    name, square = key_joint, radius**2
    added = (carries.mass * square, carries.damping * square) if carries else (0.0, 0.0)
    inertia = hinge.inertia + added[0]

    balance(body, joint, hinge, radius)
    joint.armature = added[0]
    joint.damping[0] = hinge.damping + added[1]
    _limit(spec, joint, hinge, sign, inertia)
    add_hammer(spec, f"{name}_hammer", p, pos=tuple(body.pos))
    h = p.hammer
    add_coupler(
        spec,
        f"{name}_coupler",
        key_joint,
        f"{name}_hammer",
        stiffness=h.coupler_stiffness,
        damping=h.coupler_damping,
        arm=sign * radius,
        rest=h.weight,
    )
    action = hinged_action(p, parts)
    if has_memory(action):
        place = attachment(p, key_joint, radius, sign, parts)
        add_parts(spec, action, replace(place, name=name, hammer_joint=f"{name}_hammer"))
    if _returning(p, parts):
        _add_return(spec, f"{name}_return", key_joint, -sign * p.key.return_weight * radius)
    return hinge


def balance(
    body: mujoco.MjsBody, joint: mujoco.MjsJoint, hinge: HingeMechanism, radius: float
) -> None:
    """Give the key's body the mechanism's inertia, balanced on its hinge, without a spring."""
    body.explicitinertial = True
    body.mass = hinge.inertia / radius**2
    # centre of mass on the axis: balanced, and all inertia is in the number below
    body.ipos = joint.pos
    body.inertia = (hinge.inertia,) * 3
    body.gravcomp = 1.0
    joint.stiffness[0] = 0.0
    joint.frictionloss = 0.0


def _limit(
    spec: mujoco.MjSpec, joint: mujoco.MjsJoint, hinge: HingeMechanism, sign: float, inertia: float
) -> None:
    """Let the key's joint meet the felt rails at rest and at the bottom."""
    # limits follow the compiler's unit, stiffness does not
    unit = np.rad2deg(1.0) if spec.compiler.degree else 1.0
    low, high = sorted((sign * hinge.lost * unit, sign * hinge.dip * unit))
    set_rail(
        joint,
        low,
        high,
        stiffness=hinge.rail_stiffness,
        damping=hinge.rail_damping,
        inertia=inertia,
    )


def _add_return(spec: mujoco.MjSpec, name: str, joint: str, torque: float) -> None:
    """Add an actuator that always pulls on ``joint`` with ``torque``, N m."""
    weight = spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    weight.gainprm[0] = 0.0
    weight.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    weight.biasprm[0] = torque


def find_hinge(
    spec: mujoco.MjSpec, key_body: str, key_joint: str
) -> tuple[mujoco.MjsBody, mujoco.MjsJoint]:
    """The key's body and hinge. Raises :class:`ConfigError` if they do not exist or are not a
    hinge.
    """
    body, joint = spec.body(key_body), spec.joint(key_joint)
    if body is None:
        raise ConfigError(unknown_name("body", key_body, [b.name for b in spec.bodies]))
    if joint is None:
        raise ConfigError(unknown_name("joint", key_joint, [j.name for j in spec.joints]))
    if joint.type != mujoco.mjtJoint.mjJNT_HINGE:
        raise ConfigError(f"joint '{key_joint}' must be a hinge to carry a key")
    return body, joint
