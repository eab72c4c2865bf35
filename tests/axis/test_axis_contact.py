"""An arm that is pressed on a table: the limit is found, and what it explains is no friction."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.around.contact_limit import find
from pianobot_ros.axis.laws.kernel import NAMES
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.signals.segment import blocks_of
from pianobot_ros.axis.twin.fitted import predict
from pianobot_ros.axis.twin.servo_axis import ServoAxis

RATE, FRICTION = 50.0, 0.01
LIMIT, FIRST, SECOND = 0.5, -0.6, -0.25
NAMES_OF_JOINTS = ("base", "shoulder", "elbow", "wrist")


def moves(seed, seconds, size):
    """Smooth moves between random angles."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / RATE)
    knots = np.arange(0, seconds + 2.0, 1.0)
    goals = np.repeat(rng.uniform(-size, size, knots.size // 2 + 1), 2)[: knots.size]
    share = (t / 3.0) % 1.0
    ease = share**2 * (3 - 2 * share)
    k = (t / 3.0).astype(int)
    return t, goals[k] + ease * (goals[k + 1] - goals[k])


def arm(seed, seconds=120.0, table=True):
    """A log of the shoulder of an arm whose elbow and wrist shift where the table is."""
    t, u = moves(seed, seconds, 0.6)
    _, elbow = moves(seed + 100, seconds, 0.5)
    _, wrist = moves(seed + 200, seconds, 0.5)
    limit = LIMIT + FIRST * elbow + SECOND * wrist
    q, v, h = u[0] if not table else min(u[0], limit[0]), 0.0, 1 / RATE / 10
    out = np.empty(t.size)
    for i in range(t.size):
        out[i] = q
        for _ in range(10):
            force = 20.0**2 * (u[i] - q) - 2 * 0.8 * 20.0 * v
            if table:
                force -= 20.0**2 * 5.0 * max(q - limit[i], 0.0)
            brake = 20.0**2 * FRICTION * h
            free = v + h * force
            v = np.sign(free) * max(abs(free) - brake, 0.0)
            q += h * v
    out += 3e-4 * np.random.default_rng(seed).standard_normal(t.size)
    others = {"base": 0 * t, "elbow": elbow, "wrist": wrist}
    return Log(
        "a", t, u, out, None, None, "", (), "shoulder", others=others, joints=NAMES_OF_JOINTS
    )


@pytest.fixture(scope="module")
def cleaned():
    return clean(arm(0))


def test_the_limit_and_its_slopes_are_found(cleaned):
    found = find([cleaned], "shoulder", NAMES_OF_JOINTS)
    assert found is not None
    assert found.side == 1.0
    assert found.limit == pytest.approx(LIMIT, abs=0.07)  # the table gives way a little
    assert dict(found.slopes) == pytest.approx({"elbow": FIRST, "wrist": SECOND}, abs=0.06)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_friction_alone_is_no_contact(seed):
    assert find([clean(arm(seed, table=False))], "shoulder", NAMES_OF_JOINTS) is None


@pytest.mark.long
def test_it_is_part_of_the_twin_and_holds_in_a_log_that_was_not_fitted(cleaned):
    twin = ServoAxis([cleaned])
    assert "contact" in {p.name for p in twin.parameters}
    values = {"coulomb": FRICTION}
    blocks = blocks_of(cleaned)[0]

    def error(values):
        made = twin.simulate(blocks, values, ())
        off = [m["tracking"] - b.outputs["position"].y for m, b in zip(made, blocks, strict=True)]
        return float(np.sqrt(np.nanmean(np.concatenate(off) ** 2)))

    assert error(values) < 0.4 * error({**values, "contact": 0.0})
    vector = zip(NAMES, twin.joint.vector(values), strict=True)
    model = {
        "values": dict(vector),
        **twin.joint.others.to_json(),
        "unit": "rad",
        "effort_unit": "",
    }
    assert predict(model, arm(7)).position < 0.02
