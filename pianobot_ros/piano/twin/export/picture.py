"""A picture of hand and keyboard, rendered without a screen."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import Keyboard, is_black, key_centre, keyboard
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.piano.twin.model.arm import arm_inverse, mount
from pianobot_ros.piano.twin.model.cell_model import TwinOptions, build_spec
from pianobot_ros.piano.twin.model.keyboard import key_geom, key_joint

__all__ = ["add_appearance", "render", "write_picture"]

CAMERA = "player"


def add_appearance(spec: mujoco.MjSpec) -> None:
    """Lights, camera, materials, a case around the keys and the cut-outs of the white keys; nothing
    that acts.
    """
    board = keyboard()
    _materials(spec)
    centre = np.array([board.origin[0] + 3.5 * board.white.pitch, board.origin[1], board.origin[2]])
    _case(spec, board, centre)
    for note in board.notes:
        if spec.body(key_geom(note)) is not None:
            _shape_key(spec, note, board)
    for geom in spec.geoms:
        if geom.name.startswith("link_"):
            geom.material = "arm"
        elif "_bone" in geom.name or geom.name == "palm":
            geom.material = "bone"
        elif geom.name.endswith("_tip"):
            geom.material = "silicone"
    _dress_hand(spec)
    # Flat light from above, a lamp from the left for shape, and a weak one from the right against
    # black shadows.
    for name, place, strength, shadow in (
        ("lamp", (-0.75, 0.35, 0.95), 0.62, True),
        ("fill", (0.75, -0.25, 0.55), 0.28, False),
        ("back", (-0.2, -0.8, 0.6), 0.22, False),
    ):
        place_ = centre + np.array(place)
        spec.worldbody.add_light(
            name=name,
            pos=place_,
            dir=centre + np.array([0, 0.05, 0]) - place_,
            type=mujoco.mjtLightType.mjLIGHT_SPOT,
            cutoff=60.0,
            exponent=1.0,
            diffuse=[strength] * 3,
            specular=[0.35 * strength] * 3,
            castshadow=shadow,
            attenuation=[1.0, 0.0, 0.0],
        )
    spec.visual.headlight.ambient = [0.30, 0.30, 0.31]
    spec.visual.headlight.diffuse = [0.14, 0.14, 0.14]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.shadowsize = 8192
    spec.visual.quality.offsamples = 8
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1200
    spec.visual.map.znear = 0.005
    eye = centre + np.array([-0.43, -0.06, 0.27])
    _look(spec, eye, centre + np.array([0.0, -0.018, 0.028]), 36.0)


def _look(
    spec: mujoco.MjSpec, eye: NDArray[np.float64], at: NDArray[np.float64], fovy: float
) -> None:
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    _camera(spec, eye, right, np.cross(back, right), fovy)


def _camera(
    spec: mujoco.MjSpec,
    eye: NDArray[np.float64],
    right: NDArray[np.float64],
    up: NDArray[np.float64],
    fovy: float,
) -> None:
    camera = spec.worldbody.add_camera(name=CAMERA, pos=eye, fovy=fovy)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.column_stack([right, up, np.cross(right, up)]).ravel())
    camera.quat = quat


def _materials(spec: mujoco.MjSpec) -> None:
    wood = spec.add_texture(name="wood", type=mujoco.mjtTexture.mjTEXTURE_2D, width=512, height=512)
    wood.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    wood.rgb1, wood.rgb2 = [0.45, 0.28, 0.16], [0.38, 0.22, 0.12]
    sky = spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384
    )
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    sky.rgb1, sky.rgb2 = [0.93, 0.95, 0.97], [0.70, 0.75, 0.80]
    for name, rgba, specular, shininess, reflectance in (
        ("ivory", (0.97, 0.95, 0.90, 1.0), 0.5, 0.7, 0.0),
        ("ebony", (0.055, 0.055, 0.06, 1.0), 0.8, 0.8, 0.0),
        ("spruce", (0.80, 0.62, 0.40, 1.0), 0.1, 0.2, 0.0),
        ("case", (0.36, 0.22, 0.13, 1.0), 0.4, 0.5, 0.0),
        ("felt", (0.45, 0.07, 0.09, 1.0), 0.0, 0.0, 0.0),
        ("arm", (0.74, 0.77, 0.80, 1.0), 0.6, 0.6, 0.0),
        ("bone", (0.90, 0.87, 0.80, 1.0), 0.35, 0.4, 0.0),
        ("rubber", (0.13, 0.14, 0.16, 1.0), 0.2, 0.3, 0.0),
        ("silicone", (0.93, 0.62, 0.50, 1.0), 0.3, 0.5, 0.0),
        ("table", (0.62, 0.64, 0.66, 1.0), 0.1, 0.2, 0.0),
    ):
        spec.add_material(
            name=name, rgba=rgba, specular=specular, shininess=shininess, reflectance=reflectance
        )


def _box(
    body: mujoco.MjsBody,
    centre: NDArray[np.float64] | list[float],
    half: list[float],
    material: str,
) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=centre,
        size=half,
        material=material,
        contype=0,
        conaffinity=0,
        mass=0.0,
        group=2,
    )


def _case(spec: mujoco.MjSpec, board: Keyboard, centre: NDArray[np.float64]) -> None:
    width, depth = 7 * board.white.pitch, board.white.pivot
    world, x, y, z = spec.worldbody, float(centre[0]), float(centre[1]), float(centre[2])
    low = z - 0.065
    _box(
        world,
        [x, y + depth / 2 - 0.01, low],
        [width / 2 + 0.0305, depth / 2 + 0.032, 0.012],
        "case",
    )
    for side in (-1, 1):
        place = [x + side * (width / 2 + 0.0165), y + depth / 2 + 0.006, z - 0.032]
        _box(world, place, [0.0145, depth / 2 + 0.030, 0.033], "case")
    _box(world, [x, y + 0.206, z + 0.006], [width / 2 + 0.031, 0.053, 0.010], "case")
    _box(world, [x, y + 0.256, z - 0.030], [width / 2 + 0.002, 0.003, 0.030], "case")
    _box(world, [x, y + board.white.length + 0.0005, z - 0.001], [width / 2, 0.0012, 0.014], "felt")
    _box(world, [x, y - 0.013, z - 0.042], [width / 2 + 0.002, 0.008, 0.016], "case")
    _box(world, [x, y + 0.1, low - 0.032], [3.0, 3.0, 0.02], "table")


def _shape_key(spec: mujoco.MjSpec, note: int, board: Keyboard) -> None:
    """Draw the key as it looks: white keys with room for the black ones. The box that acts is
    hidden.
    """
    body = spec.body(key_geom(note))
    for geom in body.geoms:
        if geom.name == key_geom(note):
            geom.group = 4
    white, black = board.white, board.black
    if is_black(note):
        length, height = white.length - black.front, black.height + 0.006
        y = -(white.pivot - black.front) + length / 2
        # A sharp leans back: a block, and a narrower one on top.
        _box(
            body,
            [0.0, y, black.height / 2 - 0.005],
            [black.width / 2, length / 2, height / 2],
            "ebony",
        )
        _box(
            body,
            [0.0, y + 0.002, black.height - 0.0012],
            [black.width / 2 - 0.0012, length / 2 - 0.003, 0.0012],
            "ebony",
        )
        return
    half, gap = white.width / 2, 0.0012
    x = key_centre(note, board)

    def neighbour(step: int) -> float:
        other = note + step
        if other not in board.notes or not is_black(other):
            return half
        return abs(key_centre(other, board) - x) - black.width / 2 - gap

    left, right = neighbour(-1), neighbour(1)
    for top, thick, material, lip in (
        (0.0, 0.0022, "ivory", 0.0),
        (-0.0022, white.thickness - 0.0022, "spruce", 0.0015),
    ):
        front = black.front - gap - lip
        _box(
            body,
            [0.0, -white.pivot + lip + front / 2, top - thick / 2],
            [half - lip / 3, front / 2, thick / 2],
            material,
        )
        rear = white.length + 0.02 - black.front
        place = [(right - left) / 2, -white.pivot + black.front + rear / 2 - gap, top - thick / 2]
        _box(body, place, [(left + right) / 2, rear / 2, thick / 2], material)


def _dress_hand(spec: mujoco.MjSpec) -> None:
    """Joints in rubber, as on the jamming hand, and a plate between palm and flange."""
    for body in spec.bodies:
        radius = next((g.size[0] for g in body.geoms if "_bone" in g.name), None)
        if radius is not None:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[1.18 * radius, 0, 0],
                material="rubber",
                contype=0,
                conaffinity=0,
                mass=0.0,
                group=2,
            )
    # The bracket from flange to palm: a column under the flange and a plate on the palm.
    palm = spec.body("palm").geoms[0]
    back, top = palm.pos[1] - palm.size[1], palm.pos[2] + palm.size[2]
    flange = _flange_in_wrist()
    wrist = spec.body("wrist")
    place = [flange[0], flange[1] + 0.012, (flange[2] + top) / 2]
    _box(wrist, place, [0.020, 0.012, max((flange[2] - top) / 2, 0.004)], "rubber")
    _box(wrist, [flange[0], back + 0.022, top + 0.0025], [0.028, 0.026, 0.0025], "rubber")
    wrist.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[*flange, *(flange - _flange_axis() * -0.008)],
        size=[0.034, 0, 0],
        material="rubber",
        contype=0,
        conaffinity=0,
        mass=0.0,
        group=2,
    )


def _flange_in_wrist() -> NDArray[np.float64]:
    return np.asarray(-_mount_rotation() @ np.array(mount().tcp_offset))


def _flange_axis() -> NDArray[np.float64]:
    return np.asarray(_mount_rotation()[:, 2])


def _mount_rotation() -> NDArray[np.float64]:
    return np.asarray(Rotation.from_rotvec(mount().rotation).as_matrix())


def render(width: int = 1280, height: int = 800) -> NDArray[np.uint8]:
    """The hand with its middle finger in a key, (height, width, 3). Raises PianobotError where
    nothing can be rendered.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")
    spec = build_spec(TwinOptions())
    add_appearance(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    note = 64
    pose = wrist_pose({"middle": note}).raised(-0.0089)
    data.qpos[:6] = arm_inverse([*pose.position, *pose.rotation.as_rotvec()])
    data.qpos[model.joint(key_joint(note)).qposadr[0]] = 0.0089 / 0.195
    mujoco.mj_forward(model, data)
    try:
        with mujoco.Renderer(model, height, width) as renderer:
            renderer.update_scene(data, camera=CAMERA)
            return np.array(renderer.render())
    except Exception as error:
        raise PianobotError(
            f"no picture can be rendered here ({error}): set MUJOCO_GL=egl on a machine with EGL"
        ) from error


def write_picture(path: str | Path) -> Path:
    """Render and write the picture as PNG, twice oversampled."""
    from PIL import Image

    image = Image.fromarray(render(1920, 1200)).resize((1120, 700), Image.Resampling.LANCZOS)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    image.quantize(192, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
    return path
