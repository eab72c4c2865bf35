"""Mechanical laws as far as MuJoCo has them natively, for a model that is exported."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco

from pianobot_ros.piano.twin.model.cell_model import TwinModel
from pianobot_ros.piano.twin.model.hand import abduction_joint, flexion_joints
from pianobot_ros.piano.twin.model.keyboard import FRICTION_IMPEDANCE, key_joint
from pianobot_ros.piano.twin.reduced.strike_laws import NULLS
from pianobot_ros.piano.twin.stepping.step_laws import StepLaws

__all__ = ["missing_of", "set_native_laws"]

NATIVE = ("pad_stiffness", "tip_slip", "tip_drop", "tip_reach", "felt_thickness", "key_preload")
ALMOST = {
    "joint_friction": "as Coulomb friction, without the spring before it slips (Dahl)",
    "key_friction": "as Coulomb friction, without the spring before it slips (Dahl)",
}


def missing_of(numbers: Mapping[str, float]) -> list[str]:
    """What MuJoCo has not, or not wholly, of the ``numbers`` (see ``strike_laws.py``), each by name
    and with its value.
    """
    lines = []
    own = ("joint_stiffness", "joint_damping", "key_stiffness", "key_damping", "key_inertia")
    duffing = numbers.get("joint_hardening_power", 2.0) == 2.0
    for name, x in numbers.items():
        native = name in NATIVE or name in own or (name == "joint_hardening" and duffing)
        if x != NULLS[name] and not native:
            why = f" ({ALMOST[name]})" if name in ALMOST else ""
            lines.append(f"{name} = {x:.6g}{why}")
    return lines


def set_native_laws(cell: TwinModel, numbers: Mapping[str, float]) -> None:
    """Put into a freshly built model what MuJoCo has of the ``numbers``."""
    laws = StepLaws(cell, mujoco.MjData(cell.model), numbers)
    laws.set_model()
    n = laws.numbers
    if n["joint_hardening"] and n["joint_hardening_power"] == 2.0:
        _harden(cell, n["joint_hardening"])
    if n["joint_friction"]:
        for finger in cell.options.fingers:
            for joint in (abduction_joint(finger), *flexion_joints(finger, cell.hand)):
                _friction(cell, joint, n["joint_friction"])
    for note in cell.notes:
        if n["key_friction"]:
            own = cell.board.mechanism.friction_torque
            _friction(cell, key_joint(note), own + n["key_friction"])
        _preload(cell, note, n["key_preload"])


def _preload(cell: TwinModel, note: int, more: float) -> None:
    """Preload of the keyboard and ``more`` N m of a key, as what its spring is wound by."""
    m, joint = cell.model, cell.model.joint(key_joint(note))
    own = 0.0
    if cell.options.mechanism == "spring":
        own = cell.board.mechanism.preload_torque * cell.options.factor("key_stiffness")
    if more or own:
        m.qpos_spring[joint.qposadr[0]] = -(more + own) / m.jnt_stiffness[joint.id]


def _friction(cell: TwinModel, joint: str, torque: float) -> None:
    """Coulomb friction in a joint, as stiff as the step allows."""
    m = cell.model
    dof = m.joint(joint).dofadr[0]
    m.dof_frictionloss[dof] = torque
    m.dof_solimp[dof] = FRICTION_IMPEDANCE
    m.dof_solref[dof] = [4 * cell.timestep, 1.0]


def _harden(cell: TwinModel, factor: float) -> None:
    m = cell.model
    for finger in cell.options.fingers:
        for joint in (abduction_joint(finger), *flexion_joints(finger, cell.hand)):
            index = m.joint(joint).id
            m.jnt_stiffnesspoly[index, 1] = factor * m.jnt_stiffness[index]
