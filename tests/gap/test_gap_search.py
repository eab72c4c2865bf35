"""Fits that stop in the wrong place, or that the shortlist left out, get another chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import (
    Block,
    Calibration,
    Effect,
    Observable,
    Options,
    Parameter,
    Signal,
    Stage,
)
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.fitting.evidence import Evidence, judged_by
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.posterior import decide as decide_module
from pianobot_ros.gap.posterior import judge, probabilities
from pianobot_ros.gap.posterior.decide import decide
from pianobot_ros.gap.posterior.hidden import hidden_odds
from pianobot_ros.gap.posterior.leftover import common_noise
from pianobot_ros.gap.posterior.probabilities import posterior
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.contenders import leaders, open_further, relieves
from pianobot_ros.gap.search.grow import (
    fit_shortlist,
    grow,
    grow_beside_members,
    look_again,
    look_beside,
    look_from_all_starts,
    screen_library,
    screened,
    starts,
)
from pianobot_ros.gap.search.opening import open_evidence
from pianobot_ros.gap.search.parameters import fit_parameters, lower_floor
from pianobot_ros.gap.search.screening import begin, signatures
from pianobot_ros.gap.search.settle import settle
from pianobot_ros.gap.search.study import Entry, Study, gaps, make_entry, put, simulated


def opened(**truth: float) -> Study:
    return fit_parameters(evidence(Toy(), truth))


def evidence(twin: Toy, truth: Mapping[str, float]) -> Evidence:
    return open_evidence(twin, recordings(**truth), 0, Budget(), 1, Options())


def shortlisted(twin: Toy, blocks: Sequence[Block], effect: str) -> Study:
    """With an effect fitted as the shortlist is."""
    study = fit_parameters(open_evidence(twin, blocks, 0, Budget(), 1, Options()))
    base = study.entry("parameters").fit
    assert base is not None
    known = signatures(study.fitter, base, starts(study, [effect]))
    return fit_shortlist(study, base, screened(study, base, known), 1)


def fitted(study: Study, *effects: str, **values: float) -> Study:
    fitter = study.fitter
    fit = fitter.start(effects, fitter.space(effects).encode(study.problem.nominal() | values))
    return put(study, make_entry(study, fitter.refine(fit, 40), settled=True))


def test_what_does_not_depend_on_a_parameter_is_not_moved_by_it() -> None:
    begun = evidence(Toy(), {"k": 1.4, "c": 0.3, "d": 0.02})
    fit = begun.fitter.start((), np.zeros(2))
    far = begun.fitter.refine(fit, 40, [])  # not a derivative was computed anew
    observable = begun.problem.obs_of
    assert np.any(far.jacobian[observable == 0, 0] != fit.jacobian[observable == 0, 0])
    assert not far.jacobian[observable == 1, 0].any()  # the force follows the measured motion
    assert not far.jacobian[observable == 0, 1].any()


def test_what_may_be_named_is_compared_as_simulated() -> None:
    study = fitted(fitted(opened(c3=1.0), "friction", fc=0.1), "cubic", c3=1.0)
    assert not study.entry("friction").simulated
    assert all(e.simulated for e in posterior(study).study.entries)


def test_a_member_of_the_best_pair_that_was_never_tried_alone_is_tried() -> None:
    study = opened(d=0.02)
    study = fitted(study, "friction", "delay", fc=0.05, d=0.01)
    study = settle(study)
    pair, delay = study.entry("friction+delay"), study.entry("delay")
    assert delay.fit is not None
    assert delay.fit.values["d"] < 0.03
    assert delay.score > pair.score - 3.0


def test_beside_a_member_that_a_pair_brought_to_light_more_is_looked_for() -> None:
    study = opened(d=0.02, c3=1.0)
    study = screen_library(study)
    study = fitted(study, "friction", fc=0.05)
    study = fitted(study, "friction", "delay", fc=0.05, d=0.01)
    study = grow_beside_members(study)
    assert {"delay", "cubic"} in [set(e.effects) for e in study.entries]


def test_of_three_effects_one_that_is_no_longer_needed_is_left_out() -> None:
    study = opened(fc=0.3, d=0.02)
    study = fitted(study, "cubic", c3=0.1)
    study = fitted(study, "friction", "delay", "cubic", fc=0.3, d=0.02, c3=0.0)
    assert frozenset({"friction", "delay"}) not in {frozenset(e.effects) for e in study.entries}
    study = settle(study)
    (pair,) = (e for e in study.entries if set(e.effects) == {"friction", "delay"})
    three = study.entry("friction+delay+cubic")
    assert three.fit is not None
    assert pair.fit is not None
    assert pair.fit.cost < three.fit.cost + 2.0
    refused = judge.admit(study).refused
    assert pair.name not in refused
    assert three.name in refused


def test_an_effect_that_another_makes_needless_is_asked_for_before_the_budget_is_spent() -> None:
    """What two effects together explain only in part, a third does with one of them alone."""
    study = opened(fc=0.3, d=0.02)
    study = screen_library(study)
    study = fitted(study, "friction", "cubic", fc=0.3, c3=0.05)
    study = grow(replace(study, options=replace(study.options, max_effects=3)))
    on_the_table = {frozenset(e.effects) for e in study.entries}
    assert frozenset({"friction", "cubic", "delay"}) in on_the_table
    assert frozenset({"friction", "delay"}) in on_the_table


def test_the_best_fit_shares_its_values_with_those_that_stopped_elsewhere() -> None:
    study = opened(k=1.1, d=0.02)
    study = fitted(study, "delay", d=0.01)
    plain = study.entry("parameters")
    assert plain.fit is not None
    far = study.fitter.start((), plain.fit.v + np.array([2.0, -2.0]))
    study = put(study, make_entry(study, far))
    study = settle(study)
    again = study.entry("parameters").fit
    assert again is not None
    assert again.cost < plain.fit.cost + 2.0 < far.cost


def test_what_the_leader_explains_is_no_scatter() -> None:
    """A floor wider than the scatter under the leading hypothesis is taken from that one's
    residual, and the report says so.
    """
    study = opened(n=18, d=0.02)
    study = fitted(study, "delay", d=0.02)
    noise = study.fitter.noise
    motion = study.problem.observables.index(
        next(o for o in study.problem.observables if o.name == "x")
    )
    own = noise.estimates.noises[motion]
    wide = {**noise.estimates.noises, motion: replace(own, white=20 * own.white)}
    noise = NoiseModel(study.problem, Options(), replace(noise.estimates, noises=wide))
    lowered = lower_floor(judged_by(study, noise, study.nominal))
    assert lowered.fitter.noise.floor[motion] < 0.4 * noise.floor[motion]
    assert lowered.gauge.noise is lowered.fitter.noise
    assert any("delay explains" in w for w in lowered.warnings)
    assert lower_floor(lowered) is lowered


def test_what_the_refitted_parameters_hide_is_seen_from_the_nominal_ones() -> None:
    """Parameters that went far to make up for an effect hide its trace from the first screening."""
    study = opened(fc=0.1)
    study = look_again(study)
    leader = max((e for e in study.entries if e.effects), key=lambda e: e.score)
    assert leader.name == "friction"
    again = look_again(study)
    assert again.entries == study.entries, "the leader leaves little: nothing to look for"


class Twofold(Toy):
    """A twin with two names for one law, and a parameter that nothing but its prior holds."""

    effects = (
        *Toy.effects,
        replace(
            Toy.effects[0],
            name="stiction",
            parameters=(replace(Toy.effects[0].parameters[0], name="fs"),),
            starts=({"fs": 0.1}, {"fs": 0.5}),
            magnitude="fs",
        ),
    )

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        same = [e if e != "stiction" else "friction" for e in effects]
        return super().simulate(
            blocks, {**values, "fc": values.get("fs", values.get("fc", 0.0))}, same
        )


def test_relatives_of_the_leader_are_screened_from_where_its_parameters_lie() -> None:
    """A relative that explains as much is fitted too, another law of the stage is not."""
    study = fit_parameters(evidence(Twofold(), {"fc": 0.2}))
    study = fitted(study, "friction", fc=0.2)
    study = look_beside(study)
    assert [e.name for e in study.entries] == ["none", "parameters", "friction", "stiction"]
    assert abs(study.entry("stiction").score - study.entry("friction").score) < 3.0
    study = fitted(study, "friction", "delay", fc=0.2, d=0.01)
    again = look_beside(study)
    assert again.entries == study.entries, "all relatives are there, or a pair leads"


class Rough(Toy):
    """A twin whose stamps may be late as a delay is, and whose answer jitters with every value."""

    parameters = (*Toy.parameters, Parameter("stamp", 0.0, -0.04, 0.04, "s", "motion", sd=0.004))

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = super().simulate(blocks, values, effects)
        for block, prediction in zip(blocks, out, strict=True):
            u = block.inputs["u"]
            prediction["x"] = np.interp(u.t - values["stamp"], u.t, prediction["x"])
            prediction["x"] += 1e-4 * np.sin(1e6 * values["k"] + 1e6 * values["stamp"] + 40 * u.t)
        return out


class Stairs(Toy):
    """A twin whose answer goes in stairs, each as long as a short step of a derivative."""

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        stair = 0.1 * Toy.parameters[0].sd
        k = np.exp(stair * np.round(np.log(values["k"]) / stair))
        return super().simulate(blocks, {**values, "k": float(k)}, effects)


def by_inverse(name: str, stage: str) -> Effect:
    """An effect from a place on, which is declared by the place's inverse."""
    return Effect(name, stage, (Parameter("inv", 0, 0, 5, "1/m", sd=0.5),), ({"inv": 2.0},))


