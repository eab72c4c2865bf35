"""Recordings and twins as they come: damaged, sparse, late, failing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import (
    Block,
    Effect,
    GapError,
    Observable,
    Options,
    Parameter,
    Signal,
    check_twin,
    diagnose,
)
from pianobot_ros.gap.fitting.fit import Fitter
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.recordings.spikes import spiked


def edit(block: Block, name: str, change) -> Block:
    s = block.outputs[name]
    t, y = change(s.t.copy(), s.y.copy())
    return replace(block, outputs={**block.outputs, name: Signal(t, y, s.unit)})


def test_epoch_time_stamps():
    assert diagnose(Toy(), recordings(fc=0.1, start=1.7e9)).effects[0].name == "friction"


def test_nan_samples_and_a_missing_signal():
    def holes(t, y):
        y[50:80] = np.nan
        return t, y

    blocks = [edit(b, "f", holes) for b in recordings(fc=0.1)]
    blocks[0] = replace(blocks[0], outputs={"x": blocks[0].outputs["x"]})
    assert diagnose(Toy(), blocks).effects[0].name == "friction"


def test_two_blocks_only():
    d = diagnose(Toy(), recordings(fc=0.1, n=2, conditions=1))
    assert d.verdict == "effect"
    assert any("only 2 block(s)" in w for w in d.warnings)


def test_an_event_that_is_in_one_fold_alone_is_no_crash():
    """Of one strike: without the fold that holds it nothing is judged of the event."""
    problem = Problem(Toy(), recordings(n=1))
    (onset,) = (o for o in problem.present if problem.observables[o].kind == "event")
    (where,) = np.flatnonzero(problem.obs_of == onset)
    kept = problem.of_units(np.arange(problem.n_units) != problem.unit_of[where])
    prediction = problem.predict(problem.nominal(), ())
    noise = NoiseModel.by(problem, problem.y - prediction, Options())
    fitter = Fitter(kept, noise, prediction)
    assert np.isfinite(fitter.refine(fitter.start((), np.zeros(2)), 3, []).cost)


def test_one_block_without_repeats():
    d = diagnose(Toy(), recordings(fc=0.1, n=1))
    assert any("no repeats" in w for w in d.warnings)
    assert d.candidates


def test_constant_signal_is_said():
    blocks = [edit(b, "f", lambda t, y: (t, np.zeros_like(y))) for b in recordings()]
    d = diagnose(Toy(), blocks)
    assert any("constant" in w for w in d.warnings)


def test_duplicate_and_unsorted_stamps():
    def shuffle(t, y):
        t[10] = t[9]
        t[[20, 21]], y[[20, 21]] = t[[21, 20]], y[[21, 20]]
        return t, y

    assert (
        diagnose(Toy(), [edit(b, "f", shuffle) for b in recordings(fc=0.1)]).effects[0].name
        == "friction"
    )


class Failing(Toy):
    """One effect raises, another returns NaN: the rest must still be judged."""

    effects = (
        *Toy.effects,
        Effect("crash", "force", (Parameter("p1", 0, 0, 1, sd=0.3),), ({"p1": 0.5},)),
        Effect("nans", "force", (Parameter("p2", 0, 0, 1, sd=0.3),), ({"p2": 0.5},)),
    )

    def simulate(self, blocks, values, effects):
        if "crash" in effects:
            raise RuntimeError("diverged")
        out = super().simulate(blocks, values, effects)
        if "nans" in effects:
            out = [
                {k: np.full_like(v, np.nan) if k != "onset" else v for k, v in p.items()}
                for p in out
            ]
        return out


class Reticent(Toy):
    """Dry friction that says nothing of the force where the motion is slow."""

    def simulate(self, blocks, values, effects):
        out = super().simulate(blocks, values, effects)
        if "friction" in effects:
            for b, p in zip(blocks, out, strict=True):
                p["f"] = np.where(slow(b), np.nan, p["f"])
        return out


def slow(block: Block):
    return np.abs(np.gradient(block.inputs["u"].y, block.inputs["u"].t)) < 0.4


def test_where_an_effect_says_nothing_the_twin_without_it_stands_in():
    blocks = recordings(n=3)
    problem = Problem(Reticent(), blocks)
    at = np.concatenate([np.flatnonzero(problem.block_of == b) for b in range(3)])
    force = problem.obs_of[at] == [o.name for o in Reticent.observables].index("f")
    silent = at[force][np.concatenate([slow(b) for b in blocks])]
    values = {"k": 1.1, "c": 0.8}
    friction, cubic = {"fc": 0.2}, {"c3": 0.3}
    bare = problem.predict(values, ())
    alone = problem.predict(values | friction, ("friction",))
    np.testing.assert_array_equal(alone[silent], bare[silent])
    assert np.mean(alone == bare) < 0.7
    beside = problem.predict(values | friction | cubic, ("friction", "cubic"))
    other = problem.predict(values | cubic, ("cubic",))
    np.testing.assert_array_equal(beside[silent], other[silent])
    assert np.any(other[silent] != bare[silent])
    np.testing.assert_array_equal(
        np.flatnonzero(problem.silent(values | friction, ("friction",))), np.sort(silent)
    )


def test_an_effect_is_named_though_it_says_nothing_of_some_samples():
    """The nominal twin had stood in there, with parameters that are wrong: 7 floors of them."""
    found = diagnose(Reticent(), recordings(c=0.65, fc=0.05))
    assert [e.name for e in found.effects] == ["friction"]


class Brittle(Toy):
    """A force that is integrated from the measured motion: one missing sample spoils the rest."""

    def simulate(self, blocks, values, effects):
        out = super().simulate(blocks, values, effects)
        for b, p in zip(blocks, out, strict=True):
            p["f"] = p["f"] + 0.0 * np.cumsum(b.outputs["x"].y)
        return out


def test_that_hardly_anything_is_judged_is_told():
    """The answer had been that twin and robot agree, and no word of it."""

    def lose(t, y):
        y[12::50] = np.nan
        return t, y

    said = diagnose(Brittle(), [edit(b, "x", lose) for b in recordings(fc=0.2)]).warnings
    assert any("only these shares are judged: f (3.0 %)" in w for w in said)
    whole = diagnose(Brittle(), recordings(fc=0.2)).warnings
    assert not any("shares are judged" in w for w in whole)


def test_failing_effects_do_not_stop_the_diagnosis():
    d = diagnose(Failing(), recordings(fc=0.1))
    assert d.effects[0].name == "friction"
    assert d.provenance["failed_simulations"] > 0
    assert any("simulations failed" in w and "with" in w for w in d.warnings)
    assert any(
        "the twin cannot simulate" in w for w in check_twin(Failing(), recordings()).warnings
    )


class Silent(Toy):
    """Predicts that the event never happens."""

    def simulate(self, blocks, values, effects):
        return [{**p, "onset": float("nan")} for p in super().simulate(blocks, values, effects)]


def test_event_that_the_twin_lacks_is_a_gap():
    d = diagnose(Silent(), recordings())
    onset = next(s for s in d.signals if s.name == "onset")
    assert onset.gap > 3
    assert d.verdict != "none"


def test_event_that_never_happens_on_either_side_is_fine():
    blocks = [replace(b, events={"onset": float("nan")}) for b in recordings()]
    assert diagnose(Silent(), blocks).verdict == "none"


class Wrong(Toy):
    def simulate(self, blocks, values, effects):
        return [{"x": np.zeros(3)} for _ in blocks]


def test_wrong_shape_is_one_clear_error():
    with pytest.raises(GapError, match="one value per measured sample"):
        diagnose(Wrong(), recordings())


class Stray(Toy):
    observables = (Observable("x", "nowhere", "x"),)


@pytest.mark.parametrize(
    ("twin", "blocks", "match"),
    [
        (Toy(), [], "nothing to diagnose"),
        (Stray(), recordings(n=1), "nowhere"),
        (
            Toy(),
            [Block("b", "c", {}, {"other": Signal(np.arange(5.0), np.arange(5.0))})],
            "no block holds",
        ),
    ],
)
def test_misuse_says_what_to_do(twin, blocks, match):
    with pytest.raises(GapError, match=match):
        diagnose(twin, blocks)


def test_signal_of_unequal_lengths():
    with pytest.raises(GapError, match="equal length"):
        Signal(np.arange(3.0), np.arange(4.0))


def test_parameter_on_its_bound_is_a_warning():
    class Tight(Toy):
        parameters = (replace(Toy.parameters[0], low=0.95, high=1.05), Toy.parameters[1])

    d = diagnose(Tight(), recordings(k=1.4))
    assert any("bound" in w for w in d.warnings)


def test_small_budget_is_honoured_and_said():
    d = diagnose(Toy(), recordings(fc=0.1, d=0.02), budget=200)
    assert any("budget" in w for w in d.warnings)


def test_a_twin_may_have_no_parameters_and_a_library_no_effects():
    class Known(Toy):
        parameters = ()

        def simulate(self, blocks, values, effects):
            return super().simulate(blocks, {"k": 1.0, "c": 0.5, **values}, effects)

    class Bare(Toy):
        effects = ()

    assert diagnose(Known(), recordings()).verdict == "none"
    assert diagnose(Known(), recordings(fc=0.3)).effects[0].name == "friction"
    assert diagnose(Bare(), recordings(c=0.7)).verdict == "parameters"
    assert diagnose(Bare(), recordings(odd=0.3)).verdict == "unknown"
    assert check_twin(Bare(), recordings()).effects == ()
    assert max(e.at_null for e in check_twin(Known(), recordings()).effects) < 1e-9


def stable_up_to(most: float, unstable_at: float = np.inf) -> Toy:
    """A twin that fails above a value of its first parameter, and about another one."""

    class Unstable(Toy):
        def simulate(self, blocks, values, effects):
            if values["k"] > most or abs(values["k"] - unstable_at) < 1e-12:
                raise RuntimeError("unstable")
            return super().simulate(blocks, values, effects)

    return Unstable()


def test_a_parameter_that_cannot_go_up_goes_down():
    """Its derivative is from the other side: it is no parameter that changes nothing."""
    d = diagnose(stable_up_to(1.21), recordings(k=1.2))
    assert d.verdict == "parameters"
    assert d.parameters["k"].value == pytest.approx(1.2, abs=0.02)


def test_a_fold_that_the_twin_cannot_simulate_is_said(monkeypatch):
    seen, predict = [], Problem.predict_blocks
    monkeypatch.setattr(
        Problem,
        "predict_blocks",
        lambda problem, some, values, *rest: (
            seen.append(values["k"]) or predict(problem, some, values, *rest)
        ),
    )
    blocks = recordings(k=1.2)
    diagnose(Toy(), blocks)
    in_a_fold = next(k for k in seen if k != Toy.parameters[0].nominal)
    d = diagnose(stable_up_to(np.inf, in_a_fold), blocks)
    assert d.verdict == "parameters"
    assert any("held-out prediction failed" in w for w in d.warnings)


def test_a_command_with_gaps_is_said():
    blocks = recordings(fc=0.1)
    u = blocks[0].inputs["u"]
    blocks[0] = replace(blocks[0], inputs={"u": Signal(u.t, np.where(u.t == u.t[50], np.nan, u.y))})
    assert any("u is commanded with samples" in w for w in diagnose(Toy(), blocks).warnings)


def test_an_event_that_the_twin_never_predicts_is_no_noise():
    class Deaf(Toy):
        observables = (Toy.observables[0], Observable("hits", "motion", "hits", kind="event"))
        effects = ()

        def simulate(self, blocks, values, effects):
            known = super().simulate(blocks, values, effects)
            return [{"x": p["x"], "hits": np.nan} for p in known]

    d = diagnose(Deaf(), [replace(b, events={"hits": 3.0}) for b in recordings()])
    assert d.verdict == "unknown"


def test_an_experiment_that_cannot_be_simulated_costs_no_diagnosis():
    class Fragile(Toy):
        def simulate(self, blocks, values, effects):
            if any(b.name == "bad" for b in blocks):
                raise RuntimeError("cannot")
            return super().simulate(blocks, values, effects)

    blocks = recordings(fc=0.1)
    bad, good = replace(blocks[0], name="bad"), blocks[1]
    d = diagnose(Fragile(), blocks, experiments=[bad, good])
    assert d.next_experiment["name"] == good.name
    d = diagnose(Fragile(), blocks, experiments=[bad])
    assert d.verdict == "effect"
    assert any("no experiment" in w for w in d.warnings)


def test_long_recordings_are_averaged_in_groups_of_neighbours():
    whole = Problem(Toy(), recordings())
    short = Problem(Toy(), recordings(), Options(max_samples=1000))
    assert short.size < 0.12 * whole.size
    before, after = (p.predict(p.nominal(), ()) for p in (whole, short))
    for c, d in zip(whole.cells, short.cells, strict=True):
        assert len(d.t) == -(-len(c.t) // 10)
        first = slice(c.start, min(c.start + 10, c.stop))
        assert short.y[d.start] == pytest.approx(np.mean(whole.y[first]))
        assert after[d.start] == pytest.approx(np.mean(before[first]))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Options(folds=1), "folds is 1: give at least 2"),
        (lambda: Options(tolerance=-1.0), "tolerance"),
        (lambda: Parameter("a", 1.0, 2.0, 0.0), "low 2 is above high 0"),
    ],
)
def test_numbers_that_cannot_be_meant_are_refused(make, says):
    with pytest.raises(GapError, match=says):
        make()


def test_effects_need_names_of_their_own():
    class Twice(Toy):
        effects = (Toy.effects[0], replace(Toy.effects[1], name="friction"))

    class Answer(Toy):
        effects = (replace(Toy.effects[1], name="none"),)

    for twin, says in ((Twice(), "different names"), (Answer(), "may be called none")):
        with pytest.raises(GapError, match=says):
            diagnose(twin, recordings())


@pytest.mark.parametrize(
    ("blocks", "seed", "says"),
    [
        (recordings()[0], 0, "one Block: give a list"),
        (recordings(), 0.5, "seed is 0.5; give a whole number"),
        (recordings(), -1, "seed is -1; give a whole number"),
    ],
)
def test_what_is_no_list_or_no_seed_is_refused(blocks, seed, says):
    with pytest.raises(GapError, match=says):
        diagnose(Toy(), blocks, seed=seed)


def test_a_parameter_of_a_stage_that_the_twin_lacks_is_refused():
    class Misspelt(Toy):
        parameters = (Toy.parameters[0], replace(Toy.parameters[1], stage="froce"))

    with pytest.raises(GapError, match="c: stage 'froce' is none of the twin's stages"):
        diagnose(Misspelt(), recordings())


class Struck(Toy):
    """A mass that bounces: its force jumps when it lands, which its parameters move."""

    observables = (Observable("f", "force", "f", "N"),)
    parameters = (
        Parameter("late", 1.0, 0.5, 1.5, "s", "force", sd=0.05),
        Parameter("level", 5.0, 1.0, 10.0, "N", "force", sd=0.5),
    )
    effects = ()

    def simulate(self, blocks, values, effects):
        return [{"f": landing(b.outputs["f"].t, **values)} for b in blocks]


def landing(t, late, level):
    """Force (n,): of a spring that is hit at `late`, and lets go a second later."""
    return np.where((t > late) & (t < late + 1.0), level * (1.0 - 0.5 * (t - late)), 0.0)


def test_a_signal_that_jumps_leaves_intervals_that_hold():
    """A jump passes one sample or none over a short step: as a derivative that would fix the
    parameter to a sample.
    """
    held = 0
    for seed in range(8):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 3.0, 0.01)
        truth = {"late": 1.0 + 0.05 * rng.normal(), "level": 5.0 + 0.5 * rng.normal()}
        blocks = []
        for k in range(8):
            own = truth | {"late": truth["late"] + 0.004 * rng.normal()}
            y = landing(t, **own) + 0.05 * rng.normal(size=t.size)
            blocks.append(Block(f"b{k}", "c", {}, {"f": Signal(t + 4.0 * k, y, "N")}))
        blocks = [replace(b, outputs={"f": Signal(t, b.outputs["f"].y, "N")}) for b in blocks]
        d = diagnose(Struck(), blocks)
        held += sum(d.parameters[n].low <= truth[n] <= d.parameters[n].high for n in truth)
    assert held >= 12


def test_stamps_in_another_unit_are_one_clear_error():
    class Grows(Toy):
        def simulate(self, blocks, values, effects):
            return [{"x": np.exp(b.outputs["x"].t)} for b in blocks]

    with pytest.raises(GapError, match="check units and time stamps"):
        diagnose(Grows(), recordings(start=100.0))


@pytest.mark.parametrize(
    ("of", "match"),
    [
        (lambda out, _: iter(out), "returned a list_iterator: give a list, a dict for each block"),
        (lambda out, _: None, "returned a NoneType: give a list"),
        (
            lambda out, blocks: [
                {**p, "x": b.outputs["x"]} for p, b in zip(out, blocks, strict=True)
            ],
            "returned a Signal for x: give an array",
        ),
        (
            lambda out, blocks: [b.outputs["f"].y.__isub__(1.0) for b in blocks] and out,
            "changed f of block b0: let it work on a copy",
        ),
        (
            lambda out, blocks: [b.inputs["u"].y.__isub__(1.0) for b in blocks] and out,
            "changed input u of block b0",
        ),
        (lambda out, blocks: [p["x"] for p in out], "a ndarray for a block: give a dict"),
        (lambda out, blocks: [{"X": p["x"]} for p in out], "what it calls X is no observable's"),
    ],
)
def test_what_simulate_does_wrong_is_one_clear_error(of: Any, match: str) -> None:
    class Wrong(Toy):
        def simulate(self, blocks, values, effects):
            return of(super().simulate(blocks, values, effects), blocks)

    with pytest.raises(GapError, match=match):
        diagnose(Wrong(), recordings(n=6))


@pytest.mark.parametrize(
    ("what", "given", "match"),
    [
        ("stages", ("motion", "force"), "stage 'motion' is a str: give a Stage"),
        ("observables", ("x",), "observable 'x' is a str: give an Observable"),
        ("parameters", (("k", 1.0),), r"parameter \('k', 1.0\) is a tuple: give a Parameter"),
        ("effects", {e.name: e for e in Toy.effects}, "effects are a dict: give a list"),
        ("effects", (e for e in Toy.effects), "effects are a generator: give a list"),
    ],
)
def test_what_a_twin_declares_wrong_is_one_clear_error(what: str, given: Any, match: str) -> None:
    with pytest.raises(GapError, match=match):
        diagnose(type("Wrong", (Toy,), {what: given})(), recordings(n=6))


def test_a_class_is_no_twin() -> None:
    with pytest.raises(GapError, match="is the class Toy: give one of its instances"):
        diagnose(Toy, recordings(n=6))  # type: ignore[arg-type]


SIZE = Parameter("size", 0.0, -5.0, 5.0)


@pytest.mark.parametrize(
    ("parameters", "starts", "match"),
    [
        (SIZE, [{"size": 1.0}], "parameters must be a list, each a Parameter"),
        ([SIZE], {"size": 1.0}, "starts must be a list, each a Mapping"),
        ([SIZE], [0.1], "starts must be a list, each a Mapping"),
        ([SIZE], [{"size": 1.0}, {"size": 0.0}], "leaves size at its null"),
        ([replace(SIZE, nominal=1.0, low=0.1)], [{"size": 1.0}], "its null 0 is outside"),
    ],
)
def test_an_effect_that_no_screening_would_see_is_refused(
    parameters: Any, starts: Any, match: str
) -> None:
    with pytest.raises(GapError, match=match):
        Effect("it", "force", parameters, starts)


def test_a_tolerance_below_nothing_is_refused() -> None:
    with pytest.raises(GapError, match="observable x: tolerance is -1; give 0 or more"):
        replace(Toy.observables[0], tolerance=-1.0)


def test_an_unknown_cause_names_the_effects_that_did_nothing() -> None:
    class Typo(Toy):
        effects = (replace(Toy.effects[0], name="fricton"), *Toy.effects[1:])

    result = diagnose(Typo(), recordings(fc=0.2))
    assert result.verdict == "unknown"
    assert any("no start of fricton changes anything" in w for w in result.warnings)
    assert not any("no start of" in w for w in diagnose(Toy(), recordings(fc=0.2)).warnings)


def test_features_that_fail_spoil_no_diagnosis() -> None:
    class Typo(Toy):
        effects = Toy.effects[1:]

        def features(self, block):
            return {"late": block.outputs["y"]}

    class Arrays(Typo):
        def features(self, block):
            return {"x": block.outputs["x"].y}

    result = diagnose(Typo(), recordings(fc=0.2))
    assert result.verdict == "unknown" and result.unknown is not None
    assert any("features failed in 12 of 12 blocks" in w and "'y'" in w for w in result.warnings)
    with pytest.raises(GapError, match="feature x is a ndarray: give a Signal"):
        diagnose(Arrays(), recordings(n=6))


def test_too_few_predictions_of_some_blocks_are_one_clear_error():
    class Lazy(Toy):
        def simulate(self, blocks, values, effects):
            return super().simulate(blocks, values, effects)[: 12 if len(blocks) == 12 else 1]

    with pytest.raises(GapError, match="predictions for"):
        diagnose(Lazy(), recordings(fc=0.2))


def test_another_unit_than_the_twins_is_told():
    blocks = [
        replace(b, outputs={**b.outputs, "x": Signal(x.t, 1e3 * x.y, "mm")})
        for b in recordings()
        for x in [b.outputs["x"]]
    ]
    warnings = diagnose(Toy(), blocks).warnings
    assert any("x is in mm in 12 of 12 blocks and in m in the twin" in w for w in warnings)
    assert not any("converted" in w for w in diagnose(Toy(), recordings()).warnings)


def disturbed(count: int, conditions: int, which: tuple[int, ...], size: float, fc=0.3):
    """Blocks with friction, of which some were recorded with a fault (something hit the sensor)."""
    blocks = recordings(n=count, fc=fc, conditions=conditions)
    for k in which:
        blocks[k] = edit(blocks[k], "f", lambda t, y: (t, y + size * np.sin(2.3 * t)))
    return blocks


@pytest.mark.parametrize("size", [1.0, 100.0])
@pytest.mark.parametrize("count", [12, 24])
def test_one_faulty_recording_neither_makes_the_floor_nor_a_gap(count: int, size: float):
    """It had been the floor: 'twin and robot agree', at a probability of 1."""
    d = diagnose(Toy(), disturbed(count, 3, (5,), size))
    assert d.verdict == "effect" and d.effects[0].name == "friction"
    assert any(w.endswith("left out: f of b5") for w in d.warnings)
    d = diagnose(Toy(), disturbed(count, 3, (5,), size, fc=0.0))
    assert d.verdict == "none" and "readings of f are far from all others" in d.sentence


def test_what_lies_behind_a_faulty_recording_is_left_out_with_it():
    """The measured motion is spliced in before the force."""
    blocks = recordings(n=24, fc=0.2)
    blocks[5] = edit(blocks[5], "x", lambda t, y: (t, y + 0.5 * np.sin(3 * t)))
    d = diagnose(Toy(), blocks)
    assert d.effects[0].name == "friction" and d.effects[0].probability > 0.9
    assert any(w.endswith("x of b5 with what lies behind it") for w in d.warnings)


def test_more_faulty_recordings_than_chance_makes_are_told_and_count_as_gap():
    d = diagnose(Toy(), disturbed(24, 3, (5, 11), 10.0))
    assert d.verdict == "unknown"
    assert any("f (2 of 24: b5, b11)" in w for w in d.warnings)
    assert any("left of f is in 2 of 24 blocks (b5, b11)" in w for w in d.warnings)


@pytest.mark.parametrize("conditions", [12, 24])
@pytest.mark.parametrize("size", [1.0, 100.0])
def test_a_faulty_recording_of_which_no_repeats_tell_is_told_by_the_hypotheses(conditions, size):
    """It had made *none* the answer, or *unknown*. Of two repeats either may be the faulty one."""
    d = diagnose(Toy(), disturbed(24, conditions, (5,), size))
    assert d.verdict == "effect" and d.effects[0].name == "friction"
    assert d.effects[0].probability > 0.9 and d.gap.closed > 0.8
    assert any(w.endswith("left out: f of b5") for w in d.warnings)
    d = diagnose(Toy(), disturbed(24, conditions, (5,), size, fc=0.0))
    assert d.verdict == "none" and "readings of f are far from all others" in d.sentence


def largest_alone(**options):
    """The diagnosis of blocks of a cubic spring that is bent far enough to show in one of them."""
    random, blocks = np.random.default_rng(0), []
    for k, b in enumerate(recordings(n=24, conditions=24)):
        size = 1.0 if k == 5 else 0.2
        u, x = b.inputs["u"], b.outputs["x"]
        y = size * x.y
        f = 0.5 * y + 0.8 * y**3 + 0.02 * random.normal(size=y.size)
        outputs = {"x": replace(x, y=y), "f": Signal(x.t, f, "N")}
        blocks.append(replace(b, inputs={"u": replace(u, y=size * u.y)}, outputs=outputs))
    return diagnose(Toy(), blocks, options=Options(**options))


def test_an_effect_that_shows_in_a_single_recording_is_no_accident():
    d = largest_alone()
    assert d.verdict == "effect" and d.effects[0].name == "cubic"
    assert not any("left out" in w for w in d.warnings)


def test_what_shows_in_a_single_recording_and_nothing_predicts_is_left_out_and_told():
    d = largest_alone(only=("friction", "delay"))
    assert any("comes back when it is recorded again" in w and "f of b5" in w for w in d.warnings)
    assert "readings of f are far from all others" in d.sentence


def test_of_few_recordings_a_faulty_one_is_told_and_counts_as_gap():
    d = diagnose(Toy(), disturbed(8, 8, (5,), 10.0))
    assert d.verdict == "unknown"
    assert any("left of f is in 1 of 8 blocks (b5)" in w for w in d.warnings)
    d = diagnose(Toy(), disturbed(24, 24, (), 0.0))
    assert not any("left of f" in w for w in d.warnings)


def test_what_may_not_be_named_never_makes_nothing_the_answer():
    """Of two repeats nobody can tell which is the faulty one."""
    d = diagnose(Toy(), disturbed(24, 12, (4, 8), 1.0))
    assert any("f (4 of 24: b4, b8, b16, …)" in w for w in d.warnings)
    assert d.verdict == "unknown"


@pytest.mark.parametrize("size", [50.0, 1e4])
def test_glitches_of_a_sample_neither_make_the_floor_nor_a_gap(size: float):
    """One reading of 500 had made 'none' the answer, at a probability of 1."""
    random = np.random.default_rng(0)

    def glitched(t, y):
        at = random.random(y.size) < 0.002
        y[at] += size * random.choice([-1.0, 1.0], at.sum())
        return t, y

    d = diagnose(Toy(), [edit(b, "f", glitched) for b in recordings(n=24, fc=0.3)])
    assert d.verdict == "effect" and d.effects[0].name == "friction"
    assert any("f leaves the range of all its others" in w for w in d.warnings)
    d = diagnose(Toy(), [edit(b, "f", glitched) for b in recordings(n=24)])
    assert d.verdict == "none"
    assert "readings of f are far from all others" in d.sentence


def test_what_repeats_do_at_the_same_time_is_no_glitch():
    """An impact of one sample is."""

    def struck(at):
        return lambda t, y: (t, y + 5.0 * (np.arange(y.size) == at))

    blocks = [edit(b, "f", struck(200 + k % 2)) for k, b in enumerate(recordings())]
    assert spiked(blocks, "f") == {}
    assert set(spiked([edit(b, "f", struck(50)) for b in blocks[:1]] + blocks[1:], "f")) == {0}


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (-1.0, "with the other sign: check"),
        (1e3, "times the size (steps of a thousand differ so): check"),
        (57.2958, "(degrees and radians differ so)"),
        (-1.0 / 9.80665, "with the other sign and 0.1"),
        (2.0, ""),
    ],
)
def test_another_unit_or_sign_is_told_before_any_effect(factor: float, said: str):
    blocks = [edit(b, "f", lambda t, y: (t, factor * y)) for b in recordings(fc=0.05)]
    found = diagnose(Toy(), blocks).sentence
    assert said in found if said else "before anything else" not in found


def test_what_a_block_holds_is_refused_where_it_is_made() -> None:
    block = recordings(n=1)[0]
    with pytest.raises(GapError, match=r"b0: input u is a ndarray; give a Signal"):
        replace(block, inputs={"u": block.inputs["u"].y})
    with pytest.raises(GapError, match=r"b0: attribute tool is 'A'; give a number"):
        replace(block, attributes={"tool": "A"})
    with pytest.raises(GapError, match=r"b0: event onset is None; give a number \(NaN"):
        replace(block, events={"onset": None})
    with pytest.raises(GapError, match=r"b0: phase p is \(5.0, 1.0\); give when it begins and"):
        replace(block, phases={"p": (5.0, 1.0)})
    with pytest.raises(GapError, match=r"b0: phase p is 5.0; give when it begins and ends"):
        replace(block, phases={"p": 5.0})


def test_blocks_may_be_given_once_and_are_blocks() -> None:
    blocks = recordings(n=6)
    assert diagnose(Toy(), (b for b in blocks)).verdict == diagnose(Toy(), blocks).verdict
    with pytest.raises(GapError, match="block 0 is a str: give a list of Block"):
        diagnose(Toy(), {b.name: b for b in blocks})


def test_names_that_do_not_meet_are_said() -> None:
    class Typo(Toy):
        observables = (
            replace(Toy.observables[0], signal="place"),
            replace(Toy.observables[1], name="force"),
            Toy.observables[2],
        )

    class Spliced(Toy):
        observables = (
            *Toy.observables[:1],
            replace(Toy.observables[1], spliced="y", gain="k"),
        )

    said = "\n".join(diagnose(Typo(), recordings(n=6)).warnings)
    assert "x (no block has its signal 'place')" in said
    assert "no prediction for force; what it calls f is no observable's" in said
    with pytest.raises(GapError, match="the twin has no observable 'y'"):
        diagnose(Spliced(), recordings(n=6))
