"""The twin's geoms as triangle meshes, merged by body and colour."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array

__all__ = ["Part", "body_parts"]

Colour = tuple[int, int, int]
SHOWN_GROUPS = 3  # MuJoCo's viewers show groups 0 to 2


@dataclass(frozen=True)
class Part:
    """Triangles of one colour on one body: ``vertices`` (n, 3) m in the body's frame, ``faces``
    (m, 3); ``colour`` 0 to 255, ``material`` the name in the model or empty.
    """

    body: int
    material: str
    colour: Colour
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


def body_parts(
    model: mujoco.MjModel, *, shrink: float = 0.0, one_colour: bool = False
) -> list[Part]:
    """What is drawn of ``model``, in order of body.

    ``shrink`` m makes every geom smaller all around, so that a copy lies hidden inside the
    original; ``one_colour`` merges all materials of a body.
    """
    found: dict[tuple[int, str, Colour], list[trimesh.Trimesh]] = defaultdict(list)
    for geom in range(model.ngeom):
        if model.geom_group[geom] >= SHOWN_GROUPS:
            continue
        mesh = _primitive(model, geom, shrink)
        if mesh is None:
            continue
        material = int(model.geom_matid[geom])
        rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        name = model.mat(material).name if material >= 0 else ""
        colour = (0, 0, 0) if one_colour else _colour(rgba)
        key = (int(model.geom_bodyid[geom]), "" if one_colour else name, colour)
        found[key].append(mesh)
    parts = []
    for (body, name, colour), meshes in sorted(found.items(), key=lambda item: item[0][0]):
        whole = trimesh.util.concatenate(meshes)
        parts.append(
            Part(
                body,
                name,
                colour,
                np.asarray(whole.vertices, dtype=np.float32),
                np.asarray(whole.faces, dtype=np.uint32),
            )
        )
    return parts


def _colour(rgba: Array) -> Colour:
    r, g, b = np.clip(np.round(255 * rgba[:3]), 0, 255).astype(int).tolist()
    return r, g, b


def _primitive(model: mujoco.MjModel, geom: int, shrink: float) -> trimesh.Trimesh | None:
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_BOX:
        mesh = trimesh.creation.box(extents=2 * np.maximum(size - shrink, 1e-4))
    elif kind == types.mjGEOM_SPHERE:
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=size[0] - shrink)
    elif kind == types.mjGEOM_CAPSULE:
        mesh = trimesh.creation.capsule(height=2 * size[1], radius=size[0] - shrink, count=[18, 10])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    elif kind == types.mjGEOM_CYLINDER:
        mesh = trimesh.creation.cylinder(
            radius=size[0] - shrink, height=2 * (size[1] - shrink), sections=28
        )
    else:  # planes, and whatever a model of one's own may have
        return None
    if kind == types.mjGEOM_BOX:  # no vertex is shared, so that edges stay sharp
        mesh = trimesh.Trimesh(*_unshared(mesh), process=False)
    place = np.eye(4)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    place[:3, :3], place[:3, 3] = turn.reshape(3, 3), model.geom_pos[geom]
    mesh.apply_transform(place)
    return mesh


def _unshared(mesh: trimesh.Trimesh) -> tuple[Array, NDArray[np.int64]]:
    corners = np.asarray(mesh.triangles).reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3)