class Limited(Toy):
    """The motion stops at a limit."""

    effects = (by_inverse("limit", "motion"), *Toy.effects)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = super().simulate(blocks, values, effects)
        if "limit" in effects and values["inv"] > 0:
            for one in out:
                one["x"] = np.clip(one["x"], -1 / values["inv"], 1 / values["inv"])
        return out


class Stopped(Toy):
    """A stiff stop beyond an angle."""

    effects = (by_inverse("stop", "force"), *Toy.effects)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = super().simulate(blocks, values, effects)
        if "stop" in effects and values["inv"] > 0:
            for b, one in zip(blocks, out, strict=True):
                one["f"] = one["f"] + beyond(b.outputs["x"].y, 1 / values["inv"])
        return out


def beyond(x: Array, at: float) -> Array:
    """Force (n,) of a stop, N, by the motion x (n,) beyond it, m."""
    return 20.0 * np.sign(x) * np.maximum(np.abs(x) - at, 0.0)


class Ringing(Toy):
    """What moves rings on; the size of that law is its period, a shape as well."""

    effects = (
        Effect(
            "ringing",
            "motion",
            (Parameter("period", 0.0, 0.0, 1.0, "s", sd=0.1),),
            [{"period": 0.05 * 1.5**k} for k in range(7)],
        ),
    )

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = super().simulate(blocks, values, ())
        if "ringing" in effects and values["period"] > 0:
            for block, prediction in zip(blocks, out, strict=True):
                prediction["x"] = prediction["x"] + rung(block.inputs["u"].t, values["period"])
        return out


