"""Fitted values that say that a cause may be missing."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from pianobot_ros.axis.diagnosis.joint import doubtful, far_off, late_positions, scaled
from pianobot_ros.gap.diagnosis import Estimate, FoundEffect
from pianobot_ros.gap.problem.types import Effect, Parameter

VISCOUS = Parameter("viscous", 1.0, 0.01, 100.0, "N m s", sd=1.0, log=True)
OFFSET = Parameter("effort_offset", 0.0, -3.0, 3.0, "N m", sd=0.5)
FIXED = Parameter("integral", 0.0, 0.0, 4.0, sd=1.0)


def notes(**values):
    twin = SimpleNamespace(parameters=(VISCOUS, OFFSET, FIXED))
    held = {n: SimpleNamespace(value=v) for n, v in values.items()}
    return far_off(twin, SimpleNamespace(parameters=held))


@pytest.mark.parametrize(
    "values",
    [
        {"viscous": 1.2, "effort_offset": 0.1, "integral": 0.0},
        {"viscous": 0.08},  # near its lower bound only where the scale is not that of the prior
        {},
    ],
)
def test_values_within_what_was_believed_bring_no_note(values):
    assert notes(**values) == []


@pytest.mark.parametrize(
    ("name", "value", "bound"),
    [("viscous", 0.01, "0.01"), ("viscous", 99.9999, "100"), ("effort_offset", -3.0, "-3")],
)
def test_a_value_on_its_bound_is_said_with_the_bound(name, value, bound):
    (note,) = notes(**{name: value})
    assert note.startswith(f"{name} = ") and f"end of what is allowed ({bound})" in note


def test_a_value_far_from_what_was_believed_is_said():
    (note,) = notes(viscous=95.0)
    assert "5 prior deviations from 1:" in note and "--nominal viscous=" in note


@pytest.mark.parametrize(
    ("delay", "words"),
    [(0.021, "the position alone comes late, by 20 ms"), (0.05, "20 ms after the effort")],
)
def test_a_late_position_is_one_cause_under_two_names(delay, words):
    def effect(name, value):
        estimate = Estimate(value, value - 0.002, value + 0.002, "s")
        return FoundEffect(name, "sensing", 0.94, {name: estimate})

    found = (effect("sensor_latency", -0.02), effect("command_delay", delay))
    (note,) = late_positions(SimpleNamespace(effects=found))
    assert words in note
    assert late_positions(SimpleNamespace(effects=found[1:])) == []


@pytest.mark.parametrize(
    ("gravity", "angle", "inertia", "said"),
    [
        (0.6, 0.1, 0.06, True),
        (0.6, 0.1, 0.0, False),  # a mass close to the axis
        (0.6, 1.2, 0.06, False),  # that hangs elsewhere
    ],
)
def test_a_payload_that_is_a_share_of_all_may_be_the_motor(gravity, angle, inertia, said):
    def about(value, spread):
        return Estimate(value, value - spread, value + spread, "1")

    values = {"payload_gravity": gravity, "payload_angle": angle, "payload_inertia": inertia}
    spread = {"payload_gravity": 0.1, "payload_angle": 0.3, "payload_inertia": 0.03}
    load = {n: about(x, spread[n]) for n, x in values.items()}
    own = {"gravity": about(3.0, 0.1), "gravity_angle": about(0.0, 0.1)}
    own["inertia"] = about(0.28, 0.01)
    found = (FoundEffect("payload", "load", 0.9, load),)
    notes = scaled(SimpleNamespace(effects=found, parameters=own))
    assert [n.startswith("gravity grew by 20%") for n in notes] == ([True] if said else [])
    assert scaled(SimpleNamespace(effects=(), parameters=own)) == []


@pytest.mark.parametrize(("low", "said"), [(0.0, True), (-0.1, True), (0.01, False)])
def test_an_effect_whose_interval_holds_none_of_it_is_said_to_be_doubtful(low, said):
    """A play of 39 µm (0 to 107) had been named at 0.94 without a word."""
    rise = Parameter("rise", 0.0, 0.0, 1.0, "Nm", sd=0.1)
    level = Parameter("level", 0.0, 0.0, 1.0, "Nm", sd=0.1)
    starts = [{"rise": 0.1}]
    law = Effect("rising", "mechanics", [rise, level], starts, remainder=("dry", {"dry": "level"}))
    held = {"rise": Estimate(0.05, low, 0.2, "Nm"), "level": Estimate(0.0, 0.0, 0.1, "Nm")}
    found = SimpleNamespace(effects=[FoundEffect("rising", "mechanics", 0.94, held)])
    notes = doubtful([law], found)
    assert bool(notes) == said
    assert all("rise = 0.05 Nm" in note and "leave dry" in note for note in notes)
