"""The action on felt under a hinged key of MuJoCo, against the exact felt model."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.action.felt import STEP, FeltAction
from pianobot_ros.piano.action.mujoco.felt_hinge import HAMMER, FeltActions, add_felt_key

RADIUS, TICK, SPAN = 0.195, 1e-4, 0.15


def hinged() -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = TICK
    body = spec.worldbody.add_body(name="key")
    body.add_joint(name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1.0, 0.0, 0.0])
    body.add_geom(name="wood", size=[0.01, 0.1, 0.01], type=mujoco.mjtGeom.mjGEOM_BOX)
    add_felt_key(spec, "key", "hinge", radius=RADIUS)
    return spec.compile()


@pytest.mark.parametrize("force", [4.1, 8.0, 12.0])
def test_it_moves_as_the_exact_model(force: float) -> None:
    """Which has no back rail, so a soft press would start otherwise."""
    model = hinged()
    data = mujoco.MjData(model)
    actions = FeltActions(model, ["hinge"], np.array([RADIUS]))
    rows = []
    for _ in range(round(SPAN / TICK)):
        rows.append((data.time, RADIUS * data.qpos[0], actions.memory[0, HAMMER]))
        actions.update(data)
        data.qfrc_applied[0] += force * RADIUS
        mujoco.mj_step(model, data)
    time, key, hammer = np.array(rows).T
    exact = FeltAction(load_parameters()).press(np.full(round(SPAN / STEP), force))
    first = exact.time[np.argmax(exact.hammer >= load_parameters().string.height)]
    assert [e.rule for e in actions.events[:1]] == (["string made"] if first else [])
    if first:
        assert actions.events[0].time == pytest.approx(first, abs=3e-4)
    until = time < (first + 0.005 if first else SPAN)  # then bounces tell small differences apart
    for ours, theirs in ((key, exact.key), (hammer, exact.hammer)):
        away = ours[until] - np.interp(time[until], exact.time, theirs)
        assert np.sqrt(np.mean(away**2)) < 0.01 * np.ptp(theirs)


def test_at_rest_it_stays_and_applies_nothing() -> None:
    model = hinged()
    data = mujoco.MjData(model)
    actions = FeltActions(model, ["hinge"], np.array([RADIUS]))
    for _ in range(200):
        actions.update(data)
        mujoco.mj_step(model, data)
    assert data.qpos[0] == data.qfrc_applied[0] == 0.0
    assert actions.events == []


def test_a_key_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match="unknown body 'key'"):
        add_felt_key(mujoco.MjSpec(), "key", "hinge", radius=RADIUS)