def rung(t: Array, period: float) -> Array:
    return np.asarray(0.1 * np.exp(-2.0 * t) * np.sin(2.0 * np.pi * t / period))


@pytest.mark.parametrize("period", [0.2, 0.27, 0.45])
def test_a_law_whose_size_is_a_shape_is_fitted_from_all_its_starts(period: float) -> None:
    """A share of such a size is another shape: the line from nothing to it tells nothing."""
    blocks = recordings()
    for b in blocks:
        x = b.outputs["x"]
        x.y[:] += rung(x.t, period)
    study = shortlisted(Ringing(), blocks, "ringing")
    before = study.entry("ringing")
    assert before.fit is not None
    assert abs(before.fit.values["period"] / period - 1.0) > 0.1
    study = look_from_all_starts(study)
    fit = study.entry("ringing").fit
    assert fit is not None
    assert fit.values["period"] == pytest.approx(period, rel=0.01)
    assert look_from_all_starts(study).entries == study.entries, "it leaves little now"


class Crowded(Ringing):
    """The same among laws that do something else, each with two sizes to begin from."""

    effects = (
        *Ringing.effects,
        *(
            Effect(
                f"offset{k}",
                "motion",
                (Parameter(f"offset{k}", 0.0, -1.0, 1.0, "m", sd=0.1),),
                [{f"offset{k}": 0.01}, {f"offset{k}": 0.02}],
            )
            for k in range(4)
        ),
    )

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = super().simulate(blocks, values, effects)
        for block, prediction in zip(blocks, out, strict=True):
            share = block.inputs["u"].t / 4.0
            for k in (k for k in range(4) if f"offset{k}" in effects):
                prediction["x"] = prediction["x"] + values[f"offset{k}"] * share**k
        return out


