"""The twin as MJCF that stock MuJoCo loads and that behaves the same."""

from __future__ import annotations

from pathlib import Path

import mujoco
from numpy.typing import ArrayLike

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.geometry import FINGERS
from pianobot_ros.twin.hand import abduction_joint, flexion_joints
from pianobot_ros.twin.keyboard import key_joint, rest_tendon
from pianobot_ros.twin.model import TwinModel, TwinOptions, build_spec, build_twin
from pianobot_ros.twin.picture import add_appearance

__all__ = ["export_model", "twin_mjcf"]


def twin_mjcf(options: TwinOptions | None = None, pressure: ArrayLike = (0.0, 0.0, 0.0)) -> str:
    """The twin as MJCF text, at the given vacuum (3,) Pa of thumb, index and middle.

    What the twin sets in the compiled model (stiffnesses, stops, contacts) is written into the specification.
    """
    options = options or TwinOptions()
    twin = build_twin(options)
    twin.set_pressure(pressure)
    spec = build_spec(options)
    _copy_numbers(spec, twin)
    add_appearance(spec)
    spec.compile()
    text: str = spec.to_xml()
    return text


def export_model(path: str | Path, options: TwinOptions | None = None, pressure: ArrayLike = (0.0, 0.0, 0.0)) -> Path:
    """Write the twin as MJCF to ``path``. Raises PianobotError if it cannot be written."""
    path = Path(path)
    try:
        path.write_text(twin_mjcf(options, pressure), encoding="utf-8")
    except OSError as error:
        raise PianobotError(f"cannot write {path}: {error.strerror}") from error
    return path


def _copy_numbers(spec: mujoco.MjSpec, twin: TwinModel) -> None:
    m = twin.model
    for finger in (f for f in FINGERS if f in twin.options.fingers):
        for name in (abduction_joint(finger), *flexion_joints(finger, twin.hand)):
            joint, index = spec.joint(name), m.joint(name).id
            joint.stiffness[0] = m.jnt_stiffness[index]
            joint.damping[0] = m.dof_damping[m.jnt_dofadr[index]]
    if twin.options.mechanism == "spring":
        for note in twin.notes:
            joint, index = spec.joint(key_joint(note)), m.joint(key_joint(note)).id
            joint.stiffness[0] = m.jnt_stiffness[index]
            joint.damping[0] = m.dof_damping[m.jnt_dofadr[index]]
            joint.solref_limit = m.jnt_solref[index]
            spec.tendon(rest_tendon(note)).solref_limit = m.tendon_solref_lim[m.tendon(rest_tendon(note)).id]
            body = m.jnt_bodyid[index]
            own = spec.body(m.body(body).name)
            own.explicitinertial = True
            own.mass, own.inertia = m.body_mass[body], m.body_inertia[body]
            own.ipos, own.iquat = m.body_ipos[body], m.body_iquat[body]
    for pair in spec.pairs:  # the compiler sorts them
        i = m.pair(pair.name).id
        pair.solref = m.pair_solref[i]
        pair.friction = m.pair_friction[i]
