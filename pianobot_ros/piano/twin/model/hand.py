"""The soft hand in MuJoCo: a palm, a thumb of three and two fingers of four phalanges
("Data-driven Simulation Framework", II-A).

Every hinge is the spring and damper of Eq. 1 about the rest pose; the moment of inertia comes from
the capsules. The MCP joint has two degrees of freedom, abduction about the palm's normal and
flexion; the others flex only.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Finger, Hand, finger_points

__all__ = ["FINGER_COLOUR", "abduction_joint", "add_hand", "flexion_joints", "tip_geom"]


FINGER_COLOUR = (0.90, 0.88, 0.83, 1.0)


def abduction_joint(finger: str) -> str:
    """Name of the finger's abduction joint."""
    return f"{finger}_mcp_abduction"


def flexion_joints(finger: str, model: Hand) -> tuple[str, ...]:
    """Names of the finger's flexion joints, from the palm outwards."""
    count = len(model.fingers[finger].lengths)
    return (f"{finger}_mcp", *(f"{finger}_ip{i}" for i in range(1, count)))


def tip_geom(finger: str) -> str:
    """Name of the geom that touches keys: the ball at the end of the last phalanx."""
    return f"{finger}_tip"


def add_hand(
    wrist: mujoco.MjsBody,
    model: Hand,
    fingers: tuple[str, ...],
    stiffness: float,
    damping_factor: float,
) -> None:
    """Put palm and ``fingers`` on the body ``wrist``, whose frame is the wrist frame, with joint
    ``stiffness`` N m/rad.
    """
    palm = wrist.add_body(name="palm")
    palm.add_geom(
        name="palm",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=np.array(model.palm.size) / 2,
        pos=model.palm.centre,
        density=model.density,
        contype=0,
        conaffinity=0,
        rgba=FINGER_COLOUR,
    )
    for name in fingers:
        _add_finger(palm, name, model, stiffness, model.joints.damping * damping_factor)


def _add_finger(
    palm: mujoco.MjsBody, name: str, model: Hand, stiffness: float, damping: float
) -> None:
    finger = model.fingers[name]
    points = finger_points(finger)
    directions = np.diff(points, axis=0) / np.array(finger.lengths)[:, None]
    names = flexion_joints(name, model)
    body = palm
    for i, joint in enumerate(names):
        body = body.add_body(
            name=f"{name}_{i + 1}",
            pos=points[0]
            if i == 0
            else points[i] - points[i - 1],  # all frames keep the wrist frame's directions
        )
        if i == 0:
            _hinge(
                body,
                abduction_joint(name),
                [0.0, 0.0, 1.0],
                stiffness * model.joints.abduction_ratio,
                damping,
            )
        _hinge(body, joint, flexion_axis(finger), stiffness, damping)
        end = points[i + 1] - points[i]
        body.add_geom(
            name=f"{name}_bone{i + 1}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0.0, 0.0, 0.0, *end],
            size=[finger.radius, 0.0, 0.0],
            density=model.density,
            contype=0,
            conaffinity=0,
            rgba=FINGER_COLOUR,
        )
    body.add_geom(
        name=f"{name}_pad",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[1e-3, 0.0, 0.0],
        mass=model.pad.mass,
        pos=points[-1] - points[-2],
        contype=0,
        conaffinity=0,
        rgba=FINGER_COLOUR,
        group=4,
    )
    # Turned with the phalanx, so that what is drawn of it later points along the bone; a ball does
    # not mind.
    turn, _ = Rotation.align_vectors(directions[-1][None], [[0.0, 0.0, 1.0]])
    body.add_geom(
        name=tip_geom(name),
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[finger.radius, 0.0, 0.0],
        mass=0.0,
        pos=points[-1] - points[-2],
        quat=turn.as_quat(scalar_first=True),
        contype=0,
        conaffinity=0,
        rgba=(0.93, 0.75, 0.62, 1.0),
    )


def flexion_axis(finger: Finger) -> Array:
    """Unit axis in the wrist frame about which a positive turn bends the finger towards the
    keys.
    """
    return np.array([-np.cos(finger.yaw), -np.sin(finger.yaw), 0.0])


def _hinge(
    body: mujoco.MjsBody, name: str, axis: Array | list[float], stiffness: float, damping: float
) -> None:
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    joint.stiffness[0] = stiffness
    joint.damping[0] = damping