def test_the_right_law_may_stand_last_where_it_began_from_the_wrong_start() -> None:
    blocks = recordings()
    for b in blocks:
        x = b.outputs["x"]
        x.y[:] += rung(x.t, 0.2)
    study = fit_parameters(open_evidence(Crowded(), blocks, 0, Budget(), 1, Options()))
    for k in range(4):
        study = fitted(study, f"offset{k}", **{f"offset{k}": 0.01})
    study = fitted(study, "ringing", period=0.9)
    assert leaders(study)[3:].index(study.entry("ringing")) >= 0
    fit = look_from_all_starts(study).entry("ringing").fit
    assert fit is not None
    assert fit.values["period"] == pytest.approx(0.2, rel=0.01)


class Eccentric(Toy):
    """What is read of the motion errs as by an eccentric disc, which a gain and an offset resemble
    closely.
    """

    parameters = (*Toy.parameters, Parameter("offset", 0.0, -2.0, 2.0, "m", "motion", sd=0.3))
    effects = (
        Effect(
            "eccentric",
            "motion",
            (
                Parameter("amplitude", 0.0, 0.0, 2.0, "m", sd=0.3),
                Parameter("phase", 0.0, -4.0, 4.0, "rad", sd=3.0),
            ),
            [{"amplitude": 0.1, "phase": phase} for phase in (0.0, 1.57, -1.57)],
        ),
    )

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = super().simulate(blocks, values, ())
        for prediction in out:
            x = prediction["x"] + values["offset"]
            if "eccentric" in effects:
                x = x + values["amplitude"] * np.sin(0.7 * x + values["phase"])
            prediction["x"] = x
        return out


@pytest.mark.parametrize(("amplitude", "phase"), [(0.1, -1.2), (0.3, -1.6), (0.5, 2.0)])
def test_a_fold_is_fitted_by_simulation_where_its_line_leads_out_of_the_valley(
    amplitude: float, phase: float
) -> None:
    """Three parameters that nearly make up for each other lie in a bent valley. The step that a
    line takes along it had left 2 to 11 floors of a law that is exact.
    """
    random = np.random.default_rng(2)
    blocks = recordings()
    for b in blocks:
        x, f = b.outputs["x"], b.outputs["f"]
        clean = 0.6 * b.inputs["u"].y
        clean = clean + amplitude * np.sin(0.7 * clean + phase)
        x.y[:] = clean + 0.002 * random.normal(size=clean.size)
        f.y[:] = 0.5 * clean + 0.02 * random.normal(size=clean.size)
    study = shortlisted(Eccentric(), blocks, "eccentric")
    line = study.entry("eccentric")
    assert line.gap < 1.05
    study = simulated(study, line)
    found = study.entry("eccentric")
    assert np.all(gaps(study, found) < 1.1)
    assert not np.allclose(found.scored.fold_v, line.scored.fold_v)


def test_a_law_that_does_nothing_at_the_size_of_the_linear_fit_begins_where_it_acts() -> None:
    """A limit just within the motion: at a start of half of it the linear fit asks for a small
    share of what that does, and at so small a share of its size the law does nothing.
    """
    blocks = recordings(n=12)
    for b in blocks:
        x = b.outputs["x"]
        x.y[:] = np.clip(x.y, -0.97, 0.97)
    study = fit_parameters(open_evidence(Limited(), blocks, 0, Budget(), 1, Options()))
    base = study.entry("parameters").fit
    assert base is not None
    known = signatures(study.fitter, base, starts(study, ["limit"]))
    (found,) = screened(study, base, known)
    sizes = [f.values["inv"] for f in begin(study.fitter, base, found)]
    assert sizes[0] < 1.0 < sizes[1] < 2.0
    (limit,) = [e for e in fit_shortlist(study, base, [found], 1).entries if e.effects]
    assert limit.fit is not None
    assert 1 / limit.fit.values["inv"] == pytest.approx(0.97, rel=0.02)


