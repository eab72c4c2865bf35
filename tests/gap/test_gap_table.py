"""How sure to be: the table of hypotheses, scaled."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.gap import Calibration, Scaling
from pianobot_ros.gap.posterior.table import (
    Table,
    first_of,
    inclusion,
    likeliest,
    masses_of,
    recalibrated,
    scaled,
    surest,
)

LIBRARY = ("a", "b", "c")
NAMES = (("none",), ("parameters",), ("a",), ("b",), ("a", "c"))


def table(parts: list[float], hidden: dict[str, float]) -> Table:
    share = np.array(parts) / sum(parts)
    return Table(NAMES, share[:-1], float(share[-1]), hidden, LIBRARY)


tables = st.builds(
    table,
    st.lists(st.floats(1e-6, 1.0), min_size=6, max_size=6),
    st.dictionaries(st.sampled_from(LIBRARY), st.floats(0.0, 3.0)),
)
shifts = st.floats(-3.0, 3.0)
scalings = st.builds(Scaling, st.floats(0.2, 5.0), shifts, shifts, shifts)


@given(tables, scalings)
def test_probabilities_stay_probabilities(given: Table, scaling: Scaling) -> None:
    for found in (given, scaled(given, scaling)):
        masses = masses_of(found)
        assert set(masses) == {"none", "parameters", "unknown", *LIBRARY}
        assert sum(masses.values()) == pytest.approx(1.0)
        assert min(masses.values()) >= 0.0


@given(tables)
def test_each_of_two_is_at_work_as_often_as_both_are(given: Table) -> None:
    assert inclusion(given, "unknown") == given.unknown
    alone = masses_of(given)
    assert inclusion(given, "b") == pytest.approx(alone["b"])
    assert inclusion(given, "c") == pytest.approx(alone["c"] + 0.5 * float(given.weight[-1]))


@given(tables)
def test_as_the_scores_say_changes_nothing(given: Table) -> None:
    assert masses_of(scaled(given, Scaling())) == pytest.approx(masses_of(given))
    assert recalibrated(given, Calibration()) is given


@given(tables, scalings)
def test_effects_keep_their_order(given: Table, scaling: Scaling) -> None:
    after = scaled(given, scaling).weight
    assert np.all(np.diff(after[2:][np.argsort(given.weight[2:])]) >= -1e-12)


@given(tables, scalings)
def test_each_group_has_its_own_scaling(given: Table, scaling: Scaling) -> None:
    first = first_of(masses_of(given))
    group = {"none": "quiet", "parameters": "quiet", "unknown": "unknown"}.get(first, "effect")
    others = {g: scaling for g in ("effect", "unknown", "quiet") if g != group}
    assert recalibrated(given, Calibration(scaling=others)) is given
    own = recalibrated(given, Calibration(scaling={group: scaling}))
    assert masses_of(own) == pytest.approx(masses_of(scaled(given, scaling)))


def test_nothing_is_surer_than_the_only_effect_that_explains_all() -> None:
    assert surest(Calibration(mimic=0.06)) == pytest.approx(0.94)
    warier = Calibration(mimic=0.06, scaling={"effect": Scaling(unknown=1.0)})
    assert surest(warier) == pytest.approx(0.94 / (0.94 + 0.06 * np.e))


def test_a_second_effect_is_there_though_it_may_be_one_of_several() -> None:
    beside = [(("a", "b"), 0.3), (("c", "a"), 0.25)]
    assert likeliest([(("a",), 0.4), *beside]) == {"a", "b"}
    assert likeliest([(("a",), 0.6), *beside]) == {"a"}


def test_the_likeliest_effect_is_chosen_first() -> None:
    assert likeliest([(("a",), 0.35), (("b",), 0.3), (("b", "c"), 0.25)]) == {"b"}
    assert likeliest([]) == set()


@given(st.dictionaries(st.frozensets(st.sampled_from(LIBRARY), min_size=1), st.floats(0.0, 1.0)))
def test_what_is_likeliest_is_one_of_the_hypotheses(given: dict[frozenset[str], float]) -> None:
    found = likeliest([(tuple(sorted(names)), w) for names, w in given.items()])
    assert frozenset(found) in given or not given
