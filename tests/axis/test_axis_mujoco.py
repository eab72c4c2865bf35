"""The axis twin on a plant of other laws than its own and than those of the plant that the library
was set on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mujoco_axis import TRUE, log

from pianobot_ros.axis.commissioning.around.stops import stop
from pianobot_ros.axis.diagnosis.joint import diagnose_logs
from pianobot_ros.axis.signals.cleaning import clean

pytestmark = pytest.mark.slow


def diagnosed(seed, **effects):
    rng = np.random.default_rng(seed)
    wrong = {name: value * (1 + rng.uniform(-0.15, 0.15)) for name, value in TRUE.items()}
    return diagnose_logs([log(seed, **effects)], nominal=wrong)


def test_wrong_parameters_alone_are_no_effect():
    assert diagnosed(3).verdict in ("none", "parameters")


def test_a_stop_is_found_where_there_is_one():
    found = stop([clean(log(3, stop=0.3))])
    assert found["end_stop_side"] == 1.0
    assert found["end_stop_angle"] == pytest.approx(0.3, abs=0.02)
    assert stop([clean(log(3))]) == {}


@pytest.mark.long
def test_an_encoder_that_errs_is_named():
    d = diagnosed(1, ripple=0.03)
    assert [e.name for e in d.effects] == ["encoder_ripple"]
    assert d.gap.closed > 0.7


def test_a_spring_is_named_with_its_stiffness():
    """A harness had been gravity and cogging, or hysteresis over most of the travel."""
    (effect,) = diagnosed(2, spring=(0.5, -1.0)).effects
    assert effect.name == "spring"
    for name, true in (("spring", 0.5), ("spring_angle", -1.0)):
        assert effect.parameters[name].low < true < effect.parameters[name].high


@pytest.mark.long
def test_a_stop_is_named_beside_what_its_law_lacks():
    """MuJoCo's stops grow stiffer with their depth."""
    effects = {e.name: e for e in diagnosed(3, stop=0.3).effects}
    assert effects["end_stop"].parameters["end_stop_angle"].value == pytest.approx(0.3, abs=0.01)


@pytest.mark.long
def test_encoders_on_both_sides_show_the_gap():
    (effect,) = diagnose_logs([log(1, gap=0.02, both=True)]).effects
    assert effect.name == "backlash"
    assert effect.parameters["backlash"].value == pytest.approx(0.02, rel=0.2)


@pytest.mark.long
@pytest.mark.parametrize(
    ("seen", "named"),
    [
        (lambda link, t: np.interp(t - 0.004, t, link), []),
        (lambda link, t: 0.0015 * np.round(link / 0.0015), []),
        (lambda link, t: link + 0.002 * np.sin(3 * link + 0.4), ["encoder_ripple"]),
    ],
    ids=["late", "coarse", "erring"],
)
def test_a_rigid_joint_has_neither_spring_nor_gap(seen, named):
    whole = log(2, both=True)
    d = diagnose_logs([replace(whole, link=seen(whole.link, whole.t))])
    assert [e.name for e in d.effects] == named


@pytest.mark.long
def test_a_disturbance_on_its_own_clock_is_unknown_and_described():
    """Answered by the loop, it looks like a shift in time between position and effort."""
    d = diagnosed(2, hum=0.5)
    assert d.verdict == "unknown"
    assert d.unknown is not None and "repeats with time of the session (7.3 Hz)" in d.unknown.text