def test_a_start_that_acts_far_too_much_is_seen_where_it_acts_as_what_is_left() -> None:
    """A stop that is just reached: where it is met in half of the motion it changes a hundred times
    what there is to explain, at other moments, and its line tells nothing of it.
    """
    blocks = recordings(n=12)
    for b in blocks:
        b.outputs["f"].y[:] += beyond(b.outputs["x"].y, 0.98)
    study = fit_parameters(open_evidence(Stopped(), blocks, 0, Budget(), 1, Options()))
    base = study.entry("parameters").fit
    (found,) = screened(study, base, signatures(study.fitter, base, starts(study, ["stop"])))
    assert 0.9 < 1 / found.start["inv"] < 1.0
    force = [o.name for o in study.problem.observables].index("f")
    assert found.relief[force] > 0.5


def test_a_law_that_acts_in_proportion_begins_once() -> None:
    study = opened(fc=0.1)
    base = study.entry("parameters").fit
    assert base is not None
    (found,) = screened(study, base, signatures(study.fitter, base, starts(study, ["friction"])))
    assert len(begin(study.fitter, base, found)) == 1


def test_a_fit_ends_with_its_own_derivatives_whatever_the_roughness_of_the_twin() -> None:
    study = fit_parameters(evidence(Rough(), {"d": 0.02}))
    fit = study.entry("parameters").fit
    assert fit is not None
    assert fit.values["stamp"] > 0.016
    exact = study.fitter.start((), fit.v).jacobian
    for ours, own in zip(fit.jacobian.T, exact.T, strict=True):
        assert np.linalg.norm(ours - own) < 0.4 * np.linalg.norm(own)


@pytest.mark.parametrize("k", [0.7, 0.85, 1.25, 1.4])
def test_a_fit_goes_on_where_short_differences_see_nothing_but_stairs(k: float) -> None:
    study = evidence(Stairs(), {"k": k})
    fitter = study.fitter
    begun = fitter.start((), np.zeros(2))
    flat = replace(begun, jacobian=0.0 * begun.jacobian)  # as short differences on a stair
    fit = fitter.refine(flat, study.options.max_iterations)
    assert fit.values["k"] == pytest.approx(k, rel=0.02)


def test_relief_is_a_share_of_the_gap_above_the_floor() -> None:
    """Not of whitened squares, most of which are noise: a small gap that an effect closes whole is
    as worth a look as a large one.
    """
    study = opened(d=0.004)
    base = study.entry("parameters").fit
    assert base is not None
    wide = study.gauge.gaps(base.prediction)
    known = signatures(study.fitter, base, starts(study, ["delay", "friction"]))
    found = {s.effect: s for s in screened(study, base, known)}
    o = int(np.nanargmax(wide))
    assert found["delay"].relief[o] > 0.8
    assert found["delay"].relieves([o])
    study = fitted(study, "delay", d=0.004)
    before, after = study.entry("parameters").held_out, study.entry("delay").held_out
    assert relieves(study, before, after)
    assert not relieves(study, before, before)


def test_a_further_effect_must_close_most_of_what_is_plainly_open() -> None:
    """What the first law leaves near the floor is its imprecision; of what it leaves beyond,
    however small beside what it explains, most must go. Where it explains nothing it leaves
    nothing: there a further effect is asked what a single one is.
    """
    study = opened(d=0.02)
    study = fitted(study, "delay", d=0.02)
    study = fitted(study, "friction", "delay", fc=0.1, d=0.02)
    refit, before, after = (study.entry(n) for n in ("parameters", "delay", "friction+delay"))
    floor = 1.0 / study.gauge.noise.normalise(np.ones(study.problem.size))

    def enough(*gaps: tuple[float, float]) -> bool:
        """Where these hypotheses leave so much of motion and force."""
        left = []
        for entry, (motion, force) in zip((refit, before, after), gaps, strict=True):
            each = np.array([motion, force, 1.0])[study.problem.obs_of]
            left.append(replace(entry, held_out=study.problem.y - floor * each))
        return judge._relieves_enough(put(study, left[0]), left[1], left[2])

    c = study.options.calibration
    small = float(np.sqrt(1.0 + 0.5 * (c.material**2 + c.further**2)))
    assert not enough((3.0, 3.0), (1.0, small), (1.0, 1.0))
    assert enough((3.0, small), (1.0, small), (1.0, 1.0))
    trifle = float(np.sqrt(1.0 + 0.5 * c.material**2))
    assert not enough((3.0, trifle), (1.0, trifle), (1.0, 1.0))
    assert enough((9.0, 9.0), (1.0, 3.0), (1.0, 1.5))  # closes 84 %
    assert not enough((9.0, 9.0), (1.0, 3.0), (1.0, 2.5))  # 34 %
    assert enough((9.0, 3.0), (1.0, 3.0), (1.0, 2.5))
    # a law that is off is off in all that it explains: the least of it a single number may follow
    assert not enough((9.0, 9.0), (3.0, 3.0), (3.0, 1.5))
    assert enough((9.0, 9.0), (3.0, 3.0), (1.5, 1.5))
    assert enough((9.0, 3.0), (3.0, 3.0), (3.0, 1.5))


