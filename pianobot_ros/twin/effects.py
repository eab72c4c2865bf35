"""Structural effects that MuJoCo has natively, switched on in a model as ``effect.parameter=value``.

The names and parameters are those of the diagnosis. Effects that are signal processing, or need memory that MuJoCo lacks, are
in the diagnosis' own strike model only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.twin.hand import abduction_joint, flexion_joints, tip_geom
from pianobot_ros.twin.keyboard import direct_solref, key_joint
from pianobot_ros.twin.model import TwinModel

__all__ = ["NATIVE_EFFECTS", "apply_effects", "parse_effects"]


def _friction(twin: TwinModel, joint: str, torque: float) -> None:
    """Coulomb friction in a joint, as stiff as the step allows: MuJoCo's default lets light links creep."""
    m = twin.model
    dof = m.joint(joint).dofadr[0]
    m.dof_frictionloss[dof] = torque
    m.dof_solimp[dof] = [0.9999, 0.9999, 1e-3, 0.5, 2.0]
    m.dof_solref[dof] = [4 * twin.timestep, 1.0]


def _joint_friction(twin: TwinModel, torque: float) -> None:
    for finger in twin.options.fingers:
        for joint in (abduction_joint(finger), *flexion_joints(finger, twin.hand)):
            _friction(twin, joint, torque)


def _joint_hardening(twin: TwinModel, factor: float) -> None:
    m = twin.model
    for finger in twin.options.fingers:
        for joint in flexion_joints(finger, twin.hand):
            index = m.joint(joint).id
            m.jnt_stiffnesspoly[index, 1] = factor * m.jnt_stiffness[index]


def _key_friction(twin: TwinModel, torque: float) -> None:
    for note in twin.notes:
        _friction(twin, key_joint(note), torque)


def _key_preload(twin: TwinModel, torque: float) -> None:
    m = twin.model
    for note in twin.notes:
        joint = m.joint(key_joint(note))
        m.qpos_spring[joint.qposadr[0]] = -torque / m.jnt_stiffness[joint.id]


def _pad_compliance(twin: TwinModel, softer: float) -> None:
    m, pad = twin.model, twin.hand.pad
    for i in range(m.npair):
        bodies = m.geom_bodyid[[m.pair_geom1[i], m.pair_geom2[i]]]
        inverse_mass = float(m.body_invweight0[bodies, 0].sum())
        m.pair_solref[i] = direct_solref(pad.stiffness / (1.0 + softer), pad.damping, inverse_mass)


def _tip_slip(twin: TwinModel, lost: float) -> None:
    twin.model.pair_friction[:, :2] = twin.hand.pad.friction * (1.0 - lost)


def _tip_offset(twin: TwinModel, height: float) -> None:
    for finger in twin.options.fingers:
        twin.model.geom_pos[twin.model.geom(tip_geom(finger)).id, 2] -= height


NATIVE_EFFECTS: Mapping[str, tuple[Callable[[TwinModel, float], None], float, float, str]] = {
    "joint_friction.joint_friction": (_joint_friction, 0.0, 0.5, "N*m"),
    "joint_hardening.joint_hardening": (_joint_hardening, -30.0, 2000.0, "1/rad^2"),
    "key_friction.key_friction": (_key_friction, 0.0, 0.3, "N*m"),
    "key_preload.key_preload": (_key_preload, 0.0, 0.5, "N*m"),
    "pad_compliance.pad_compliance": (_pad_compliance, -0.7, 20.0, "1"),
    "tip_slip.tip_slip": (_tip_slip, -1.0, 1.0, "1"),
    "tip_offset.tip_offset": (_tip_offset, -0.01, 0.01, "m"),
}  # fmt: skip
"""Effect and parameter: what switches it on, its bounds and unit."""


def parse_effects(texts: Sequence[str]) -> dict[str, float]:
    """Values by ``effect.parameter`` from texts like ``key_friction.key_friction=0.01``; empty texts are skipped.

    Raises ConfigError for names that the model has not, values that are no numbers or out of bounds.
    """
    found: dict[str, float] = {}
    for text in filter(None, (t.strip() for t in texts)):
        name, _, value = text.partition("=")
        if name not in NATIVE_EFFECTS:
            raise ConfigError(unknown_name("effect of the twin", name, NATIVE_EFFECTS))
        _, low, high, unit = NATIVE_EFFECTS[name]
        try:
            number = float(value)
        except ValueError:
            number = float("nan")
        if not (np.isfinite(number) and low <= number <= high):
            raise ConfigError(
                f"effect '{text}': give a number from {low:g} to {high:g} {unit}, as in {name}={high / 10:g}"
            )
        found[name] = number
    return found


def apply_effects(twin: TwinModel, effects: Mapping[str, float]) -> None:
    """Switch the effects on in a freshly built model. Stiffnesses set later keep their hardening's old reference."""
    for name, value in effects.items():
        NATIVE_EFFECTS[name][0](twin, value)
