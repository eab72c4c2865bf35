"""Geometry, statics, parameters, convergence and robustness of the MuJoCo twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from examples import fewer
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from scipy.linalg import expm

from pianobot_ros.cell.errors import ConfigError, PianobotError
from pianobot_ros.cell.motion.geometry import FINGERS, fingertip, hand, keyboard, strike_point
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.piano.action.hybrid.action_model import PARTS
from pianobot_ros.piano.twin.export.mjcf import export_model, twin_mjcf
from pianobot_ros.piano.twin.export.native_laws import missing_of, set_native_laws
from pianobot_ros.piano.twin.model.arm import ArmTracker, arm_forward, arm_inverse, home_pose, servo
from pianobot_ros.piano.twin.model.cell_model import (
    PARAMETERS,
    TIMESTEP,
    TwinOptions,
    build_twin,
    stiffness_at,
)
from pianobot_ros.piano.twin.model.keyboard import key_inertia, key_joint
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin, TwinDivergedError
from pianobot_ros.piano.twin.stepping.rollout import (
    BatchJob,
    Run,
    play,
    play_batch,
    reduced,
    strike_commands,
)

DEGREE = 180 / np.pi


def numbers(run: Run) -> np.ndarray:
    (stroke,) = run.strokes
    return np.array([stroke.peak_force, stroke.v_pre, stroke.t_hold, stroke.v_rel])


def test_fingertips_rest_where_the_geometry_says() -> None:
    twin = build_twin()
    data = mujoco.MjData(twin.model)
    mujoco.mj_forward(twin.model, data)
    wrist = data.body("wrist")
    np.testing.assert_allclose(wrist.xpos, home_pose()[:3], atol=1e-4)
    turn = wrist.xmat.reshape(3, 3)
    np.testing.assert_allclose(turn, np.eye(3), atol=1e-4)
    for finger in FINGERS:
        np.testing.assert_allclose(
            turn.T @ (data.geom(f"{finger}_tip").xpos - wrist.xpos)
            - [0, 0, hand().fingers[finger].radius],
            fingertip(finger),
            atol=1e-6,
        )


def test_a_finger_bends_towards_the_keys_and_carries_its_mass() -> None:
    twin = build_twin()
    data = mujoco.MjData(twin.model)
    for finger in FINGERS:
        mujoco.mj_resetData(twin.model, data)
        mujoco.mj_forward(twin.model, data)
        before = data.geom(f"{finger}_tip").xpos.copy()
        data.joint(f"{finger}_mcp").qpos[0] = 0.1
        mujoco.mj_forward(twin.model, data)
        assert data.geom(f"{finger}_tip").xpos[2] < before[2] - 1e-3
        model = hand().fingers[finger]
        capsules = sum(
            np.pi * model.radius**2 * (length + 4 / 3 * model.radius) for length in model.lengths
        )
        mass = sum(twin.model.body(f"{finger}_{i + 1}").mass[0] for i in range(len(model.lengths)))
        assert mass == pytest.approx(1900 * capsules + hand().pad.mass, rel=1e-9)


def test_keys_have_the_inertia_of_a_wooden_box_about_the_hinge() -> None:
    twin = build_twin()
    data = mujoco.MjData(twin.model)
    mujoco.mj_forward(twin.model, data)
    full = np.zeros((twin.model.nv, twin.model.nv))
    mujoco.mj_fullM(twin.model, data, full)
    for note, dof in zip(twin.notes, twin.key_dof, strict=True):
        implicit = twin.timestep * twin.model.dof_damping[dof]
        assert full[dof, dof] - implicit == pytest.approx(key_inertia(note, keyboard()), rel=1e-9)
    white = keyboard().white
    mass = 450 * white.pivot * white.width * white.thickness
    assert key_inertia(60, keyboard()) == pytest.approx(
        mass * (white.pivot**2 + white.thickness**2) / 3
    )


@pytest.mark.parametrize(
    ("finger", "note", "depth"),
    [("middle", 64, 0.013), ("thumb", 60, 0.013), ("middle", 66, 0.012), ("middle", 65, 0.005)],
)
def test_forces_balance_at_rest(finger: str, note: int, depth: float) -> None:
    """Contact force times lever is the torque of the key's spring and stop; the pad is compressed
    by force over stiffness.
    """
    commands = strike_commands({finger: note}, StrikeMotion(0.05, depth, 1.5))
    twin = CellTwin(TwinOptions(), commands.pose[0])
    twin.command_vacuum(dict.fromkeys(FINGERS, -50e3))
    targets = commands.at_steps(twin.cell.timestep)
    down = round((0.3 + StrikeMotion(0.05, depth, 1.5).down_time + 1.4) / twin.cell.timestep)
    samples = twin.step(down, targets[:down])
    m, data, board = twin.cell.model, twin.data, keyboard()
    mujoco.mj_forward(m, data)
    i = twin.cell.notes.index(note)
    theta, force = samples.angle[-1, i], samples.force[-1, i]
    mechanism = board.mechanism
    stop = (
        mechanism.stop_stiffness
        * mechanism.reference_radius**2
        * max(0.0, theta - mechanism.max_angle)
    )
    tip, hinge = data.geom(f"{finger}_tip").xpos, data.body(f"key_{note}").xpos
    normal = np.array([0.0, -np.sin(theta), np.cos(theta)])
    along = np.array([0.0, -np.cos(theta), -np.sin(theta)])
    top = board.black.height if note == 66 else 0.0
    gap = normal @ (tip - hinge) - top - hand().fingers[finger].radius
    assert force == pytest.approx(-gap * hand().pad.stiffness, rel=2e-3)
    contact = np.zeros(6)
    (index,) = range(data.ncon)
    mujoco.mj_contactForce(m, data, index, contact)
    assert np.hypot(contact[1], contact[2]) <= hand().pad.friction * contact[0] * (1 + 1e-6)
    # The friction pulls along the key in the middle of the pad's compression.
    frame = data.contact[index].frame.reshape(3, 3)
    push = frame.T @ contact[:3]
    torque = np.cross(data.contact[index].pos - hinge, push)[0]
    sign = (
        -1.0 if frame[0] @ normal > 0 else 1.0
    )  # MuJoCo's normal goes from the first geom to the second
    assert abs(torque) == pytest.approx(mechanism.stiffness * theta + stop, rel=3e-3), (
        sign,
        along @ push,
    )


def test_the_joints_carry_the_contact_force() -> None:
    """Static balance of the finger: spring torques are the contact's and gravity's, joint by
    joint.
    """
    commands = strike_commands({"middle": 64}, StrikeMotion(0.05, 0.012, 2.0))
    twin = CellTwin(TwinOptions(), commands.pose[0])
    n = round(1.8 / twin.cell.timestep)
    twin.step(n, commands.at_steps(twin.cell.timestep)[:n])
    m, data = twin.cell.model, twin.data
    mujoco.mj_forward(m, data)
    for i in range(len(hand().fingers["middle"].lengths)):
        joint = m.joint("middle_mcp" if i == 0 else f"middle_ip{i}")
        q, dof = data.qpos[joint.qposadr[0]], joint.dofadr[0]
        load = data.qfrc_constraint[dof] - data.qfrc_bias[dof]
        assert m.jnt_stiffness[joint.id] * q == pytest.approx(load, abs=1e-4)


@pytest.mark.parametrize("stiffness", [0.05, 0.5, 2.0])
@pytest.mark.parametrize(("finger", "note"), [("middle", 64), ("thumb", 60), ("middle", 66)])
def test_a_tenth_of_the_step_changes_nothing_that_matters(
    finger: str, note: int, stiffness: float
) -> None:
    motion = StrikeMotion(0.2, 0.025 if stiffness < 0.1 else 0.012, 0.08)
    commands = strike_commands({finger: note}, motion)
    coarse, fine = (
        numbers(play(commands, reduced(finger, note, timestep=step), stiffness=stiffness * DEGREE))
        for step in (TIMESTEP, TIMESTEP / 10)
    )
    np.testing.assert_allclose(coarse, fine, rtol=0.005)


@pytest.mark.parametrize("keys", ["digital", "acoustic"])
def test_heavy_keys_on_felt_converge_too(keys: str, choose_keys: Callable[[str], None]) -> None:
    choose_keys(keys)
    commands = strike_commands({"middle": 66}, StrikeMotion(0.2, 0.012, 0.08))
    coarse, fine = (
        numbers(play(commands, reduced("middle", 66, timestep=step), stiffness=0.5 * DEGREE))
        for step in (TIMESTEP, TIMESTEP / 10)
    )
    np.testing.assert_allclose(coarse, fine, rtol=0.005)


def test_a_heavy_key_under_the_stiffest_finger_converges(
    choose_keys: Callable[[str], None],
) -> None:
    """Light joints on stiff springs are kept stable without damping more than they have."""
    choose_keys("digital")
    commands = strike_commands({"middle": 64}, StrikeMotion(0.15, 0.014, 0.02))
    coarse, fine = (
        numbers(play(commands, reduced("middle", 64, timestep=step), stiffness=2.0 * DEGREE))
        for step in (TIMESTEP, TIMESTEP / 10)
    )
    np.testing.assert_allclose(coarse, fine, rtol=0.01)


@pytest.mark.parametrize("keys", ["paper", "acoustic"])
def test_keys_that_sleep_change_nothing(keys: str, choose_keys: Callable[[str], None]) -> None:
    choose_keys(keys)
    commands = strike_commands({"middle": 64}, StrikeMotion(0.2, 0.014, 0.1), pressure=-30e3)
    targets = commands.at_steps(TIMESTEP)
    asleep, awake = CellTwin(pose=commands.pose[0]), CellTwin(pose=commands.pose[0])
    awake.cell.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    ours, theirs = (twin.step(len(targets), targets) for twin in (asleep, awake))
    assert asleep.data.ntree_awake < awake.data.ntree_awake
    np.testing.assert_allclose(ours.angle, theirs.angle, atol=1e-12)
    np.testing.assert_allclose(ours.force, theirs.force, atol=1e-9)
    assert ours.strokes == theirs.strokes


def test_an_exported_key_is_wound_and_rests_at_its_stop(choose_keys: Callable[[str], None]) -> None:
    choose_keys("acoustic")
    model = mujoco.MjModel.from_xml_string(twin_mjcf(reduced("middle", 64)))
    data, key = mujoco.MjData(model), model.joint(key_joint(64))
    mechanism = keyboard().mechanism
    wound = model.jnt_stiffness[key.id] * model.qpos_spring[key.qposadr[0]]
    assert wound == pytest.approx(-mechanism.preload_torque, rel=1e-4)
    mujoco.mj_step(model, data, 500)
    assert abs(data.qpos[key.qposadr[0]]) < 5e-4


def test_a_batch_on_felt_is_as_single_runs_are(choose_keys: Callable[[str], None]) -> None:
    choose_keys("acoustic")
    commands = strike_commands({"middle": 64}, StrikeMotion(0.25, 0.014, 0.1), pressure=-50e3)
    (batch,) = play_batch([BatchJob(commands)], reduced("middle", 64))
    np.testing.assert_array_equal(batch.force, play(commands, reduced("middle", 64)).force)
    board = keyboard().mechanism
    assert batch.angle.max() > board.max_angle, "and the bed was reached"


def test_an_export_of_felt_keys_has_springs_and_says_so(
    choose_keys: Callable[[str], None],
) -> None:
    choose_keys("acoustic")
    text = twin_mjcf(reduced("middle", 64))
    assert "felt of the keys' stops" in text.split("-->")[0]
    model = mujoco.MjModel.from_xml_string(text)
    assert model.jnt_limited[model.joint("key_64").id] == 1


def test_one_finger_and_key_give_the_strike_of_the_whole_hand() -> None:
    commands = strike_commands({"middle": 64}, StrikeMotion(0.25, 0.014, 0.1), pressure=-30e3)
    np.testing.assert_allclose(
        numbers(play(commands, reduced("middle", 64))), numbers(play(commands)), rtol=1e-4
    )


def test_energy_does_not_grow() -> None:
    """A plucked hand on keys that swing: no source of energy, so it only falls (to integration
    error).
    """
    twin = CellTwin()
    m, data = twin.cell.model, twin.data
    m.opt.gravity[:] = 0.0
    m.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data.ctrl[:6] = 0.0  # the arm waits
    data.qpos[6:20] = 0.15 * np.sin(np.arange(14))
    data.qpos[twin.cell.key_qpos] = np.linspace(0.0, 0.04, 12)
    energy = []
    for _ in range(1500):
        mujoco.mj_step(m, data)
        energy.append(data.energy.sum())
    values = np.array(energy)
    assert values[-1] < 1e-3 * values[0]
    assert np.max(np.diff(values)) < 2e-3 * values[0]


@fewer(0.12, suppress=list(HealthCheck))
@given(
    factors=st.fixed_dictionaries({name: st.floats(0.3, 3.0) for name in PARAMETERS}),
    stiffness=st.floats(0.05, 2.0),
    speed=st.floats(0.05, 0.4),
    depth=st.floats(0.004, 0.02),
    target=st.sampled_from([("middle", 64), ("middle", 66), ("thumb", 60)]),
)
def test_nothing_within_bounds_diverges_or_warns(
    factors: dict[str, float], stiffness: float, speed: float, depth: float, target: tuple[str, int]
) -> None:
    finger, note = target
    commands = strike_commands({finger: note}, StrikeMotion(speed, depth, 0.05))
    run = play(commands, reduced(finger, note, parameters=factors), stiffness=stiffness * DEGREE)
    angle, _, force = run.key(note)
    assert np.isfinite(run.angle).all() and np.isfinite(run.force).all()
    assert angle.max() > 0.005 and force.max() < 200
    assert abs(angle[-1]) < 0.01  # the key comes back


def test_divergence_is_an_error_and_not_a_number() -> None:
    twin = CellTwin()
    twin.data.qvel[8] = 1e12
    with pytest.raises(TwinDivergedError, match="unstable"):
        twin.step(50)


def test_the_wrist_follows_the_nominal_law_whatever_it_touches() -> None:
    law, step = servo(), TIMESTEP
    start = np.array([*wrist_pose({"middle": 64}).position, 0.0, 0.0, 0.0])
    target = start + np.array([0.004, 0.01, -0.016, 0.02, -0.1, 0.05])
    twin = CellTwin(TwinOptions(), start)
    twin.command_wrist(target)
    samples = twin.step(600)
    w, z = law.natural_frequency, law.damping_ratio
    matrix = np.array([[0.0, 1.0], [-w * w, -2 * z * w]])
    for k in (10, 100, 599):
        share = expm(matrix * k * step)[0, 0]
        np.testing.assert_allclose(samples.pose[k], target + share * (start - target), atol=1e-10)
    mujoco.mj_forward(twin.cell.model, twin.data)
    assert samples.force.max() > 1.0
    np.testing.assert_allclose(twin.data.body("wrist").xpos, twin.pose[:3], atol=1e-6)
    np.testing.assert_allclose(arm_forward(twin.data.qpos[:6]), twin.pose, atol=2e-6)


def test_the_arm_reaches_every_key_and_says_where_it_cannot() -> None:
    for note in keyboard().notes:
        pose = wrist_pose({"middle": note})
        wanted = np.array([*pose.position, *pose.rotation.as_rotvec()])
        np.testing.assert_allclose(arm_forward(arm_inverse(wanted)), wanted, atol=1e-8)
    with pytest.raises(PianobotError, match="reach"):
        arm_inverse([1.5, 0.0, 0.2, 0.0, 0.0, 0.0])
    tracker = ArmTracker(TIMESTEP)
    before = tracker.pose.copy()
    with pytest.raises(PianobotError, match="reach"):
        tracker.advance(np.tile([2.0, 0.0, 0.2, 0.0, 0.0, 0.0], (5000, 1)))
    np.testing.assert_array_equal(tracker.pose, before)


def test_vacuum_sets_stiffness_in_place() -> None:
    twin = build_twin()
    twin.set_pressure([0.0, -50e3, -100e3])
    k = stiffness_at([0.0, -50e3, -100e3])
    for finger, wanted in zip(FINGERS, k, strict=True):
        assert twin.model.jnt_stiffness[twin.model.joint(f"{finger}_mcp").id] == pytest.approx(
            wanted
        )
        abduction = twin.model.jnt_stiffness[twin.model.joint(f"{finger}_mcp_abduction").id]
        assert abduction == pytest.approx(wanted * hand().joints.abduction_ratio)
    assert (np.diff(stiffness_at(np.linspace(0, -1e5, 50))) > 0).all()


def test_factors_reach_the_model_and_go_back() -> None:
    twin = build_twin()
    nominal = (
        twin.model.dof_damping.copy(),
        twin.model.body_inertia.copy(),
        twin.model.jnt_stiffness.copy(),
    )
    twin.set_parameters(dict.fromkeys(PARAMETERS, 1.5))
    twin.set_pressure(np.zeros(3))
    key = twin.model.joint("key_64")
    assert twin.model.dof_damping[key.dofadr[0]] == pytest.approx(
        1.5 * keyboard().mechanism.damping
    )
    assert twin.model.jnt_stiffness[key.id] == pytest.approx(1.5 * keyboard().mechanism.stiffness)
    twin.set_parameters({})
    twin.set_pressure(np.zeros(3))
    for before, after in zip(
        nominal,
        (twin.model.dof_damping, twin.model.body_inertia, twin.model.jnt_stiffness),
        strict=True,
    ):
        np.testing.assert_array_equal(before, after)


def test_bad_options_say_what_to_do() -> None:
    for options, words in (
        ({"fingers": ("pinky",)}, "finger"),
        ({"mechanism": "springs"}, "did you mean 'spring'"),
        ({"parameters": {"joint_stifness": 1.0}}, "did you mean 'joint_stiffness'"),
        ({"parameters": {"key_damping": 0.0}}, "between 0.1 and 10"),
        ({"timestep": 0.01}, "5e-4"),
    ):
        with pytest.raises(ConfigError, match=words):
            TwinOptions(**options)  # type: ignore[arg-type]


def test_laws_that_mujoco_has_change_the_strike() -> None:
    commands = strike_commands({"middle": 64}, StrikeMotion(0.2, 0.015, 0.1))

    def force(**numbers: float) -> float:
        twin = CellTwin(reduced("middle", 64), commands.pose[0])
        set_native_laws(twin.cell, numbers)
        targets = commands.at_steps(twin.cell.timestep)
        return float(twin.step(len(targets), targets).force.max())

    nominal = force()
    for name, x in {
        "joint_friction": 0.05,
        "key_friction": 0.1,
        "key_preload": 0.1,
        "joint_hardening": 1000.0,
        "tip_drop": 0.002,
        "felt_thickness": 0.002,
    }.items():
        assert force(**{name: x}) > nominal * 1.01, name
    assert force(pad_stiffness=0.2) < nominal * 0.99
    assert force(tip_slip=0.9) != pytest.approx(nominal, rel=1e-3)


def test_what_mujoco_lacks_of_the_laws_is_told_by_name() -> None:
    numbers = {"tip_drop": 1e-3, "hammer": 0.02, "key_friction": 0.01}
    left = missing_of(numbers)
    assert [line.split(" = ")[0] for line in left] == ["hammer", "key_friction"]
    text = twin_mjcf(reduced("middle", 64), numbers=numbers, left=["midi_latency = 0.01 s"])
    head = text[: text.index("-->")]
    assert all(name in head for name in ("midi_latency", "hammer", "key_friction"))
    model = mujoco.MjModel.from_xml_string(text)
    assert model.dof_frictionloss[model.joint("key_64").dofadr[0]] == 0.01
    plain = mujoco.MjModel.from_xml_string(twin_mjcf(reduced("middle", 64)))
    tip = [m.geom("middle_tip").pos[2] for m in (model, plain)]
    assert tip[0] - tip[1] == pytest.approx(-1e-3)


def test_both_key_mechanisms_sound_the_note() -> None:
    commands = strike_commands({"middle": 64}, StrikeMotion(0.2, 0.014, 0.15))
    spring, action = (play(commands, TwinOptions(mechanism=name)) for name in ("spring", "action"))
    assert [e.note for e in spring.events] == [e.note for e in action.events] == [64, 64]
    assert not np.allclose(numbers(spring), numbers(action), rtol=0.01)


def test_a_batch_on_two_threads_is_the_same_as_one_after_the_other() -> None:
    jobs = [
        BatchJob(strike_commands({"middle": 64}, StrikeMotion(speed, 0.012, 0.1)), k)
        for speed, k in ((0.1, 6.0), (0.2, 12.0), (0.3, 25.0))
    ]
    for job, run in zip(jobs, play_batch(jobs, reduced("middle", 64)), strict=True):
        alone = play(job.commands, reduced("middle", 64), stiffness=job.stiffness)
        np.testing.assert_array_equal(run.force, alone.force)
        assert run.strokes == alone.strokes
    assert play_batch([]) == []


def test_vacuum_changes_within_a_run() -> None:
    commands = strike_commands({"middle": 64}, StrikeMotion(0.1, 0.012, 0.6))
    changing = replace(
        commands,
        vacuum_time=np.array([0.0, 0.9]),
        pressure=np.array([[0.0] * 3, [-100e3] * 3]),
    )
    force = play(changing, reduced("middle", 64)).key(64)[2]
    at = round(0.9 / TIMESTEP)
    assert force[at + 250] > force[at - 1] * 1.1


def test_the_exported_model_plays_the_same_in_stock_mujoco(tmp_path) -> None:  # type: ignore[no-untyped-def]
    pressure = [-20e3, -40e3, -60e3]
    model = mujoco.MjModel.from_xml_path(
        str(export_model(tmp_path / "twin.xml", pressure=pressure))
    )
    commands = strike_commands({"middle": 64}, StrikeMotion(0.2, 0.014, 0.1))
    twin = CellTwin(TwinOptions(), commands.pose[0])
    twin.command_vacuum(dict(zip(FINGERS, pressure, strict=True)))
    targets = commands.at_steps(twin.cell.timestep)
    ours = twin.step(len(targets), targets)
    tracker = ArmTracker(float(model.opt.timestep), commands.pose[0])
    data = mujoco.MjData(model)
    data.qpos[:6] = tracker.joint
    control, _, _ = tracker.advance(targets)
    forces, angles = [], []
    for u in control:
        angles.append(data.joint("key_64").qpos[0])
        data.ctrl[:6] = u
        mujoco.mj_step(model, data)
        forces.append(data.sensor("key_64_force").data[0])
    assert max(forces) == pytest.approx(ours.force.max(), rel=2e-3)
    np.testing.assert_allclose(angles, ours.angle[:, 4], atol=2e-5)
    assert int(np.sum(data.warning.number)) == 0


@pytest.mark.parametrize("options", [TwinOptions(), TwinOptions(mechanism="action", parts=PARTS)])
def test_an_exported_model_stands_still_as_loaded(options: TwinOptions) -> None:
    """With nothing commanded the arm waits, the fingers hang and the keys rest."""
    model = mujoco.MjModel.from_xml_string(twin_mjcf(options))
    data = mujoco.MjData(model)
    start = data.qpos.copy()
    mujoco.mj_step(model, data, nstep=1500)
    assert int(np.sum(data.warning.number)) == 0
    assert np.abs(data.qpos[:6] - start[:6]).max() < 1e-4
    assert np.abs(data.qvel).max() < 1e-2
    for note in keyboard().notes:
        assert abs(data.joint(f"key_{note}").qpos[0]) < 1e-6


def test_an_export_that_cannot_be_written_is_an_error(tmp_path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(PianobotError, match="cannot write"):
        export_model(tmp_path / "missing" / "twin.xml")


def test_a_key_at_rest_stays_there() -> None:
    twin = CellTwin()
    samples = twin.step(500)
    assert np.abs(samples.angle).max() < 1e-9
    assert samples.events == []
    assert strike_point(60)[2] == pytest.approx(
        twin.data.geom("key_60").xpos[2] + keyboard().white.thickness / 2
    )
