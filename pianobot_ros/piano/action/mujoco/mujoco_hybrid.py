"""The hybrid action of Fig. 8 in MuJoCo: two sliders, a coupler that can only push, and a felt rail
as a joint limit.

The coupler is an actuator on the fixed tendon x - x_H whose bias is -k_H d - b_H d' and whose force
range stops at zero: that is transitions a, b, e and f of Table 3 to the letter. The rail is a joint
limit with MuJoCo's direct stiffness and damping. It
differs from Table 3 in one point: it cannot pull the key while the key rises through the last of
the felt. What the paper leaves for later (let-off, repetition lever, backcheck, string, back rail)
comes with ``parts``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.piano.action.hybrid.action_model import PAPER, ActionModel, build_model
from pianobot_ros.piano.action.hybrid.elements import HAMMER, HAMMER_VELOCITY, KEY, KEY_VELOCITY
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Trajectory
from pianobot_ros.piano.action.mujoco.mujoco_parts import (
    ActionEvent,
    Attachment,
    Switchboard,
    add_parts,
    has_memory,
)
from pianobot_ros.piano.action.parameters import ActionParameters

__all__ = [
    "COUPLER_LIMIT",
    "MujocoHistory",
    "add_coupler",
    "add_hammer",
    "compare",
    "hybrid_spec",
    "set_rail",
    "simulate_mujoco",
]


COUPLER_LIMIT = (
    1e4  # N, far above any force on a key: the coupler pushes as hard as it must, and never pulls
)
# solimp d of the rail: the smaller, the closer is the soft constraint to a plain spring and damper
_IMPEDANCE = 1e-4
_RIG = Attachment("action", "key", "hammer")
_INTEGRATORS = {
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
}


@dataclass(frozen=True)
class MujocoHistory:
    """Positions [m] and velocities [m/s] at ``time`` [s], each (N,); ``events`` of parts that
    remember.
    """

    time: Array
    key: Array
    key_velocity: Array
    hammer: Array
    hammer_velocity: Array
    events: list[ActionEvent] = field(default_factory=list)


def add_coupler(
    spec: mujoco.MjSpec,
    name: str,
    key_joint: str,
    hammer_joint: str,
    *,
    stiffness: float,
    damping: float,
    arm: float = 1.0,
    rest: float = 0.0,
) -> None:
    """Couple two joints by a spring and damper on d = arm * q_key - q_hammer that can push but not
    pull (N/m, N*s/m, m).

    ``rest`` [N] is its force at d = 0. A negative ``arm`` is for a key whose joint angle falls as
    it is pressed.
    """
    tendon = spec.add_tendon(name=name)
    tendon.wrap_joint(key_joint, arm)
    tendon.wrap_joint(hammer_joint, -1.0)
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    actuator.gainprm[0] = 0.0  # nothing to command: the law is all in the bias
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[:3] = (-rest, -stiffness, -damping)
    actuator.forcelimited = True
    actuator.forcerange = (-COUPLER_LIMIT, 0.0)


def set_rail(
    joint: mujoco.MjsJoint,
    low: float,
    high: float,
    *,
    stiffness: float,
    damping: float,
    inertia: float,
) -> None:
    """Make the limits of ``joint`` felt rails with the given stiffness and damping, in the units of
    the joint.

    ``inertia`` is what the joint moves (kg or kg*m^2); MuJoCo's direct solref is per unit of it.
    """
    joint.limited = True
    joint.range = (low, high)
    share = 1.0 - _IMPEDANCE
    joint.solref_limit = (-stiffness / inertia * share, -damping / inertia * share)
    joint.solimp_limit = (_IMPEDANCE, _IMPEDANCE, 1e-3, 0.5, 2.0)


def hybrid_spec(
    parameters: ActionParameters,
    *,
    step: float = 5e-4,
    integrator: str = "rk4",
    parts: frozenset[str] | set[str] = PAPER,
) -> mujoco.MjSpec:
    """The paper's rig with armature, key and hammer as an :class:`mujoco.MjSpec`; joints ``key``
    and ``hammer``.

    The driving force goes to ``qfrc_applied`` of ``key``. With ``parts`` the model needs a
    :class:`~pianobot_ros.piano.action.mujoco.mujoco_parts.Switchboard`. Raises
    :class:`ConfigError` for an unknown ``integrator`` or part.
    """
    if integrator not in _INTEGRATORS:
        raise ConfigError(unknown_name("integrator", integrator, _INTEGRATORS))
    p, h = parameters, parameters.hammer
    action = _action(p, parts)
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.integrator = _INTEGRATORS[integrator]
    spec.option.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_REFSAFE
    )  # the rail's own time constant, not a multiple of step
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    key = spec.worldbody.add_body(name="key", gravcomp=1.0)  # the rig trims its own weight out
    joint = key.add_joint(name="key", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, -1.0))
    joint.damping[0] = p.moving_damping
    joint.stiffness[0] = p.armature.stiffness
    joint.springref = p.initial_state.flexure_home
    _weigh(key, p.moving_mass)
    low = 0.0 if "back_rail" in parts else -1.0
    set_rail(
        joint,
        low,
        p.key.dip,
        stiffness=p.front_rail.stiffness,
        damping=p.front_rail.damping,
        inertia=p.moving_mass,
    )
    add_hammer(spec, "hammer", parameters)
    add_coupler(
        spec,
        "action_coupler",
        "key",
        "hammer",
        stiffness=h.coupler_stiffness,
        damping=h.coupler_damping,
    )
    if has_memory(action):
        add_parts(spec, action, _RIG)
    return spec


def _action(p: ActionParameters, parts: frozenset[str] | set[str]) -> ActionModel:
    """The exact model that MuJoCo follows. Raises :class:`ConfigError` if it cannot."""
    if "back_rail" in parts and (p.back_rail.stiffness, p.back_rail.damping) != (
        p.front_rail.stiffness,
        p.front_rail.damping,
    ):
        raise ConfigError(
            "back_rail and front_rail must have one stiffness and damping: MuJoCo gives a joint one"
            " felt"
        )
    return build_model(p, parts, rail_pulls=False)


def add_hammer(
    spec: mujoco.MjSpec, name: str, parameters: ActionParameters, pos: tuple[float, ...] = (0, 0, 0)
) -> None:
    """Add the hammer as seen at the key: a mass on a vertical slider ``name`` that weighs what the
    configuration says.

    Needs gravity along -z. Its body, also ``name``, has no geometry and touches nothing.
    """
    h = parameters.hammer
    gravity = -float(spec.option.gravity[2])
    if gravity <= 0:
        raise ConfigError("the hammer needs gravity along -z: set option.gravity before adding it")
    body = spec.worldbody.add_body(name=name, pos=pos, gravcomp=1.0 - h.weight / (h.mass * gravity))
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
    joint.damping[0] = h.bushing_damping
    _weigh(body, h.mass)


def simulate_mujoco(
    parameters: ActionParameters,
    profile: ForceProfile,
    end: float,
    *,
    step: float = 5e-4,
    integrator: str = "rk4",
    parts: frozenset[str] | set[str] = PAPER,
) -> MujocoHistory:
    """Run the MuJoCo model from rest to ``end`` [s]; jumps of ``profile`` should fall on multiples
    of ``step`` [s].

    Raises :class:`ConfigError` if MuJoCo warns, as it does when the step is too long.
    """
    model = hybrid_spec(parameters, step=step, integrator=integrator, parts=parts).compile()
    data = mujoco.MjData(model)
    action = _action(parameters, parts)
    board = Switchboard(model, action, [_RIG]) if has_memory(action) else None
    _, start = action.rest()
    data.qpos[:] = start[[KEY, HAMMER]]
    count = round(end / step)
    drive = np.zeros(count)
    middles = (np.arange(count) + 0.5) * step
    for begin, stop, force, slope in profile.pieces(end):
        inside = (middles >= begin) & (middles < stop)
        drive[inside] = force + slope * (middles[inside] - begin)
    out = np.empty((count + 1, 4))
    for k in range(count + 1):
        out[k] = (data.qpos[0], data.qvel[0], data.qpos[1], data.qvel[1])
        if k < count:
            data.qfrc_applied[0] = drive[k]
            if board:
                board.update(data)
            mujoco.mj_step(model, data)
    if any(w.number for w in data.warning):
        raise ConfigError(
            f"MuJoCo warned at a step of {step} s with {integrator}: use a shorter step"
        )
    events = board.events if board else []
    time = np.arange(count + 1, dtype=float) * step
    return MujocoHistory(time, out[:, 0], out[:, 1], out[:, 2], out[:, 3], events)


def compare(history: MujocoHistory, reference: Trajectory) -> dict[str, float]:
    """RMS difference over RMS of the exact ``reference``, for ``key``, ``hammer`` and their
    velocities (ratios).
    """
    z, _ = reference.states(history.time)
    columns = {
        "key": KEY,
        "hammer": HAMMER,
        "key_velocity": KEY_VELOCITY,
        "hammer_velocity": HAMMER_VELOCITY,
    }
    return {
        name: float(
            np.linalg.norm(getattr(history, name) - z[:, column]) / np.linalg.norm(z[:, column])
        )
        for name, column in columns.items()
    }


def _weigh(body: mujoco.MjsBody, mass: float) -> None:
    """Give a geometry-less body its mass [kg]; the inertia is idle on a slider but must be
    positive.
    """
    body.ipos = (0.0, 0.0, 0.0)  # left undefined, the body would lose its mass when saved as XML
    body.mass = mass
    body.inertia = (1e-6, 1e-6, 1e-6)
    body.explicitinertial = True
