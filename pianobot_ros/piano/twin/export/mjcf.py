"""The twin as MJCF that stock MuJoCo loads and that behaves the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
from numpy.typing import ArrayLike

from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.piano.twin.export.native_laws import missing_of, set_native_laws
from pianobot_ros.piano.twin.export.picture import add_appearance
from pianobot_ros.piano.twin.model.cell_model import TwinModel, TwinOptions, build_spec, build_twin
from pianobot_ros.piano.twin.model.hand import abduction_joint, flexion_joints, tip_geom
from pianobot_ros.piano.twin.model.keyboard import key_joint, rest_tendon

__all__ = ["export_model", "twin_mjcf"]


def twin_mjcf(
    options: TwinOptions | None = None,
    pressure: ArrayLike = (0.0, 0.0, 0.0),
    numbers: Mapping[str, float] | None = None,
    left: Sequence[str] = (),
) -> str:
    """The twin as MJCF text, at the given vacuum (3,) Pa of thumb, index and middle.

    What the twin sets in the compiled model (stiffnesses, stops, contacts) is written into the
    specification, and of the mechanical laws' ``numbers`` what MuJoCo has; a comment at the head
    lists the rest, after ``left``, which others have left out.
    """
    options, left = options or TwinOptions(), list(left)
    if options.mechanism == "felt":
        options = replace(options, mechanism="action")
        left.append("felt of the keys' actions (as springs and dampers)")
    twin = build_twin(options)
    twin.set_pressure(pressure)
    missing = [*left, *missing_of(numbers or {})]
    if twin.board.mechanism.felted and options.mechanism == "spring":
        missing.append(
            "felt of the keys' stops (as springs and dampers that are as stiff at"
            f" {twin.board.mechanism.felt_force:g} N)"
        )
    set_native_laws(twin, numbers or {})
    spec = build_spec(options)
    _copy_numbers(spec, twin)
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # older MuJoCo has it not
    _copy_dampers(spec, twin.model)
    add_appearance(spec)
    spec.compile()
    text: str = spec.to_xml()
    if not missing:
        return text
    lines = [line.replace("--", "- -") for line in missing]
    return "\n  ".join(["<!-- not in this model:", *lines]) + "\n-->\n" + text


def export_model(
    path: str | Path,
    options: TwinOptions | None = None,
    pressure: ArrayLike = (0.0, 0.0, 0.0),
    numbers: Mapping[str, float] | None = None,
    left: Sequence[str] = (),
) -> Path:
    """Write :func:`twin_mjcf` to ``path``. Raises PianobotError if it cannot be written."""
    return write_whole(path, twin_mjcf(options, pressure, numbers, left), folders=False)


def _copy_friction(joint: mujoco.MjsJoint, m: mujoco.MjModel, index: int) -> None:
    dof = m.jnt_dofadr[index]
    if m.dof_frictionloss[dof]:
        joint.frictionloss = m.dof_frictionloss[dof]
        joint.solref_friction, joint.solimp_friction = m.dof_solref[dof], m.dof_solimp[dof]


def _copy_numbers(spec: mujoco.MjSpec, twin: TwinModel) -> None:
    m = twin.model
    for finger in (f for f in FINGERS if f in twin.options.fingers):
        for name in (abduction_joint(finger), *flexion_joints(finger, twin.hand)):
            joint, index = spec.joint(name), m.joint(name).id
            joint.stiffness[0] = m.jnt_stiffness[index]
            joint.damping[0] = m.dof_damping[m.jnt_dofadr[index]]
            joint.stiffness[1:] = m.jnt_stiffnesspoly[index]
            _copy_friction(joint, m, index)
        tip = spec.geom(tip_geom(finger))
        tip.pos = m.geom_pos[m.geom(tip_geom(finger)).id]
    if twin.options.mechanism == "spring":
        for note in twin.notes:
            joint, index = spec.joint(key_joint(note)), m.joint(key_joint(note)).id
            joint.stiffness[0] = m.jnt_stiffness[index]
            joint.damping[0] = m.dof_damping[m.jnt_dofadr[index]]
            joint.solref_limit = m.jnt_solref[index]
            joint.range = m.jnt_range[index]
            joint.springref = m.qpos_spring[m.jnt_qposadr[index]]
            _copy_friction(joint, m, index)
            spec.tendon(rest_tendon(note)).solref_limit = m.tendon_solref_lim[
                m.tendon(rest_tendon(note)).id
            ]
            body = m.jnt_bodyid[index]
            own = spec.body(m.body(body).name)
            own.explicitinertial = True
            own.mass, own.inertia = m.body_mass[body], m.body_inertia[body]
            own.ipos, own.iquat = m.body_ipos[body], m.body_iquat[body]
    for pair in spec.pairs:  # the compiler sorts them
        i = m.pair(pair.name).id
        pair.solref = m.pair_solref[i]
        pair.friction = m.pair_friction[i]


def _copy_dampers(spec: mujoco.MjSpec, twin: mujoco.MjModel) -> None:
    """The armature that makes dampers implicit. With it the compiler assumes other inverse masses,
    on which the springs and dampers of contacts and stops count: they follow.
    """
    joints = [j for j in spec.joints if j.type != mujoco.mjtJoint.mjJNT_FREE]
    for joint in joints:
        joint.armature = twin.dof_armature[twin.joint(joint.name).dofadr[0]]
    compiled = spec.compile()
    for joint in joints:
        dof = twin.joint(joint.name).dofadr[0]
        if joint.solref_limit[0] < 0.0:
            joint.solref_limit *= compiled.dof_invweight0[dof] / twin.dof_invweight0[dof]
    for tendon in spec.tendons:
        i = twin.tendon(tendon.name).id
        if tendon.solref_limit[0] < 0.0:
            tendon.solref_limit *= compiled.tendon_invweight0[i] / twin.tendon_invweight0[i]
    for pair in spec.pairs:
        i = twin.pair(pair.name).id
        bodies = twin.geom_bodyid[[twin.pair_geom1[i], twin.pair_geom2[i]]]
        pair.solref *= (
            compiled.body_invweight0[bodies, 0].sum() / twin.body_invweight0[bodies, 0].sum()
        )
