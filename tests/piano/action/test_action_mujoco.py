from __future__ import annotations

import mujoco
import numpy as np
import pytest
from action_strategies import actions
from examples import fewer
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.hybrid.action_model import build_model
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import simulate
from pianobot_ros.piano.action.mujoco.hinge import add_action_mechanism, hinge_mechanism
from pianobot_ros.piano.action.mujoco.mujoco_hybrid import compare, simulate_mujoco
from pianobot_ros.piano.action.results.features import step_response

RADIUS = 0.195
INTEGRATOR = {
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}


@pytest.mark.parametrize(
    ("integrator", "step"), [("rk4", 1e-3), ("rk4", 5e-4), ("implicitfast", 1e-4)]
)
def test_step_is_that_of_the_exact_reference(
    parameters: ActionParameters, integrator: str, step: float
) -> None:
    reference = step_response(parameters, 0.6)
    error = compare(
        simulate_mujoco(parameters, ForceProfile.step(4.1), 0.6, step=step, integrator=integrator),
        reference,
    )
    assert max(error["key"], error["hammer"]) < 1e-3
    assert max(error["key_velocity"], error["hammer_velocity"]) < 1e-2


@given(actions(), st.floats(2.0, 10.0))
@fewer(0.15)
def test_random_actions_follow_the_reference_and_never_warn(
    p: ActionParameters, force: float
) -> None:
    reference = simulate(build_model(p, rail_pulls=False), ForceProfile.step(force), 0.4)
    error = compare(simulate_mujoco(p, ForceProfile.step(force), 0.4, step=2e-4), reference)
    assert max(error["key"], error["hammer"]) < 2e-3
    assert max(error["key_velocity"], error["hammer_velocity"]) < 2e-2


def hinged(sign: float, step: float, integrator: str) -> mujoco.MjSpec:
    """A key as a keyboard would have it: a wooden stick on a hinge, in degrees as specs are by
    default.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.integrator = INTEGRATOR[integrator]
    body = spec.worldbody.add_body(name="stick", pos=(0.1, 0.2, 0.3))
    body.add_joint(
        name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(sign, 0, 0), damping=[0.5, 0, 0]
    )
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.01, 0.1, 0.01), pos=(0, -0.1, 0), density=450
    )
    return spec


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("integrator", "step", "tolerance"), [("rk4", 5e-4, 1e-3), ("implicitfast", 1e-4, 2e-3)]
)
def test_hinged_key_moves_as_the_reference(
    parameters: ActionParameters, sign: float, integrator: str, step: float, tolerance: float
) -> None:
    p = parameters.vary("armature", stiffness=0.0)
    spec = hinged(sign, step, integrator)
    rig = {"sign": sign, "carries": p.armature}
    add_action_mechanism(spec, "stick", "hinge", radius=RADIUS, parameters=p, **rig)
    model = spec.compile()
    data = mujoco.MjData(model)
    count = round(0.6 / step)
    found = np.empty((count, 4))
    for k in range(count):
        found[k] = (
            sign * RADIUS * data.qpos[0],
            sign * RADIUS * data.qvel[0],
            data.qpos[1],
            data.qvel[1],
        )
        data.qfrc_applied[0] = sign * RADIUS * (3.0 if k < count // 2 else 0.0)
        mujoco.mj_step(model, data)
    assert not any(w.number for w in data.warning)

    sunk = (
        p.hammer.weight / p.back_rail.stiffness
    )  # the reference counts from the untouched felt, the hinge from rest
    q = p.vary("key", dip=p.key.dip - sunk)
    profile = ForceProfile.steps([(0.0, 3.0), (0.3, 0.0)])
    z, _ = simulate(build_model(q, {"back_rail"}, rail_pulls=False), profile, 0.6).states(
        step * np.arange(count)
    )
    expected = z[:, :4] - [-sunk, 0.0, -sunk - p.hammer.weight / p.hammer.coupler_stiffness, 0.0]
    error = np.linalg.norm(found - expected, axis=0) / np.linalg.norm(expected, axis=0)
    assert max(error[[0, 2]]) < tolerance
    assert max(error[[1, 3]]) < 5 * tolerance


def test_hinged_key_rests_at_zero_and_weighs_the_hammer(parameters: ActionParameters) -> None:
    spec = hinged(1.0, 2e-4, "implicitfast")
    mechanism = add_action_mechanism(spec, "stick", "hinge", radius=RADIUS)
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos).max() < 1e-12
    assert model.jnt_range[0] == pytest.approx([mechanism.lost, parameters.key.dip / RADIUS])
    assert model.dof_M0[0] == pytest.approx(parameters.key.mass * RADIUS**2)
    assert mechanism.rest_torque == pytest.approx(0.3658 * RADIUS)


def test_two_keys_can_share_a_spec(parameters: ActionParameters) -> None:
    spec = hinged(1.0, 2e-4, "implicitfast")
    other = spec.worldbody.add_body(name="other")
    other.add_joint(name="other_hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(1, 0, 0))
    for body, joint in (("stick", "hinge"), ("other", "other_hinge")):
        add_action_mechanism(spec, body, joint, radius=RADIUS, parameters=parameters)
    model = spec.compile()
    assert (model.nv, model.nu, model.ntendon) == (4, 2, 2)
    assert model.actuator("other_hinge_coupler").forcerange[1] == 0.0


def test_bad_requests_are_refused(parameters: ActionParameters) -> None:
    spec = hinged(1.0, 1e-3, "rk4")
    with pytest.raises(ConfigError, match="unknown joint 'hing'"):
        add_action_mechanism(spec, "stick", "hing", radius=RADIUS)
    with pytest.raises(ConfigError, match="unknown body 'stik'"):
        add_action_mechanism(spec, "stik", "hinge", radius=RADIUS)
    with pytest.raises(ConfigError, match="sign"):
        add_action_mechanism(spec, "stick", "hinge", radius=RADIUS, sign=0.5)
    with pytest.raises(ConfigError, match="positive"):
        hinge_mechanism(parameters, 0.0)
    with pytest.raises(ConfigError, match="one stiffness"):
        hinge_mechanism(parameters.vary("back_rail", stiffness=1.0), RADIUS)
    with pytest.raises(ConfigError, match="unknown integrator"):
        simulate_mujoco(parameters, ForceProfile.step(1.0), 0.1, integrator="rk45")


def test_hinged_key_survives_as_a_file(parameters: ActionParameters) -> None:
    """What export-model writes must behave the same in stock MuJoCo."""
    spec = hinged(1.0, 2e-4, "implicitfast")
    add_action_mechanism(spec, "stick", "hinge", radius=RADIUS, parameters=parameters)
    models = [spec.compile(), mujoco.MjModel.from_xml_string(spec.to_xml())]
    ends = []
    for model in models:
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = 1.0 * RADIUS
        mujoco.mj_step(model, data, nstep=1000)
        ends.append(data.qpos.copy())
    assert ends[0] == pytest.approx(ends[1], rel=1e-4)
