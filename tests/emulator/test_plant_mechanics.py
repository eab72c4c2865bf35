"""The plant's mechanics against hand calculation, conservation laws and its own finer step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import fingertip, hand, keyboard, strike_point
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.laws.row_layout import (
    ANGLE,
    INERTIA,
    LENGTH,
    MOMENT,
    NORMAL,
    PHI,
    RATE,
    REACTION,
    REST,
    SPEED,
)
from pianobot_ros.emulator.plant.mechanics.physics import GRAVITY
from pianobot_ros.emulator.plant.mechanics.plant_model import PlantModel
from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes

QUIET = Case(repeatability=0.0, noise=0.0)
STIFFNESS = {0.0: 5.73, -50e3: 15.5, -100e3: 28.65}
ZERO = np.zeros(6)
E_KEY = 4  # index of note 64


def settle(model: PlantModel, pose: Array, pressure: float, seconds: float = 0.5) -> None:
    for _ in range(round(seconds * 1000)):
        model.tick(pose, ZERO, pose, ZERO, np.full(3, pressure))


def pose_at(depth: float) -> Array:
    touching = wrist_pose({"middle": 64})
    return np.array([touching.x, touching.y, touching.z - depth, 0.0, 0.0, 0.0])


def changed(model: PlantModel, **numbers: float) -> PlantModel:
    """The plant with other constants of its mechanics."""
    constants = model.model._replace(plant=model.model.plant._replace(**numbers))
    model.simulated = model.simulated._replace(model=constants)
    return model


def without_friction(model: PlantModel) -> PlantModel:
    return changed(model, friction=0.0)


def static_force(depth: float, k: float) -> float:
    """Normal force by minimising the potential energy of finger, pad, key and stop, from the
    configuration alone.
    """
    finger, pad, mechanism = hand().fingers["middle"], hand().pad, keyboard().mechanism
    lengths, rest = np.array(finger.lengths), np.array([finger.pitch, *finger.bends])
    tube = hand().density * np.pi * finger.radius**2 * lengths
    mass = tube + hand().density * 4 / 3 * np.pi * finger.radius**3
    height_of_base = float(pose_at(depth)[2]) + finger.base[2]
    y_of_base = float(pose_at(depth)[1]) + finger.base[1]
    hinge = np.array([keyboard().origin[1] + keyboard().white.pivot, keyboard().origin[2]])
    squared = mechanism.reference_radius**2

    def compression(u: Array) -> float:
        pitch = np.cumsum(rest + u[:4])
        tip = (
            np.array(
                [y_of_base + lengths @ np.cos(pitch), height_of_base - lengths @ np.sin(pitch)]
            )
            - hinge
        )
        return float(finger.radius - (-tip[0] * np.sin(u[4]) + tip[1] * np.cos(u[4])))

    def energy(u: Array) -> float:
        pitch = np.cumsum(rest + u[:4])
        ends = -np.concatenate([[0.0], np.cumsum(lengths * np.sin(pitch))])
        weight = mass @ (ends[:-1] + ends[1:]) / 2 + pad.mass * ends[-1]
        beyond = max(u[4] - mechanism.max_angle, 0.0)
        springs = k * (u[:4] @ u[:4]) + pad.stiffness * max(compression(u), 0.0) ** 2
        springs += mechanism.stiffness * u[4] ** 2 + mechanism.stop_stiffness * squared * beyond**2
        return float(springs / 2 + GRAVITY * weight)

    start = np.array([-0.02, -0.02, -0.02, -0.02, 0.03])
    found = minimize(energy, start, method="BFGS", options={"gtol": 1e-10, "maxiter": 2000})
    return pad.stiffness * compression(found.x)


@pytest.mark.parametrize("pressure", list(STIFFNESS))
@pytest.mark.parametrize("depth", [0.006, 0.015])
def test_static_force_is_that_of_least_energy(pressure: float, depth: float) -> None:
    model = without_friction(PlantModel(QUIET, fingers=[2]))
    settle(model, pose_at(depth), pressure, 1.0)
    assert model.state.keys[E_KEY, NORMAL] == pytest.approx(
        static_force(depth, STIFFNESS[pressure]), rel=1e-3
    )


def test_tip_stiffness_is_that_of_the_joints() -> None:
    """Slope of force over wrist height against the series of joints (J K^-1 J^T), pad and key, at a
    light touch.
    """
    pressure, depth, delta = -50e3, 0.0015, 1e-4
    forces = []
    for d in (depth - delta, depth + delta):
        model = without_friction(PlantModel(QUIET, fingers=[2]))
        settle(model, pose_at(d), pressure, 1.0)
        forces.append(model.state.keys[E_KEY, NORMAL])
    pitch = model.state.fingers[2, PHI : PHI + 4]
    lengths = model.model.hand[2, LENGTH : LENGTH + 4]
    # Vertical motion of the tip for a unit turn of each joint.
    jacobian = -np.array([lengths[i:] @ np.cos(pitch[i:]) for i in range(4)])
    mechanism = keyboard().mechanism
    radius = keyboard().white.pivot - keyboard().strike_point.white
    compliance = jacobian @ jacobian / STIFFNESS[pressure] + 1 / hand().pad.stiffness
    compliance += radius**2 / mechanism.stiffness
    assert np.diff(forces)[0] / (2 * delta) == pytest.approx(1 / compliance, rel=0.01)


def test_unloaded_finger_hangs_by_its_weight() -> None:
    model = PlantModel(QUIET, fingers=[2])
    settle(model, pose_at(-0.05), 0.0)
    rows = model.model.hand[2]
    pitch = np.cumsum(rows[REST : REST + 4])
    torque = rows[MOMENT : MOMENT + 4] * GRAVITY * np.cos(pitch)
    sag = model.state.fingers[2, PHI : PHI + 4] - pitch
    by_hand = np.cumsum([torque[i:].sum() / STIFFNESS[0.0] for i in range(4)])
    assert sag == pytest.approx(by_hand, rel=0.01)


def energy_of(model: PlantModel, k: float) -> float:
    rows, state = model.model.hand[2], model.state.fingers[2]
    phi, rate = state[PHI : PHI + 4], state[RATE : RATE + 4]
    mass = rows[INERTIA : INERTIA + 16].reshape(4, 4) * np.cos(phi[:, None] - phi[None, :])
    bend = np.diff(np.concatenate([[0.0], phi])) - rows[REST : REST + 4]
    return float(
        rate @ mass @ rate / 2
        + k * bend @ bend / 2
        - GRAVITY * rows[MOMENT : MOMENT + 4] @ np.sin(phi)
    )


def test_energy_of_an_undamped_finger_is_kept() -> None:
    model = PlantModel(QUIET, fingers=[2])
    changed(model, joint_damping=0.0)
    pose = pose_at(-0.05)
    settle(model, pose, -50e3, 0.001)
    model.state.fingers[2, PHI : PHI + 4] += [
        0.05,
        0.05,
        0.05,
        0.05,
    ]  # the whole finger turned at the knuckle
    at_rest = energy_of(PlantModel(QUIET), STIFFNESS[-50e3])
    energies = []
    for _ in range(400):
        model.tick(pose, ZERO, pose, ZERO, np.full(3, -50e3))
        energies.append(energy_of(model, STIFFNESS[-50e3]))
    swing = energies[0] - at_rest
    assert swing > 0.01
    assert np.ptp(energies) < 2e-3 * swing


def test_released_key_is_a_damped_oscillator() -> None:
    model = PlantModel(QUIET, fingers=[2])
    model.state.keys[E_KEY, ANGLE] = 0.03
    inertia = model.model.board[E_KEY, 5]
    m = keyboard().mechanism
    angles = []
    for _ in range(20):
        model.tick(pose_at(-0.05), ZERO, pose_at(-0.05), ZERO, np.zeros(3))
        angles.append(model.state.keys[E_KEY, ANGLE])
    times = 1e-3 * np.arange(1, 21)
    exact = solve_ivp(
        lambda _, u: [u[1], -(m.stiffness * u[0] + m.damping * u[1]) / inertia],
        (0, 0.02),
        [0.03, 0.0],
        t_eval=times,
        rtol=1e-9,
    )
    assert np.min(exact.y[0]) > 0.0  # before the rest stop
    assert angles == pytest.approx(exact.y[0], abs=2e-7)


def test_reaction_on_the_wrist_is_the_force_on_the_key() -> None:
    model = PlantModel(QUIET, fingers=[2])
    settle(model, pose_at(0.012), -50e3)
    angle, normal = model.state.keys[E_KEY, ANGLE], model.state.keys[E_KEY, NORMAL]
    x, y, z = model.state.cell[REACTION : REACTION + 3]
    assert y * -np.sin(angle) + z * np.cos(angle) == pytest.approx(normal, rel=1e-6)
    assert np.hypot(x, y * np.cos(angle) + z * np.sin(angle)) <= hand().pad.friction * normal * (
        1 + 1e-9
    )
    # Torque balance of the key at rest.
    m = keyboard().mechanism
    stop = m.stop_stiffness * m.reference_radius**2 * max(angle - m.max_angle, 0.0)
    tip = strike_point(64)[1]
    lever = keyboard().origin[1] + keyboard().white.pivot - tip
    assert normal * lever == pytest.approx(m.stiffness * angle + stop, rel=0.02)
    assert abs(model.state.keys[E_KEY, SPEED]) < 1e-6


def test_half_the_step_gives_the_same_strikes() -> None:
    commands = standard_strikes(
        7, n=5, repeats=1
    )  # no peak is an impact, which may fall between samples
    coarse, fine = (
        simulate_commands(commands, QUIET, step=h, rounded=False) for h in (5e-5, 2.5e-5)
    )
    a, b = (r.signal("real/fsr.force") for r in (coarse, fine))
    peaks = [[f.between(s.start, s.end).value.max() for s in commands.strikes] for f in (a, b)]
    assert peaks[0] == pytest.approx(peaks[1], rel=5e-4)
    assert np.sqrt(np.mean((a.value - b.value) ** 2)) < 2e-3 * np.sqrt(np.mean(b.value**2))
    for one, other in zip(coarse.notes["real"], fine.notes["real"], strict=True):
        assert one.time == pytest.approx(other.time, abs=2e-5)
        assert one.velocity == pytest.approx(other.velocity, rel=2e-3)


def test_stretch_of_thumb_and_middle_sounds_both() -> None:
    pose = wrist_pose({"thumb": 64, "middle": 68})
    rotation = pose.rotation.as_rotvec()
    time = np.arange(0, 0.8, 8e-3)
    down = 0.5 * (1 - np.cos(2 * np.pi * np.clip(time / 0.8, 0, 1)))
    position = np.tile(pose.position, (len(time), 1))
    position[:, 2] += 0.004 - 0.018 * down
    commands = Commands(
        time, position, np.tile(rotation, (len(time), 1)), np.zeros(1), np.full((1, 3), -50e3)
    )
    events = simulate_commands(commands, QUIET).notes["real"]
    assert {e.note for e in events if e.on} == {64, 68}
    assert {e.note for e in events if not e.on} == {64, 68}


def test_thumb_glissando_sounds_the_white_keys_in_order() -> None:
    pose = wrist_pose({"thumb": 60})
    end = wrist_pose({"thumb": 71})
    time = np.arange(0, 2.4, 8e-3)
    across = np.clip((time - 0.4) / 1.6, 0, 1)
    down = 0.5 * (1 - np.cos(np.pi * np.clip(time / 0.3, 0, 1)))
    position = np.outer(1 - across, pose.position) + np.outer(across, end.position)
    position[:, 2] += 0.004 - 0.014 * down
    commands = Commands(
        time,
        position,
        np.tile(pose.rotation.as_rotvec(), (len(time), 1)),
        np.zeros(1),
        np.full((1, 3), -100e3),
    )
    on = [e.note for e in simulate_commands(commands, QUIET).notes["real"] if e.on]
    assert on == [60, 62, 64, 65, 67, 69, 71]


def test_fingertip_touches_where_the_geometry_says() -> None:
    """At the touching pose without gravity's sag the tip's lowest point lies on the key's
    surface.
    """
    touching = wrist_pose({"middle": 64})
    tip = touching.position + fingertip("middle")
    assert tip == pytest.approx(strike_point(64), abs=1e-9)
    model = PlantModel(QUIET, fingers=[2])
    model.tick(pose_at(1e-5), ZERO, pose_at(1e-5), ZERO, np.full(3, -100e3), dt=5e-5)
    assert model.state.keys[E_KEY, NORMAL] == pytest.approx(hand().pad.stiffness * 1e-5, rel=0.05)
