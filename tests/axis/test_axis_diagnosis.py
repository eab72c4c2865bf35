"""The axis twin end to end, on logs of the independent plant and through its command line."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pianobot_ros.axis.diagnosis.joint import diagnose_logs
from pianobot_ros.axis.diagnosis.robot import diagnose_robot
from pianobot_ros.axis.laws import LIBRARY, kernel
from pianobot_ros.axis.laws.readings import Readings
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.signals.segment import blocks_of
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.cli.app import main
from pianobot_ros.emulator.plant.axis_plant import IN_LIBRARY, Axis, record, trajectory

pytestmark = pytest.mark.slow

COMMAND = ("axis", "diagnose")
AXIS = Axis(inertia=0.05, viscous=0.15, kt=0.5)
NOMINAL = {
    "inertia": 0.1,
    "viscous": 0.3,
    "bandwidth": 30.0,
    "damping": 0.8,
    "feedforward": 0.7,
    "integral": 2.0,
}


def log_of(effects=None, seed=4, kind="cycle", rate=100.0, seconds=16.0):
    rng = np.random.default_rng(seed)
    r = record(AXIS, trajectory(kind, seconds, rng, rate), rate, rng, effects)
    return Log("log", r.t, r.command, r.position, r.velocity, r.current, "A"), r


def test_none():
    d = diagnose_logs([log_of()[0]], nominal=NOMINAL)
    assert d.verdict == "none"


@pytest.mark.parametrize(
    ("name", "values", "stage"),
    [
        ("coulomb", {"level": 0.15}, "mechanics"),
        pytest.param("gravity", {"grav": 0.6, "grav_angle": 0.3}, "load", marks=pytest.mark.long),
        ("command_delay", {"seconds": 0.04}, "command"),
    ],
)
def test_effect_under_wrong_parameters(name, values, stage):
    wrong = {
        k: v * f for (k, v), f in zip(NOMINAL.items(), (1.1, 0.9, 0.9, 1.1, 1.05, 0.9), strict=True)
    }
    d = diagnose_logs([log_of({name: values})[0]], nominal=wrong)
    assert d.verdict == "effect"
    assert d.candidates[0].name == name
    assert d.effects[0].stage == stage
    assert d.gap.closed > 0.8


def test_two_files_through_the_command_line(tmp_path, capsys):
    _, a = log_of({"coulomb": {"level": 0.2}}, seed=5)
    a.write(tmp_path / "a.csv", drop=("velocity",))
    report = tmp_path / "out.html"
    assert (
        main(
            [
                *COMMAND,
                str(tmp_path / "a.csv"),
                "--json",
                "--report",
                str(report),
                "--nominal",
                "inertia=0.1",
                "viscous=0.3",
            ]
        )
        == 0
    )
    document = json.loads(capsys.readouterr().out)
    assert document["candidates"][0]["name"] in {
        "coulomb",
        "load_friction",
        "stribeck",
        "asymmetric_friction",
    }
    further = document["next_experiment"]
    assert further["expected_gain"] >= 0
    assert further["units"] == {"start": "s", "speed": "rad/s", "travel": "rad"}
    assert report.stat().st_size > 10_000


@pytest.mark.parametrize(
    "argv",
    [["/nowhere.csv"], ["x.csv", "--columns", "time"], ["x.csv", "--nominal", "inertia=much"]],
)
def test_bad_input_is_one_line_and_exit_code_2(argv, capsys):
    assert main([*COMMAND, *argv]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize("value", ["-1", "0"])
def test_a_nominal_value_that_no_joint_has_is_refused_by_its_name(tmp_path, capsys, value):
    _, r = log_of(seconds=6.0)
    r.write(tmp_path / "a.csv")
    assert main([*COMMAND, str(tmp_path / "a.csv"), "--nominal", f"inertia={value}"]) == 2
    error = capsys.readouterr().err
    assert error == f"error: nominal inertia is {value}: give one larger than 0\n"


def test_position_alone_is_not_enough(tmp_path, capsys):
    _, r = log_of(seconds=6.0)
    r.write(tmp_path / "a.csv", drop=("target_position", "velocity", "current_A"))
    assert main([*COMMAND, str(tmp_path / "a.csv")]) == 2
    assert "command or an effort column" in capsys.readouterr().err


def test_of_several_joints_each_is_told_of_when_it_is_begun_and_done() -> None:
    log, _ = log_of(seconds=6.0)
    cut = {n: getattr(log, n)[:5] for n in ("t", "command", "position", "velocity", "effort")}
    short = replace(log, **cut)
    told: list[str] = []
    found = diagnose_robot({"elbow": [log], "wrist": [short]}, tell=told.append, budget=300)
    begun = ["diagnosing elbow (1 of 2)", "diagnosing wrist (2 of 2)"]
    done = ["1 of 2 joints: elbow (none)", "2 of 2 joints: wrist (left out)"]
    assert told == [begun[0], done[0], begun[1], done[1]]
    assert list(found.joints) == ["elbow"] and list(found.left_out) == ["wrist"]


@pytest.mark.long
def test_without_a_command_the_effort_still_speaks(tmp_path):
    log, _ = log_of({"coulomb": {"level": 0.25}})
    bare = Log("bare", log.t + 1.7e9, None, log.position, None, log.effort, "A")
    d = diagnose_logs([bare], nominal={"inertia": 0.1, "viscous": 0.3})
    assert d.verdict == "effect"
    assert d.effects[0].name in {
        "coulomb",
        "load_friction",
        "stribeck",
        "hysteresis",
        "asymmetric_friction",
    }
    assert any("no command, velocity column" in w for w in d.warnings)


def nominal_prediction():
    """A twin, two blocks, the nominal values, and what the twin predicts with them."""
    cleaned = clean(log_of()[0])
    twin = ServoAxis([cleaned], NOMINAL)
    blocks = blocks_of(cleaned)[0][:2]
    values = {p.name: p.nominal for p in twin.parameters}
    return twin, blocks, values, twin.simulate(blocks, values, ())


def test_every_law_vanishes_at_null():
    twin, blocks, values, plain = nominal_prediction()
    for e in twin.effects:
        null = {p.name: p.nominal for p in e.parameters} | dict(e.starts[0]) | {e.magnitude: e.null}
        other = twin.simulate(blocks, {**values, **null}, (e.name,))
        if e.name in ("asymmetric_friction", "stribeck", "load_friction"):
            continue  # their constant part remains, a Coulomb friction
        for a, b in zip(plain, other, strict=True):
            for name in a:
                assert np.allclose(a[name], b[name], atol=1e-6), (e.name, name)


def test_every_start_of_every_effect_changes_something():
    twin, blocks, values, plain = nominal_prediction()
    for e in twin.effects:
        changed = 0.0
        for start in e.starts:
            own = {p.name: p.nominal for p in e.parameters} | dict(start)
            for a, b in zip(
                plain, twin.simulate(blocks, {**values, **own}, (e.name,)), strict=True
            ):
                assert all(np.isfinite(b[n]).all() for n in b), e.name
                changed += sum(float(np.max(np.abs(np.asarray(a[n]) - b[n]))) for n in a)
        assert changed > 0, e.name


def test_library_plant_and_kernel_agree_on_names():
    names = {m.__name__.rsplit(".", 1)[1] for m in LIBRARY}
    assert set(IN_LIBRARY) <= names
    twin = ServoAxis([clean(log_of()[0])], NOMINAL)
    for e in twin.effects:
        assert all(p.name in kernel.INDEX for p in e.parameters), e.name


def test_inverse_dynamics_invert_the_forward_loop():
    """Effort that the loop applies and effort that its motion needs are the same, without and with
    gravity or a spring, before or behind the encoder.
    """
    twin = ServoAxis([clean(log_of()[0])], NOMINAL)
    dt = 0.002
    t = np.arange(0, 4, dt)
    u = 0.8 * np.sin(3 * t) * np.minimum(1, t)
    spring = {"elastic_period": 0.1, "elastic_share": 0.4, "elastic_damping": 0.1}
    behind = spring | {"elastic_output": 1.0}
    for extra in ({}, {"gravity": 0.4, "gravity_angle": 0.5}, spring, behind):
        p = twin.joint.vector(extra)
        q, effort = kernel.forward(u, np.gradient(u, dt), dt, 0.0, 0.0, 0.0, p, kernel.NO_FIELD)
        v = np.gradient(q, dt)
        a = np.gradient(v, dt)
        motion = Readings(q, (q, v, a), dt, 15.0).moved(p).motion
        need = kernel.inverse(*motion, dt, p, kernel.NO_FIELD, effort)[:2].sum(0)
        assert np.max(np.abs(need - effort)[600:-20]) < 0.02 * np.max(np.abs(effort))
