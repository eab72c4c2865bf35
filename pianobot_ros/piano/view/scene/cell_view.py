"""The two cells in three dimensions: the real one solid, the simulated one a transparent ghost."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Protocol

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.piano.twin.export.picture import add_appearance
from pianobot_ros.piano.twin.model.cell_model import TwinModel, TwinOptions, build_spec, build_twin
from pianobot_ros.piano.twin.model.keyboard import key_geom
from pianobot_ros.piano.view.scene.meshes import Part, body_parts
from pianobot_ros.piano.view.scene.posture import Posture

__all__ = ["GHOST", "CellView", "Surroundings", "magnified"]

Colour = tuple[int, int, int]

GHOST: Colour = (0, 122, 255)
SILENT: Colour = (150, 153, 158)
LIGHT: Colour = (255, 176, 32)  # a key that sounds
FORCE: Colour = (222, 45, 38)
ESTIMATED: Colour = (235, 140, 130)
GHOST_OPACITY = 0.45
INSIDE = 2e-4  # m by which the ghost is smaller, so that it is hidden where both cells agree
METRES_PER_NEWTON = 0.006
BESIDE = np.array([-0.015, -0.004, 0.0])  # m from the fingertip, where the finger hides nothing
APART = np.array(
    [-0.002, 0.012, 0.0]
)  # m from there to the ghost's, so that neither hides the other
LEAST_ARROW = 0.008  # m, its head
LEAST_FORCE = 0.03  # N that is drawn
TURN, PLACE = 2e-5, 2e-5  # changes (of a quaternion; m) that are worth sending
KEY_MATERIALS = ("ivory", "ebony")
HIDDEN = ("table",)


class Server(Protocol):
    """What of ``viser.ViserServer`` is used here."""

    scene: Any
    initial_camera: Any


@lru_cache(maxsize=1)
def _dressed() -> mujoco.MjModel:
    """The model as it looks: its bodies have the names of the twin's."""
    spec = build_spec(TwinOptions())
    add_appearance(spec)
    return spec.compile()


@lru_cache(maxsize=2)
def _parts(ghost: bool) -> list[Part]:
    found = body_parts(_dressed(), shrink=INSIDE if ghost else 0.0, one_colour=ghost)
    return [part for part in found if part.material not in HIDDEN and not (ghost and not part.body)]


def magnified(real: Posture, sim: Posture, factor: float) -> Posture:
    """``sim`` with its difference from ``real`` made ``factor`` times as large."""
    if factor == 1.0:
        return sim
    place = real.xpos + factor * (sim.xpos - real.xpos)
    a = Rotation.from_quat(real.xquat, scalar_first=True)
    b = Rotation.from_quat(sim.xquat, scalar_first=True)
    turn = a * Rotation.from_rotvec(factor * (a.inv() * b).as_rotvec())
    tip = real.tip + factor * (sim.tip - real.tip)
    return Posture(sim.qpos, place, turn.as_quat(scalar_first=True), tip, sim.force, sim.measured)


@lru_cache(maxsize=1)
def _upright() -> trimesh.Trimesh:
    """An arrow of 1 m from the origin of its frame upwards, to be scaled to its length."""
    shaft = trimesh.creation.cylinder(radius=0.0018, segment=[[0, 0, 0], [0, 0, 0.65]], sections=16)
    head = trimesh.creation.cone(radius=0.0045, height=0.35, sections=16)
    head.apply_translation([0.0, 0.0, 0.65])
    return trimesh.util.concatenate([shaft, head])


