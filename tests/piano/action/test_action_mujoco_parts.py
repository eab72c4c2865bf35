"""Let-off, repetition lever and backcheck in MuJoCo, held against the exact event-driven
reference.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.hybrid.action_model import PARTS, build_model
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Simulator, Trajectory, simulate
from pianobot_ros.piano.action.mujoco.hinge import add_action_mechanism, attachment, hinged_action
from pianobot_ros.piano.action.mujoco.mujoco_hybrid import (
    MujocoHistory,
    compare,
    hybrid_spec,
    simulate_mujoco,
)
from pianobot_ros.piano.action.mujoco.mujoco_parts import Switchboard

SINGLE = PARTS - {"repetition_lever"}
HALF_WAY = ForceProfile.steps([(0.0, 5.0), (0.15, 1.5), (0.23, 5.0), (0.37, 0.0)])
SOFT = ForceProfile((0.0, 0.2), (0.0, 3.4))
STEP = 1e-4


def both(
    p: ActionParameters, parts: frozenset[str], press: ForceProfile, end: float
) -> tuple[MujocoHistory, Trajectory]:
    ours = simulate_mujoco(p, press, end, step=STEP, parts=parts)
    return ours, simulate(build_model(p, parts, rail_pulls=False), press, end)


def times(path: MujocoHistory | Trajectory, rule: str) -> list[float]:
    return [e.time for e in path.events if e.rule == rule]


@pytest.mark.parametrize("press", [ForceProfile.step(5.0), SOFT], ids=["middle", "soft"])
def test_all_parts_together_are_as_close_as_the_four_modes(
    parameters: ActionParameters, press: ForceProfile
) -> None:
    error = compare(*both(parameters, PARTS, press, 0.3))
    assert max(error["key"], error["hammer"]) < 1e-3
    assert max(error["key_velocity"], error["hammer_velocity"]) < 1e-2


@pytest.mark.parametrize("parts", [PARTS, SINGLE], ids=["lever", "single"])
def test_a_repeated_note_needs_the_lever_here_too(
    parameters: ActionParameters, parts: frozenset[str]
) -> None:
    ours, exact = both(parameters, parts, HALF_WAY, 0.45)
    assert len(times(ours, "string made")) == (2 if parts == PARTS else 1)
    for rule in (
        "jack out",
        "string made",
        "hammer checked",
        "check releases",
        "jack back",
        "jack back, loaded",
    ):
        assert times(ours, rule) == pytest.approx(times(exact, rule), abs=5 * STEP), rule
    struck = [e.hammer_velocity for e in ours.events if e.rule == "string made"]
    expected = [e.state[3] for e in exact.events if e.rule == "string made"]
    assert struck == pytest.approx(expected, rel=0.02)


def test_the_check_holds_the_hammer_where_the_reference_does(parameters: ActionParameters) -> None:
    ours, exact = both(parameters, PARTS, ForceProfile.step(5.0), 0.3)
    z, _ = exact.states(ours.time)
    assert ours.hammer[-1] == pytest.approx(z[-1, 2], abs=2e-5)
    free, _ = both(parameters, PARTS - {"backcheck"}, ForceProfile.step(5.0), 0.3)
    assert times(free, "hammer checked") == []
    assert free.hammer[-1] > ours.hammer[-1] + 5e-4, (
        "without it the repetition spring lifts the hammer again"
    )


def test_without_let_off_the_hammer_blocks_the_string(parameters: ActionParameters) -> None:
    ours, exact = both(parameters, frozenset({"back_rail", "string"}), ForceProfile.step(5.0), 0.3)
    assert len(times(exact, "string made")) > 1
    assert times(ours, "string made")[:2] == pytest.approx(
        times(exact, "string made")[:2], abs=1e-3
    )
    assert ours.hammer[-1] > parameters.string.height


def test_lag_of_the_hammer_behind_let_off(parameters: ActionParameters) -> None:
    lags = {}
    for name, press in (("soft", SOFT), ("middle", ForceProfile.step(4.0))):
        ours, exact = both(parameters, PARTS, press, 0.3)
        lags[name], expected = (
            times(path, "string made")[0] - times(path, "jack out")[0] for path in (ours, exact)
        )
        assert lags[name] == pytest.approx(expected, abs=2 * STEP)
    lit = parameters.expected
    assert lags["middle"] == pytest.approx(lit.key_to_hammer_fast, abs=1.5e-3)
    assert lags["soft"] == pytest.approx(lit.key_to_hammer_slow, abs=3.5e-3)


def test_parts_left_alone_are_the_paper(parameters: ActionParameters) -> None:
    """With all commands at 0, as in stock MuJoCo, jack and coupler stay together and nothing else
    acts.
    """
    ends = []
    for parts in (frozenset({"back_rail"}), PARTS):
        model = hybrid_spec(parameters, step=2e-4, parts=parts).compile()
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = 4.0
        mujoco.mj_step(model, data, nstep=400)
        ends.append(np.concatenate([data.qpos, data.qvel]))
    assert ends[1] == pytest.approx(ends[0], abs=1e-12)


def test_hinged_key_follows_the_reference_to_the_string(parameters: ActionParameters) -> None:
    radius, press, p = 0.195, 3.0, parameters
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    body = spec.worldbody.add_body(name="stick")
    body.add_joint(name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(1, 0, 0))
    rig = {"parts": PARTS, "carries": p.armature}
    add_action_mechanism(spec, "stick", "hinge", radius=radius, parameters=p, **rig)
    model = spec.compile()
    data = mujoco.MjData(model)
    action = hinged_action(p, PARTS)
    board = Switchboard(model, action, [attachment(p, "hinge", radius, parts=PARTS)])
    mujoco.mj_step(model, data, nstep=10)
    assert np.abs(data.qpos).max() < 1e-9, "at rest, with the weights on the felt"
    mujoco.mj_resetData(model, data)
    for _ in range(round(0.1 / STEP)):
        data.qfrc_applied[0] = press * radius
        board.update(data)
        mujoco.mj_step(model, data)
    # The reference carries the return weight as a smaller force; without the flexure, which the
    # finger replaces.
    q = action.parameters.vary("armature", stiffness=0.0)
    weight = p.key.return_weight
    model_ = build_model(q, PARTS, rail_pulls=False)
    mode, _ = model_.rest()
    start = model_.equilibrium(mode, -weight)
    exact = Simulator(model_).run(ForceProfile.step(press - weight), 0.1, start=(mode, start))
    for rule in ("jack out", "string made"):
        ours = [e.time for e in board.events if e.rule == rule]
        assert ours[:1] == pytest.approx(times(exact, rule)[:1], abs=5 * STEP), rule
    board.reset()
    assert board.events == []
    assert "jack" in board.modes()[0]


def test_unequal_rails_are_refused(parameters: ActionParameters) -> None:
    with pytest.raises(ConfigError, match="one stiffness"):
        hybrid_spec(parameters.vary("back_rail", stiffness=1.0), parts={"back_rail"})
    with pytest.raises(ConfigError, match="unknown part"):
        hybrid_spec(parameters, parts={"let_of"})
