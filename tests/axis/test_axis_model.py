"""Gravity and inertia from a model of the whole robot."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.around.neighbours import with_neighbours
from pianobot_ros.axis.commissioning.sizes import with_weight
from pianobot_ros.axis.diagnosis.robot_model import RobotModel
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.cli.app import main
from pianobot_ros.gap import GapError

G = 9.81
ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="upper">
<joint name="shoulder_joint" type="hinge" axis="0 1 0"/>
<inertial pos="0 0 -0.5" mass="2" diaginertia="1e-6 1e-6 1e-6"/>
<body name="lower" pos="0 0 -0.5"><joint name="elbow_joint" type="hinge" axis="0 1 0"/>
<inertial pos="0 0 -0.4" mass="1" diaginertia="1e-6 1e-6 1e-6"/></body></body></worldbody></mujoco>
"""
T = np.arange(0, 12, 0.01)
SHOULDER, ELBOW = 0.8 * np.sin(1.1 * T), 0.9 * np.sin(0.7 * T + 1.0)


@pytest.fixture
def path(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM, encoding="utf-8")
    return tmp_path / "arm.xml"


def gravity():
    """Torque (n,) of two point masses hanging at 0."""
    upper = (2 * 0.5 + 1 * 0.5) * G * np.sin(SHOULDER)
    return upper + 0.4 * G * np.sin(SHOULDER + ELBOW)


def log(effort=None, joints=("shoulder", "elbow")):
    return Log(
        "a",
        T,
        None,
        SHOULDER,
        None,
        effort,
        "Nm",
        (),
        joints[0],
        others={joints[1]: ELBOW},
        joints=joints,
    )


def test_gravity_and_inertia_follow_the_other_joint(path):
    said = RobotModel(path).regressor(log())
    assert said is not None
    torque = said[:, 0] * np.sin(SHOULDER) + said[:, 1] * np.cos(SHOULDER)
    assert np.allclose(torque, gravity(), atol=0.02)
    inertia = 3 * 0.25 + 0.16 + 2 * 0.5 * 0.4 * np.cos(ELBOW)
    assert np.allclose(said[:, 2], inertia, atol=5e-3)


def test_the_twin_needs_the_effort_that_the_model_says(path):
    inertia = 3 * 0.25 + 0.16 + 2 * 0.5 * 0.4 * np.cos(ELBOW)
    acceleration = np.gradient(np.gradient(SHOULDER, T), T)
    held = log(inertia * acceleration + gravity())
    model = RobotModel(path)
    twin = ServoAxis([clean(model.told(held))])
    assert twin.joint.nominal["model_scale"] == 1.0
    from pianobot_ros.axis.signals.segment import blocks_of

    blocks = blocks_of(twin.joint.logs[0])[0]
    values = {"inertia": float(inertia.mean()), "viscous": 0.0, "effort_offset": 0.0}
    for made, block in zip(twin.simulate(blocks, values, ()), blocks, strict=True):
        felt = block.outputs["effort"].y
        moves = np.isfinite(felt)  # at rest dry friction may hold anything: that does not count
        assert moves.mean() > 0.9
        assert np.allclose(made["effort"][moves], felt[moves], atol=0.25)


def drawn():
    """Torque (n,) that the elbow's motion draws of the shoulder: inertia that both share, Coriolis
    and centrifugal, of point masses.
    """
    v1, v2 = np.gradient(SHOULDER, T), np.gradient(ELBOW, T)
    a2 = np.gradient(v2, T)
    arm = 1 * 0.5 * 0.4
    return (0.16 + arm * np.cos(ELBOW)) * a2 - arm * np.sin(ELBOW) * (2 * v1 * v2 + v2**2)


def test_the_other_joints_motion_draws_what_the_equations_of_two_links_say(path):
    said = RobotModel(path).told(log())
    assert said.coupling is not None
    assert np.allclose(said.coupling[20:-20], drawn()[20:-20], atol=2e-3)


def test_what_the_other_joints_draw_is_fitted_and_no_effect(path):
    inertia = 3 * 0.25 + 0.16 + 2 * 0.5 * 0.4 * np.cos(ELBOW)
    own = inertia * np.gradient(np.gradient(SHOULDER, T), T) + gravity()
    noise = 1e-3 * np.random.default_rng(0).normal(size=T.size)
    held = RobotModel(path).told(log(own + drawn() + noise))
    (explained,), said = with_neighbours(with_weight([clean(held)]))
    assert "by the model times" in said
    assert explained.drawn is not None
    assert np.allclose(explained.drawn[20:-20], drawn()[20:-20], atol=0.02)


def test_a_model_whose_meshes_are_missing_has_its_bodies_all_the_same(path, tmp_path):
    body = '<geom type="mesh" mesh="shell"/><inertial pos="0 0 -0.4"'
    text = ARM.replace('<inertial pos="0 0 -0.4"', body)
    text = text.replace("<worldbody>", '<asset><mesh file="shell.stl"/></asset><worldbody>')
    (tmp_path / "bare.xml").write_text(text, encoding="utf-8")
    bare, whole = (RobotModel(p).regressor(log()) for p in (tmp_path / "bare.xml", path))
    assert bare is not None and whole is not None
    assert np.allclose(bare, whole)


def test_joints_by_order_and_none(path):
    model = RobotModel(path)
    assert list(model.matched(("0", "1")).values()) == list(model.joints.values())
    assert list(model.matched(("1", "2")).values()) == list(model.joints.values())
    assert list(model.matched(("1",)).values()) == list(model.joints.values())[:1]
    assert set(model.matched(("Elbow", "camera"))) == {"Elbow"}
    with pytest.raises(GapError, match="none of the model's"):
        model.matched(("a", "b", "c"))


def test_a_model_that_cannot_be_used_says_so_in_one_line(tmp_path, capsys):
    rows = "\n".join(f"{t},{q},{q}" for t, q in zip(T, SHOULDER, strict=True))
    (tmp_path / "a.csv").write_text(f"time,position,command\n{rows}\n", encoding="utf-8")
    for name, content in (("a.urdf", "no xml"), ("b.xml", "<mujoco/>"), ("c.xml", None)):
        if content is not None:
            (tmp_path / name).write_text(content, encoding="utf-8")
        words = ["axis", "diagnose", str(tmp_path / "a.csv"), "--model", str(tmp_path / name)]
        assert main(words) == 2
        assert capsys.readouterr().err.count("\n") == 1
