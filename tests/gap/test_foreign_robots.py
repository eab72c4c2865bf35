"""The robots of `benchmarks/blind_foreign_robots.py`: a plant without a law agrees with its twin,
and every law of a plant does something.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from foreign_robots.case_table import CASES, ROBOTS
from foreign_robots.drawing import draw_case
from foreign_robots.size_in_floors import floors_of, nominal_values, residuals, rms

from pianobot_ros.gap import Twin, diagnose

each_robot = pytest.mark.parametrize("robot", list(ROBOTS))
"""Their plants are compiled, and are no part of the product: `make test-all` tries them."""


@pytest.mark.long
@each_robot
def test_a_plant_without_a_law_agrees_with_its_twin(robot):
    made = ROBOTS[robot]
    twin = made.twin()
    assert isinstance(twin, Twin)
    values = nominal_values(twin)
    blocks = made.record(values, {}, 1)
    left = residuals(twin, blocks, values)
    floors = floors_of(twin, blocks, left)
    conditions = np.array([b.condition for b in blocks])
    for name, rows in left.items():
        seen = [rows[conditions == c] for c in np.unique(conditions)]
        systematic = np.array([r.mean(axis=0) for r in seen])
        assert rms(systematic) < floors[name], name


@pytest.mark.long
@each_robot
def test_every_law_moves_what_is_measured(robot):
    made = ROBOTS[robot]
    twin = made.twin()
    values = nominal_values(twin)
    without = made.record(values, {}, 2, 1)
    known = {e.name for e in twin.effects}
    for name, law in made.laws.items():
        assert law.family in known or law.family.startswith("unknown:")
        size = law.low**0.25 * law.high**0.75
        blocks = made.record(values, {name: size}, 2, 1)
        moved = [
            rms(b.outputs[o.signal].y - a.outputs[o.signal].y) / o.floor_hint
            for o in twin.observables
            if o.kind == "series"
            for a, b in zip(without, blocks, strict=True)
        ]
        assert max(moved) > 1.0, name


@each_robot
def test_sets_share_no_law_and_name_laws_that_are_there(robot):
    laws = [{law for plan in CASES[s][robot] for law in plan.laws} for s in CASES]
    assert set.union(*laws) <= set(ROBOTS[robot].laws)
    assert not laws[0] & set.union(*laws[1:]), "what is held back has laws of its own"
    assert all(len(CASES[s][robot]) == 12 for s in CASES)


def test_a_case_is_the_same_in_every_draw():
    first, again = (draw_case("dev", "cart", 6) for _ in range(2))
    assert first.truth == {"none"}
    for a, b in zip(first.blocks, again.blocks, strict=True):
        assert all(np.array_equal(s.y, b.outputs[n].y) for n, s in a.outputs.items())


@pytest.mark.long
def test_what_may_not_be_named_does_not_lead():
    """An arm whose parameters alone are wrong: the friction of a joint, which closes nothing that
    refitting leaves, had the largest probability.
    """
    case = draw_case("dev", "arm", 8)
    found = diagnose(case.twin, case.blocks, seed=0)
    assert case.kind == found.verdict == "parameters"
    assert found.candidates[0].name == "parameters"