@pytest.mark.parametrize("even", [True, False])
def test_relief_counts_in_the_observable_that_is_surely_predicted_better(even: bool) -> None:
    """The motion is, of which hardly anything goes, and in the force, of which most does, each
    second block is predicted as much worse.
    """
    study = opened(d=0.02)
    study = fitted(study, "delay", d=0.02)
    study = fitted(study, "friction", "delay", fc=0.1, d=0.02)
    before, after = study.entry("delay"), study.entry("friction+delay")
    floor = 1.0 / study.gauge.noise.normalise(np.ones(study.problem.size))

    def leaving(e: Entry, motion: float, force: float, more: Array) -> Entry:
        left = np.array([motion, force, 1.0])[study.problem.obs_of]
        held_out, gap = study.problem.y - floor * left, float(np.hypot(motion, force))
        each = before.scored.each + more
        return replace(e, held_out=held_out, gap=gap, scored=replace(e.scored, each=each))

    more = np.zeros_like(before.scored.each)
    more[:, 0] = 1000.0
    more[:, 1] = 10.0 if even else 10.0 * (-1.0) ** np.arange(len(more))
    refit = leaving(study.entry("parameters"), 3.0, 3.0, -10.0 * np.abs(more))
    first = leaving(before, 3.0, 3.0, 0.0 * more)
    both = leaving(after, 2.9, 1.0, more)
    assert judge._worth_naming(put(study, refit, first, both), both) is even


def test_a_further_effect_is_sure_by_the_precision_of_its_own_law() -> None:
    """It closes the force in every block, in which the first law gains a million nats; of the
    motion, which it does not act on, each second block is predicted a little worse.
    """
    study = fitted(opened(d=0.02), "delay", d=0.02)
    study = fitted(study, "friction", "delay", fc=0.1, d=0.02)
    before, after = study.entry("delay"), study.entry("friction+delay")
    floor = 1.0 / study.gauge.noise.normalise(np.ones(study.problem.size))

    def leaving(e: Entry, force: float, more: Array) -> Entry:
        held_out = study.problem.y - floor * np.array([1.0, force, 1.0])[study.problem.obs_of]
        scored = replace(e.scored, each=before.scored.each + more)
        return replace(e, held_out=held_out, gap=float(np.hypot(1.0, force)), scored=scored)

    more = np.zeros_like(before.scored.each)
    more[:, 0], more[:, 1] = 5.0 * (-1.0) ** np.arange(len(more)), 10.0
    refit = leaving(study.entry("parameters"), 9.0, np.array([0.0, -1e6 / len(more), 0.0]))
    first, both = leaving(before, 3.0, 0.0 * more), leaving(after, 1.0, more)
    assert judge._worth_naming(put(study, refit, first, both), both)


@pytest.mark.parametrize(("odd", "named"), [("k", True), ("c", False)])
def test_odd_parameters_buy_only_what_they_act_on(odd: str, named: bool) -> None:
    """Friction closes what the delay leaves of the force, on which the motion's gain has no effect,
    however far the delay's law drives that.
    """
    study = opened(d=0.02)
    study = fitted(study, "delay", d=0.02)
    study = fitted(study, "friction", "delay", fc=0.1, d=0.02)
    before, after = study.entry("delay"), study.entry("friction+delay")
    floor = 1.0 / study.gauge.noise.normalise(np.ones(study.problem.size))

    def leaving(e: Entry, force: float, more: float) -> Entry:
        left = np.array([2.0, force, 1.0])[study.problem.obs_of]
        each = before.scored.each + np.array([0.0, more, 0.0])
        held_out, scored = study.problem.y - floor * left, replace(e.scored, each=each)
        return replace(e, held_out=held_out, gap=float(np.hypot(2.0, force)), scored=scored)

    refit = leaving(study.entry("parameters"), 3.0, -10.0)
    first, both = leaving(before, 3.0, 0.0), leaving(after, 1.0, 10.0)
    v = both.fit.v.copy()
    v[[p.name for p in study.problem.parameters].index(odd)] += 8.0
    assert judge._worth_naming(put(study, refit, first, both), both)
    far = replace(both, fit=replace(both.fit, v=v))
    assert judge._worth_naming(put(study, refit, first, far), far) is named