def relative(
    posture: Posture, bodies: NDArray[np.int64], parents: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Orientations (n, 4), scalar first, and positions (n, 3) m of ``bodies`` in the frames of
    their ``parents``, all at once: it is done for every picture.
    """
    w, v = posture.xquat[parents, :1], -posture.xquat[parents, 1:]  # the inverse turn
    a, b = posture.xquat[bodies, :1], posture.xquat[bodies, 1:]
    scalar = w * a - np.sum(v * b, axis=1, keepdims=True)
    turns = np.hstack([scalar, w * b + a * v + np.cross(v, b)])
    across = posture.xpos[bodies] - posture.xpos[parents]
    twist = 2.0 * np.cross(v, across)
    return turns, across + w * twist + np.cross(v, twist)


class CellView:
    """One cell in the scene. Nodes form the model's own tree, so that a joint that turns is one
    message."""

    def __init__(self, server: Server, name: str, *, ghost: bool) -> None:
        self.name, self.ghost = name, ghost
        self._scene, model = server.scene, _dressed()
        self._root = self._scene.add_frame(f"/{name}", show_axes=False)
        self._meshes: list[tuple[Any, Part]] = []
        self._keys: dict[int, list[tuple[Any, Part]]] = {}
        self._lit: frozenset[int] = frozenset()
        self._silent = False
        self._paths = {0: f"/{name}"}
        self._frames: list[Any] = []
        parents = []
        wrist = model.body("wrist").id
        for body in range(1, model.nbody):
            parent = int(model.body_parentid[body]) if body != wrist else 0
            path = f"{self._paths[parent]}/{model.body(body).name}"
            self._paths[body] = path
            self._frames.append(self._scene.add_frame(path, show_axes=False))
            parents.append(parent)
        self._bodies, self._parents = np.arange(1, model.nbody), np.array(parents)
        self._turns = np.zeros((len(parents), 4))  # no turn at all: every one is sent at first
        self._places = np.full((len(parents), 3), np.inf)
        notes = {model.body(key_geom(n)).id: n for n in keyboard().notes}
        for number, part in enumerate(_parts(ghost)):
            handle = self._add(part, number)
            self._meshes.append((handle, part))
            if part.body in notes and (ghost or part.material in KEY_MATERIALS):
                self._keys.setdefault(notes[part.body], []).append((handle, part))
        self._arrow = self._add_arrow()
        self._arrow_colour = GHOST if ghost else FORCE

    def _add(self, part: Part, number: int) -> Any:
        return self._scene.add_mesh_simple(
            f"{self._paths[part.body]}/part{number}",
            part.vertices,
            part.faces,
            color=self._own(part),
            opacity=GHOST_OPACITY if self.ghost else None,
            flat_shading=False,
            cast_shadow=not self.ghost,
            receive_shadow=not self.ghost,
        )

    def _own(self, part: Part) -> Colour:
        return GHOST if self.ghost else part.colour

    def _add_arrow(self) -> Any:
        # A mesh: viser's own arrows are not seen again once they were moved into the view.
        arrow = _upright()
        return self._scene.add_mesh_simple(
            f"/{self.name}/force",
            np.asarray(arrow.vertices, dtype=np.float32),
            np.asarray(arrow.faces, dtype=np.uint32),
            color=GHOST if self.ghost else FORCE,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def show(self, posture: Posture) -> None:
        """Bring the cell into a posture; only what has moved is sent."""
        turns, places = relative(posture, self._bodies, self._parents)
        turned = 1.0 - np.abs(np.sum(turns * self._turns, axis=1)) > 0.5 * TURN**2
        moved = np.abs(places - self._places).max(axis=1) > PLACE
        for i in np.flatnonzero(turned).tolist():
            self._frames[i].wxyz = self._turns[i] = turns[i]
        for i in np.flatnonzero(moved).tolist():
            self._frames[i].position = self._places[i] = places[i]
        self._show_force(posture)

    def _show_force(self, posture: Posture) -> None:
        seen = posture.force > LEAST_FORCE and not self._silent
        if seen != self._arrow.visible:
            self._arrow.visible = seen
        if not seen:
            return
        self._arrow.position = posture.tip + BESIDE + (APART if self.ghost else 0.0)
        self._arrow.scale = (1.0, 1.0, LEAST_ARROW + METRES_PER_NEWTON * posture.force)
        colour = GHOST if self.ghost else (FORCE if posture.measured else ESTIMATED)
        if colour != self._arrow_colour:
            self._arrow.color = self._arrow_colour = colour

    def light(self, notes: frozenset[int]) -> None:
        """Keys that sound."""
        for note in notes ^ self._lit:
            for handle, part in self._keys.get(note, ()):
                handle.color = self._colour(part, note in notes)
        self._lit = notes

    def silence(self, silent: bool) -> None:
        """Grey while nothing is heard of the cell."""
        if silent == self._silent:
            return
        self._silent = silent
        for handle, part in self._meshes:
            if part.body:
                handle.color = self._colour(part, False)
        self._lit = frozenset()

    def _colour(self, part: Part, lit: bool) -> Colour:
        if self._silent:
            return SILENT
        if lit:
            return (120, 80, 255) if self.ghost else LIGHT
        return self._own(part)


def build_solver_model() -> TwinModel:
    """A twin of one's own for :class:`PostureSolver`: its bodies are numbered as those drawn."""
    return build_twin()


class Surroundings:
    """Lights, floor and camera around the keyboard."""

    def __init__(self, server: Server) -> None:
        model, scene = _dressed(), server.scene
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        scene.configure_default_lights(enabled=False)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        centre = data.xpos[model.body(key_geom(keyboard().notes[5])).id] - [0.0, 0.17, 0.0]
        scene.add_light_ambient("/light/ambient", color=(255, 255, 255), intensity=0.55)
        scene.add_light_hemisphere(
            "/light/sky", sky_color=(255, 255, 255), ground_color=(190, 180, 170), intensity=0.5
        )
        scene.add_light_directional(
            "/light/lamp",
            color=(255, 250, 240),
            intensity=1.7,
            cast_shadow=True,
            position=tuple(centre + np.array([-0.5, -0.4, 0.9])),
        )
        scene.add_grid(
            "/floor",
            width=2.4,
            height=2.4,
            position=(centre[0], centre[1], centre[2] - 0.08),
            cell_size=0.05,
            section_size=0.25,
            cell_color=(225, 227, 230),
            section_color=(205, 208, 213),
            shadow_opacity=0.2,
        )
        camera = server.initial_camera
        camera.position = tuple(centre + np.array([-0.42, -0.16, 0.29]))
        camera.look_at = tuple(centre + np.array([0.0, 0.0, 0.02]))
        camera.fov = 0.62
        camera.near = 0.01
