"""A soft servo with dry friction and a load, of which only command and position are known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.around.arm import coupling
from pianobot_ros.axis.commissioning.around.other_joints import Others
from pianobot_ros.axis.commissioning.position_loop import loop
from pianobot_ros.axis.diagnosis.joint import diagnose_joint
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.signals.segment import blocks_of
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.cli.app import main

RATE = 50.0
BANDWIDTH, DAMPING, FRICTION, LOAD = 18.0, 0.8, 0.015, 0.04
"""rad/s; 1; rad and rad of command error."""


def servo(command, load, *, seed=0):
    """Position (n,) of a servo that holds each command for an interval; steps of 0.2 ms."""
    sub = round(1 / RATE / 2e-4)
    q, v = command[0] - load[0], 0.0
    out = np.empty(command.size)
    for i, u in enumerate(command):
        out[i] = q
        for _ in range(sub):
            pull = u - q - 2 * DAMPING / BANDWIDTH * v - load[i]
            if abs(v) < 1e-4 and abs(pull) < FRICTION:
                v = 0.0
                continue
            pull -= FRICTION * np.tanh(v / 1e-3)
            v += 2e-4 * BANDWIDTH**2 * pull
            q += 2e-4 * v
    noise = np.random.default_rng(seed).normal(0, 3e-4, out.size)
    return np.round((out + noise) / 1.5e-3) * 1.5e-3


def motion(seconds=40.0, seed=0):
    t = np.arange(0, seconds, 1 / RATE)
    rng = np.random.default_rng(seed)
    waves = [
        a * np.sin(2 * np.pi * f * t + rng.uniform(0, 6))
        for a, f in ((0.4, 0.07), (0.15, 0.31), (0.05, 1.3))
    ]
    return t, np.sum(waves, axis=0)


@pytest.fixture(scope="module")
def soft():
    t, u = motion()
    q = servo(u, np.full(t.size, LOAD))
    return Log("soft", t, u, q, None, None, joint="soft")


def test_commissioning_finds_loop_friction_and_load_from_motion_alone(soft):
    found = loop([clean(soft)], {}, {}, 1 / RATE, Others())
    assert found["bandwidth"] == pytest.approx(BANDWIDTH, rel=0.3)
    assert found["integral"] == 0.0
    assert found["coulomb"] == pytest.approx(FRICTION, rel=0.25)
    assert found["effort_offset"] == pytest.approx(LOAD, rel=0.25)
    assert 0.0 <= found["command_hold"] <= 1.25 / RATE


def test_friction_is_an_effect_and_no_delay_is_needed(soft):
    cleaned = clean(soft)
    twin = ServoAxis([cleaned])
    blocks, _ = blocks_of(cleaned)
    plain = {p.name: p.nominal for p in twin.parameters}

    def error(values):
        made = twin.simulate(blocks, values, ())
        off = [m["tracking"] - b.outputs["position"].y for m, b in zip(made, blocks, strict=True)]
        return float(np.sqrt(np.nanmean(np.concatenate(off) ** 2)))

    with_friction = error({**plain, "coulomb": FRICTION})
    assert with_friction < 0.5 * error(plain)
    assert error({**plain, "coulomb": FRICTION, "command_delay": 0.04}) > 2 * with_friction


@pytest.mark.long
def test_friction_is_seen_beneath_a_following_error_that_is_lateness():
    """Commands go through a bus that is a tenth of a second late: of 0.2 s of lateness, ten times
    the friction, a share would hide it. Friction closes the gap with a feedforward and a hold of
    commands on their bounds, and the delay that is there makes these plausible.
    """
    t = np.arange(0, 30.0, 1 / RATE)
    u = np.sin(2.0 * t) + 0.4 * np.sin(3.1 * t + 1.0)
    q = servo(np.interp(t - 0.1, t, u), np.zeros(t.size))
    found = diagnose_joint([Log("late", t, u, q, None, None, joint="pan")], budget=20_000)
    assert {e.name for e in found.diagnosis.effects} == {"coulomb", "command_delay"}
    assert any("s after its command" in w for w in found.diagnosis.warnings)


def test_gravity_of_the_next_link_is_found_by_its_angle():
    t, u = motion(seed=1)
    _, other = motion(seed=2)
    load = 0.06 * np.sin(u - other)
    q = servo(u, load)
    logs = [
        Log(
            "arm",
            t,
            u,
            q,
            None,
            None,
            joint="a",
            others={"b": other, "c": 0 * t},
            joints=("c", "a", "b"),
        )
    ]
    assert coupling([clean(x) for x in logs], "a", ("c", "a", "b")) == {"b": -1.0}


def test_a_fitted_twin_predicts_another_log(tmp_path, soft, capsys):
    twin = ServoAxis([clean(soft)])
    from pianobot_ros.axis.laws import kernel

    vector = twin.joint.vector({"coulomb": FRICTION})
    model = {
        "values": {n: float(v) for n, v in zip(kernel.NAMES, vector, strict=True)},
        "arm": {},
        "unit": "rad",
        "effort_unit": twin.joint.scales.effort_unit,
    }
    path = tmp_path / "fitted.json"
    path.write_text(json.dumps({"joint": "", "fitted": model}), encoding="utf-8")
    t, u = motion(20.0, seed=5)
    q = servo(u, np.full(t.size, LOAD), seed=5)
    rows = "\n".join(f"{a:.6f},{b:.6f},{c:.6f}" for a, b, c in zip(t, u, q, strict=True))
    log = tmp_path / "other.csv"
    log.write_text(f"time,command,position\n{rows}\n", encoding="utf-8")
    assert main(["axis", "predict", str(log), "--fitted", str(path), "--json"]) == 0
    (made,) = json.loads(capsys.readouterr().out)["predictions"]
    assert made["position"] < 0.005 < made["following"]
    assert main(["axis", "predict", str(log), "--fitted", str(log)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_block_that_lost_its_position_is_still_simulated(soft):
    """The engine leaves signals out that say nothing, those of a joint at rest among them."""
    cleaned = clean(soft)
    twin = ServoAxis([cleaned])
    block = blocks_of(cleaned)[0][0]
    bare = replace(block, outputs={})
    values = {p.name: p.nominal for p in twin.parameters}
    whole, none = twin.simulate([block, bare], values, ())
    assert np.size(whole["tracking"]) == block.outputs["position"].t.size
    assert none == {}


def slow_bus(late, rate=20.0, bandwidth=12.0, damping=0.9):
    """A log of a loop whose commands come `late` s, on a bus of `rate` Hz."""
    rng = np.random.default_rng(1)
    t = np.arange(0, 60.0, 1 / rate)
    waves = ((0.5, 0.1), (0.25, 0.37), (0.12, 0.9), (0.05, 1.7))
    u = sum(a * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for a, f in waves)
    fine = np.arange(0, 60.0, 1e-3)
    obeyed = u[np.clip(np.floor((fine - late) * rate).astype(int), 0, None)]
    q, v, out = u[0], 0.0, np.empty(fine.size)
    for i, target in enumerate(obeyed):
        out[i] = q
        v += 1e-3 * (bandwidth**2 * (target - q) - 2 * damping * bandwidth * v)
        q += 1e-3 * v
    position = np.interp(t, fine, out) + 2e-4 * rng.standard_normal(t.size)
    return Log("bus", t, u, position, None, None, joint="j")


@pytest.mark.long
def test_a_dead_time_of_a_slow_bus_is_no_low_bandwidth():
    found = loop([clean(slow_bus(0.15))], {}, {}, 0.05, Others())
    assert found["command_delay"] == pytest.approx(0.15, abs=0.02)
    assert found["bandwidth"] == pytest.approx(12.0, rel=0.15)
    assert "command_delay" not in loop([clean(slow_bus(0.0))], {}, {}, 0.05, Others())


def weak(most):
    """A log, 100 Hz, of a loop of 10 rad/s (damping 0.8) whose drive gives `most` N m."""
    t = np.arange(0, 20.0, 0.01)
    k = (t // 2.0).astype(int) % 6
    at = np.array([0.0, 0.8, -0.6, 0.4, -0.8, 0.6])
    share = np.clip((t % 2.0) / 0.5, 0.0, 1.0)
    u = at[k] + (np.roll(at, -1) - at)[k] * share**2 * (3 - 2 * share)
    q, v, out = u[0], 0.0, np.empty((t.size, 2))
    for i, target in enumerate(u):
        for _ in range(20):
            effort = float(np.clip(0.04 * (100.0 * (target - q) - 16.0 * v), -most, most))
            v += 5e-4 * (effort - 0.1 * v) / 0.04
            q += 5e-4 * v
        out[i] = q, effort
    position = out[:, 0] + 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    return Log("weak", t, u, position, None, out[:, 1], "Nm", joint="j")


@pytest.mark.parametrize("most", [100.0, 0.35])
def test_a_drive_that_gives_no_more_is_no_slow_loop(most):
    log = clean(weak(most))
    base = {"inertia": 0.04, "viscous": 0.1}
    found = loop([log], base, {}, 0.01, Others())
    assert found["bandwidth"] == pytest.approx(10.0, rel=0.2)
    assert found["peak"] == pytest.approx(0.72, rel=0.2)