@pytest.mark.parametrize("alike", [True, False])
def test_what_explains_one_signal_each_is_told_apart(alike: bool) -> None:
    """Though both gain as much."""
    study = fitted(opened(d=0.02, fc=0.1), "delay", d=0.02)
    study = fitted(study, "friction", fc=0.1)
    one, other = study.entry("delay"), study.entry("friction")
    each = np.zeros_like(one.scored.each)
    each[:, 0] = 10.0
    one = replace(one, scored=replace(one.scored, each=each))
    other = replace(other, scored=replace(other.scored, each=each if alike else each[:, [1, 0, 2]]))
    study = put(study, one, other)
    assert decide_module._inseparable(study, (one, other)) == (
        ((one.name, other.name),) if alike else ()
    )


def test_parameters_that_leave_most_keep_no_weight_beside_an_effect_that_explains_it():
    options = Options(only=("friction",), max_effects=1)
    study = investigate(Toy(), recordings(n=6, fc=0.3), Budget(1000, 60.0), options=options)
    found, refit = study.entry("friction"), study.entry("parameters")
    assert judge.admit(study).admits(found)
    names = [e.name for e in study.entries]
    weight = np.array([0.5 * (n in ("parameters", "friction")) for n in names])
    noise = common_noise(study, (found, refit))
    _, weight, unknown, _ = probabilities._unknown(study, weight, found, [found], noise)
    assert weight.sum() + unknown == pytest.approx(1.0)
    assert weight[names.index("parameters")] < 0.05
    assert weight[names.index("friction")] > 0.9


@pytest.mark.parametrize(("most", "counts"), [(2.0, 2.0), (np.inf, 5.0)])
def test_below_the_floor_as_much_counts_as_the_twin_is_exact_and_odd_parameters_do(
    most: float, counts: float
) -> None:
    """Of effects that may hide where refitting closes the gap."""
    options = Options(calibration=Calibration(below_floor=most))
    study = investigate(Toy(), recordings(k=0.3, c=0.7), Budget(1000, 60.0), options=options)
    study = replace(study, entries=study.entries[:2])

    def odds(fits: float, natural: float) -> float:
        given = tuple(replace(s, gain=fits + natural, natural=natural) for s in study.screened)
        return hidden_odds(study, study.entry("parameters"), given)["cubic"]

    assert odds(5.0, 0.0) == pytest.approx(np.exp(counts) * odds(0.0, 0.0))
    assert odds(0.0, 3.0) == pytest.approx(np.exp(3.0) * odds(0.0, 0.0))
    assert odds(-50.0, 3.0) == odds(0.0, 0.0)  # of no size


@pytest.mark.parametrize(
    ("c3", "most", "named"),
    [(0.03, np.inf, {"delay", "cubic"}), (0.03, 2.0, {"delay"}), (0.0, np.inf, {"delay"})],
)
def test_a_second_effect_may_hide_beside_one_that_leaves_nothing(
    c3: float, most: float, named: set[str]
) -> None:
    """By the same odds as behind parameters that close the gap: of what counts below the floor."""
    options = Options(calibration=Calibration(hidden=8.0, below_floor=most))
    study = investigate(Toy(), recordings(d=0.05, c3=c3), Budget(4000, 60.0), options=options)
    assert gaps(study, study.entry("delay")).max() < 1.03  # nothing is open beside it
    found = decide(posterior(study))
    assert set(found.named) == named


@pytest.mark.parametrize(("stretched", "verdict"), [(1.0, "parameters"), (4.0, "effect")])
def test_an_effect_that_hides_is_named_where_it_is_likelier_than_all_else(
    stretched: float, verdict: str
) -> None:
    study = investigate(Toy(), recordings(k=0.3, c=0.7), Budget(1000, 60.0))
    (cubic,) = (s for s in study.screened if s.effect == "cubic")
    study = put(study, make_entry(study, study.fitter.start(("cubic",), cubic.v)))
    refit = study.entry("parameters")
    assert refit.fit is not None
    odd = replace(refit, fit=replace(refit.fit, v=stretched * refit.fit.v))
    found = decide(posterior(put(study, odd)))
    assert found.verdict == verdict
    assert found.ranked[0][0] == ("cubic" if verdict == "effect" else "parameters")


