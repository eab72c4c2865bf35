"""A law that leaves another one at its `null` is named only where it does more than that one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, Effect, GapError, Options, Parameter, Signal, diagnose
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.posterior import judge
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.twin.special_cases import (
    from_special_case,
    reduced,
    special_cases,
    to_special_case,
)
from pianobot_ros.gap.search.settle import without_one
from pianobot_ros.gap.search.study import Study, make_entry, put, standing, tempered

FALLING = Effect(
    "falling",
    "force",
    (Parameter("rise", 0, -2, 2, "N", sd=0.3), Parameter("base", 0, -2, 2, "N", sd=0.3)),
    ({"rise": 0.2, "base": 0.1}, {"rise": 0.5, "base": 0.5}),
    remainder=("friction", {"fc": "base"}),
)
LIBRARY = {e.name: e for e in (*Toy.effects, FALLING)}


class Falling(Toy):
    """The toy whose friction may fall with speed."""

    effects = (*Toy.effects, FALLING)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ):
        out = super().simulate(blocks, values, effects)
        if "falling" in effects:
            for b, prediction in zip(blocks, out, strict=True):
                if "f" in prediction:
                    v = np.gradient(np.nan_to_num(b.outputs["x"].y), 0.01)
                    size = values["base"] + values["rise"] * np.exp(-((v / 0.5) ** 2))
                    prediction["f"] = prediction["f"] + size * np.tanh(v / 0.05)
        return out


def plant(rise: float) -> list[Block]:
    """Recordings with a friction of 0.3 N that is larger by `rise` (N) near standstill."""
    out = []
    for b in recordings(n=24, k=1.1, c=0.55):
        f = b.outputs["f"]
        v = np.gradient(np.nan_to_num(b.outputs["x"].y), 0.01)
        more = (0.3 + rise * np.exp(-((v / 0.5) ** 2))) * np.tanh(v / 0.05)
        out.append(replace(b, outputs={**b.outputs, "f": Signal(f.t, f.y + more, f.unit)}))
    return out


@pytest.mark.parametrize(("rise", "named"), [(0.0, "friction"), (0.3, "falling")])
def test_the_simpler_law_is_named_where_the_general_one_does_no_more(rise, named):
    d = diagnose(Falling(), plant(rise))
    assert d.verdict == "effect"
    assert d.effects[0].name == named


def test_a_law_that_was_not_asked_for_does_not_come_back():
    d = diagnose(Falling(), plant(0.0), options=Options(only=("falling", "delay")))
    assert "friction" not in {name for h in d.hypotheses for name in h.effects}
    assert d.effects[0].name == "falling"


def test_special_cases_are_told():
    assert special_cases(LIBRARY, ("falling",)) == {frozenset(), frozenset({"friction"})}
    assert special_cases(LIBRARY, ("delay", "falling")) == {
        frozenset(),
        frozenset({"delay"}),
        frozenset({"falling"}),
        frozenset({"friction"}),
        frozenset({"delay", "friction"}),
    }
    assert list(reduced(LIBRARY, ("delay", "falling"))) == [("delay", "friction")]
    assert not list(reduced(LIBRARY, ("friction", "falling")))
    without = {n: e for n, e in LIBRARY.items() if n != "friction"}
    assert special_cases(without, ("falling",)) == {frozenset()}


def test_values_go_both_ways():
    values = {"rise": 0.2, "base": 0.4}
    assert to_special_case(LIBRARY, ("falling",), values)["fc"] == 0.4
    assert from_special_case(LIBRARY, ("falling",), {"fc": 0.7})["base"] == 0.7


def test_a_remainder_of_parameters_that_are_not_there_is_refused():
    with pytest.raises(GapError, match="remainder has parameters that are none of its"):
        replace(FALLING, remainder=("friction", {"fc": "level"}))


STICKY = Effect(
    "sticky", "force", (Parameter("fs", 0, -2, 2, "N", sd=0.3),), ({"fs": 0.1}, {"fs": 0.5})
)


class Alike(Toy):
    """The toy with a second friction that hardly differs."""

    effects = (*Toy.effects, STICKY)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ):
        out = super().simulate(blocks, values, effects)
        for b, prediction in zip(blocks, out, strict=True) if "sticky" in effects else ():
            v = np.gradient(np.nan_to_num(b.outputs["x"].y), 0.01)
            prediction["f"] = prediction["f"] + values["fs"] * np.tanh(v / 0.051)
        return out


@pytest.mark.parametrize(("apart", "possible"), [(0.6, True), (0.99, False)])
def test_a_law_as_good_as_the_one_that_is_named_stays_possible(monkeypatch, apart, possible):
    """It is 97 % sure that it is better than refitting alone, and 97.5 are asked."""
    options = Options(only=("friction", "sticky"), max_effects=1)
    study = investigate(Alike(), recordings(fc=0.3), Budget(), options=options)
    laws = [study.entry(n) for n in ("friction", "sticky")]
    first, second = sorted(laws, key=lambda e: -standing(study, e))

    def sure(_problem, better, worse, _seed):
        of_second = np.array_equal(better, tempered(study, second))
        versus_second = np.array_equal(worse, tempered(study, second))
        return 0.97 if of_second else apart if versus_second else 1.0

    monkeypatch.setattr(judge, "sureness", sure)
    admission = judge.admit(study)
    assert admission.admits(first) and not admission.admits(second)
    assert admission.possible(second) is possible
    weight = dict(zip(study.entries, judge.weigh(study, admission), strict=True))
    assert weight[second] <= weight[first]
    assert bool(weight[second] > 0.1) is possible


def test_what_ended_on_the_way_goes_on_from_where_a_pair_came_to():
    """Friction that had stopped early, and a viscous friction of 0 beside it, had been named at
    0.94 of a stranger's joint.
    """
    study = investigate(Toy(), recordings(fc=0.3), Budget(), options=Options(max_effects=1))
    fitter, end = study.fitter, study.entry("friction").fit

    def stands(study: Study, effects: tuple[str, ...], friction: float) -> Study:
        values = {**study.entry("parameters").fit.values, **end.values, "fc": friction, "d": 0.0}
        return put(
            study, make_entry(study, fitter.start(effects, fitter.space(effects).encode(values)))
        )

    early = stands(stands(study, ("friction",), 0.05), ("friction", "delay"), 0.3)
    before = fitter.cost(early.entry("friction").fit)
    after = fitter.cost(without_one(early, early.entry("friction+delay")).entry("friction").fit)
    assert before > fitter.cost(end) + 10.0
    assert after < fitter.cost(end) + 1.0
