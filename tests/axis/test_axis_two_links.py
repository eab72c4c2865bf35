"""An arm whose links share inertia: nothing is carried where nothing was added, and a mass is named
with its size.
"""

from __future__ import annotations

import pytest
from two_links import FIRST, REACH, shoulder

from pianobot_ros.axis.diagnosis.joint import diagnose_joint
from pianobot_ros.axis.log import Log
from pianobot_ros.gap import Diagnosis

pytestmark = pytest.mark.slow
G = 9.81


@pytest.fixture(scope="module")
def reference() -> Log:
    return shoulder(1)


def since(reference: Log, log: Log) -> Diagnosis:
    return diagnose_joint([log], reference=[reference], budget=16_000).diagnosis


@pytest.mark.long
def test_what_the_elbow_draws_is_the_same_in_every_log(reference: Log) -> None:
    """With each log's own share of it the shoulder seemed to carry a load that nobody had added."""
    found = since(reference, shoulder(2))
    assert found.verdict in ("none", "parameters"), found.sentence


@pytest.mark.long
def test_a_mass_at_the_tip_is_named_with_its_size(reference: Log) -> None:
    mass = 0.3
    (effect,) = since(reference, shoulder(3, mass)).effects
    assert effect.name == "payload"
    values = {n: p.value for n, p in effect.parameters.items()}
    assert values["payload_gravity"] == pytest.approx(mass * G * REACH, rel=0.15)
    assert values["payload_own"] == pytest.approx(mass * G * FIRST, rel=0.15)


@pytest.mark.long
def test_more_friction_than_in_the_reference_is_another_value(reference: Log) -> None:
    """And not another law of friction for sure."""
    found = since(reference, shoulder(4, friction=1.2))
    assert found.parameters["coulomb"].value == pytest.approx(1.2, rel=0.15)
    friction = ("stribeck", "load_friction", "asymmetric_friction", "hysteresis")
    assert sum(c.probability for c in found.candidates if c.name in friction) < 0.2