@pytest.mark.parametrize(("c", "looked"), [(0.5, False), (1.5, True)])
def test_a_further_effect_is_looked_for_where_a_first_one_needs_implausible_parameters(
    c: float, looked: bool
) -> None:
    """As behind refitted ones: parameters may have taken in what another effect does."""
    study = investigate(Toy(), recordings(c=c, d=0.05, c3=0.02), Budget(4000, 60.0))
    assert not open_further(study, study.entry("delay").held_out)
    assert any(len(e.effects) == 2 for e in study.entries) == looked


def test_what_a_further_effect_gains_counts_by_its_own_laws_precision() -> None:
    """A hundred nats are no less for a first law that gains a million in the same signal."""
    study = fitted(opened(d=0.02), "delay", d=0.02)
    study = fitted(study, "friction", "delay", fc=0.1, d=0.02)
    flat = np.zeros_like(study.entry("none").scored.each)

    def gaining(name: str, nats: float) -> Entry:
        each = flat + nats / flat.size
        return replace(e := study.entry(name), scored=replace(e.scored, each=each))

    scores = {"none": 0.0, "parameters": 0.0, "delay": 1e6, "friction+delay": 1e6 + 200.0}
    study = put(study, *(gaining(name, nats) for name, nats in scores.items()))
    weight = dict(zip((e.name for e in study.entries), judge.weigh(study), strict=True))
    assert weight["friction+delay"] > 0.99
    more = put(study, gaining("delay", 1e6 + 200.0))
    weight = dict(zip((e.name for e in more.entries), judge.weigh(more), strict=True))
    assert weight["delay"] > 0.9


class Passing:
    """What runs on by itself past three marks, each of which gives a pulse of force."""

    stages = (Stage("motion"), Stage("force"))
    observables = (
        Observable("x", "motion", "x", "m"),
        Observable("f", "force", "f", "N"),
    )
    parameters = (
        Parameter("speed", 1.0, 0.3, 3.0, "1", "motion", sd=0.1, log=True),
        Parameter("g", 1.0, 0.3, 3.0, "1", "force", sd=0.1, log=True),
    )
    effects = (
        Effect("drag", "motion", (Parameter("d", 0.0, 0.0, 1.0, "1/m", sd=0.05),), ({"d": 0.05},)),
    )

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = []
        for b in blocks:
            x = values["speed"] * b.inputs["u"].y
            x = x / (1.0 + values.get("d", 0.0) * x)
            out.append({"x": x, "f": values["g"] * self.pulses(x)})
        return out

    @staticmethod
    def pulses(x: Array) -> Array:
        marks = np.array([0.3, 0.7, 1.1])
        return 5.0 * np.exp(-(((x[:, None] - marks) / 0.01) ** 2)).sum(1)

    def passed(self, speed: float, g: float) -> list[Block]:
        """Eight recordings, two of each of four speeds."""
        rng = np.random.default_rng(0)
        t = np.arange(0.0, 2.0, 0.005)
        out = []
        for i in range(8):
            u = (0.6 + 0.15 * (i % 4)) * t
            x = speed * u * (1.0 + 0.002 * rng.normal())
            y = x + 0.001 * rng.normal(size=t.size)
            f = g * self.pulses(x) + 0.02 * rng.normal(size=t.size)
            stamps = 3.0 * i + t
            measured = {"x": Signal(stamps, y), "f": Signal(stamps, f)}
            out.append(Block(f"b{i}", f"w{i % 4}", {"u": Signal(stamps, u)}, measured))
        return out


def test_pulses_at_other_moments_do_not_make_a_gain_nothing() -> None:
    """A speed that is 15 % too low misplaces all pulses; fitted with the motion they fit best if
    they are none, and then nothing corrects the speed.
    """
    twin = Passing()
    values = {"speed": 0.85, "g": 1.1}
    study = fit_parameters(open_evidence(twin, twin.passed(**values), 0, Budget(), 1, Options()))
    fit = study.entry("parameters").fit
    assert fit is not None
    assert fit.values == pytest.approx(values, rel=0.03)
