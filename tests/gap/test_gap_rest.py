"""What named effects leave, and what happens now and then only."""

from __future__ import annotations

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Options, Parameter, Signal, diagnose
from pianobot_ros.gap.explain.conclude import _fit_warnings
from pianobot_ros.gap.explain.describe import LEVEL, _regressed, _words
from pianobot_ros.gap.fitting.dependence import SESSION, Table, regressions, table_of
from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.recordings.features import rate

SLIPS = {2: 1.1, 5: 2.7, 9: 0.6}
"""s of a block at which its motion slips for 60 ms."""


def slipping(fc: float):
    """Blocks of which no two are alike, one after the other."""
    blocks = []
    for i, b in enumerate(recordings(1, 12, fc=fc, conditions=12)):
        x, f, u = b.outputs["x"], b.outputs["f"], b.inputs["u"]
        y = x.y.copy()
        if i in SLIPS:
            begin = round(SLIPS[i] / 0.01)
            y[begin : begin + 6] += 0.4
        force = Signal(x.t + 4.0 * i, f.y + 0.5 * (y - x.y), f.unit)
        seen = {"x": Signal(x.t + 4.0 * i, y, x.unit), "f": force}
        blocks.append(replace(b, outputs=seen, inputs={"u": Signal(u.t + 4.0 * i, u.y, u.unit)}))
    return blocks


def test_what_happens_now_and_then_is_described_by_when():
    d = diagnose(Toy(), slipping(fc=0.0))
    assert d.verdict == "unknown" and d.unknown is not None
    assert "comes in 3 bursts" in d.unknown.text
    assert "at 9.11, 22.7, 36.6 s" in d.unknown.text


@pytest.mark.parametrize("happens", [False, True])
def test_an_event_that_one_side_alone_has_is_told_so(happens):
    """What stands for it in the gap is no time that might be off or depend on anything."""

    class Early(Toy):
        def simulate(self, blocks, values, effects):
            found = super().simulate(blocks, values, effects)
            lost = happens and {"b1", "b4", "b7", "b10"}
            return [
                p | {"onset": np.nan} if lost and b.name in lost else p
                for b, p in zip(blocks, found, strict=True)
            ]

    blocks = recordings()
    if not happens:
        for i in range(1, 12, 3):
            blocks[i] = replace(blocks[i], events={"onset": np.nan})
    d = diagnose(Early(), blocks)
    assert d.verdict == "unknown" and d.unknown is not None
    word = "happened" if happens else "did not happen"
    assert f"onset is mostly that it {word} in 4 of 12 blocks (b1, b4, b7, …)" in d.sentence


def test_what_a_named_effect_leaves_of_another_signal_is_said():
    d = diagnose(Toy(), slipping(fc=0.5))
    assert [e.name for e in d.effects] == ["friction"]
    assert "No effect of the library explains the rest: " in d.sentence
    assert " floors of x; it comes in 3 bursts" in d.sentence


def test_what_no_further_effect_was_asked_of_is_not_said_to_be_outside_of_the_library():
    d = diagnose(Toy(), slipping(fc=0.5), options=Options(max_effects=1))
    assert [e.name for e in d.effects] == ["friction"]
    assert "The rest was asked of no further effect: " in d.sentence
    assert "No effect of the library" not in d.sentence


def test_nothing_remains_where_an_effect_explains_all():
    d = diagnose(Toy(), recordings(1, 12, fc=0.5))
    assert [e.name for e in d.effects] == ["friction"] and "the rest" not in d.sentence


def test_a_level_that_nothing_repeats_is_no_course_of_the_session():
    """All of it is what repeats have not in common, its level too; half of it is noise."""
    rng, t = np.random.default_rng(0), np.arange(400.0)
    off = 1.0 + 0.5 * rng.normal(size=400)
    table = Table(off, np.repeat(np.arange(20), 20), {SESSION: (t, "s")}, None, off)
    found = sorted(_regressed(table, "N"), key=lambda d: -d.explained)
    assert found[0].feature == LEVEL
    assert all(d.explained < 0.1 for d in found[1:])


def test_one_clock_by_two_names_is_told_once():
    rng, t = np.random.default_rng(0), np.arange(200.0)
    features = {
        SESSION: (t, "s"),
        "clock": (3.0 * t + 1.0, ""),
        "load": (rng.normal(size=200), "N"),
    }
    x = 0.1 * t + rng.normal(size=200)
    table = Table(x, np.repeat(np.arange(20), 10), features, None, x)
    told = [d.feature for d in _regressed(table, "m") if not d.feature.endswith("folded")]
    assert "load" in told and len({SESSION, "clock"} & set(told)) == 1


def test_how_far_directions_are_apart_is_told_where_both_pass():
    """On average over what only one of them passes, or over what has the other sign elsewhere, it
    would be nothing.
    """
    rng, way = np.random.default_rng(0), np.tile(np.repeat([1.0, -1.0], 40), 10)
    x = np.tile(np.concatenate([np.linspace(0, 1, 40), np.linspace(1, 0, 40)]), 10)
    features = {"position": (x, "m")}
    noise, group = 0.001 * rng.normal(size=x.size), np.repeat(np.arange(10), 80)

    def told(residual):
        y = residual + noise
        (first, *_) = _regressed(Table(y, group, features, way, y), "N")
        return first.text

    assert "(on average 2 N apart between directions)" in told(way)
    twisted = told(2.0 * way * np.cos(np.pi * x))
    assert "(up to " in twisted
    assert 3.0 < float(twisted.split("up to ")[1].split(" N")[0]) < 4.0


@pytest.mark.parametrize(("hertz", "told"), [(None, "in step with the blocks"), (1.37, "1.37 Hz")])
def test_what_each_block_does_more_and_more_is_no_line(hertz, told):
    """Of a motor that warms up while a program plays every 5 s repeats differ as by a line that is
    half a turn out of step over the session.
    """
    t = np.concatenate([5.0 * k + np.arange(0.0, 4.0, 0.04) for k in range(16)])
    group = np.repeat(np.arange(16), 100)
    pattern = (t / 40.0 - 1.0) * np.sin(2 * np.pi * 0.8 * t)
    residual = pattern if hertz is None else np.sin(2 * np.pi * hertz * t)
    residual = residual + 0.01 * np.random.default_rng(0).normal(size=t.size)
    table = Table(residual, group, {SESSION: (t, "s")}, None, residual)
    best = max(_regressed(table, "N"), key=lambda d: d.explained)
    assert told in best.text


def test_noise_comes_in_no_bursts():
    blocks = recordings(1, 12, conditions=12)
    rng = np.random.default_rng(0)
    walks = [np.cumsum(0.02 * rng.standard_normal(400)) for _ in blocks]
    far = [
        replace(b, outputs={**b.outputs, "x": Signal(b.outputs["x"].t, b.outputs["x"].y + w, "m")})
        for b, w in zip(blocks, walks, strict=True)
    ]
    d = diagnose(Toy(), far)
    assert "bursts" not in d.sentence


@pytest.mark.parametrize(("size", "least", "most"), [(0.0, 0, 3), (2.0, 28, 30)])
def test_a_wave_is_seen_where_it_is_and_not_in_noise(size, least, most):
    """Its frequency is held out, too: of the many that are tried one goes with any noise."""
    rng, seen = np.random.default_rng(0), 0
    for _ in range(30):
        x, group = np.sort(rng.uniform(size=60)), np.repeat(np.arange(5), 12)
        residual = size * np.sin(2 * np.pi * 7.3 * x) + rng.normal(size=60)
        found = regressions(Table(residual, group, {"position": (x, "m")}, None, residual))
        seen += max(r.explained for r in found) > 0.08
    assert least <= seen <= most


def test_what_all_repeats_have_in_common_is_no_line_of_the_session():
    """With equal pauses it comes back with each cycle of the moves."""

    def at(signals, start):
        return {n: Signal(s.t + start, s.y, s.unit) for n, s in signals.items()}

    blocks = [
        replace(b, inputs=at(b.inputs, 5.0 * i), outputs=at(b.outputs, 5.0 * i))
        for i, b in enumerate(recordings(n=15, odd=0.3))
    ]
    problem = Problem(Toy(), blocks)
    force = [o.name for o in problem.observables].index("f")
    table = table_of(problem, problem.predict(problem.nominal(), ()), force)
    found = {r.feature: r.explained for r in regressions(table)}
    assert found[SESSION] < 0.1
    assert found["x"] > 0.5


@pytest.mark.parametrize("conditions", [2, 3, 4, 5, 7, 10])
@pytest.mark.parametrize("samples", [1, 20])
def test_what_tells_conditions_apart_is_seen_however_many_there_are(conditions, samples):
    """Folds in step with the moves would each hold whole conditions. Events count, too."""
    kind = np.tile(np.arange(conditions), 20 // conditions + 1)[:20]
    group = np.repeat(np.arange(20), samples)
    mass = kind[group].astype(float)
    residual = mass - mass.mean() + 0.1 * np.random.default_rng(0).normal(size=mass.size)
    first = next(
        iter(regressions(Table(residual, group, {"mass": (mass, "kg")}, None, residual))), None
    )
    assert first is not None and first.explained > (0.6 if samples == 1 else 0.9)


def test_a_rate_is_that_of_the_stamps_in_order():
    t = np.arange(100) * 0.01
    swapped = np.r_[t[:50], t[51], t[50], t[52:]]
    assert np.allclose(rate(Signal(swapped, 3.0 * swapped)), 3.0)


def test_a_part_of_a_law_that_is_not_there_is_on_no_bound():
    """A payload of no weight (a joint that turns level) was called the sign of a missing effect."""
    parameters = [
        Parameter("weight", 0.0, 0.0, 3.0, "Nm", sd=0.1),
        Parameter("reach", 0.0, 0.0, 3.0, "m", sd=0.1),
    ]
    space = Space(parameters)
    values = {"weight": 0.0, "reach": 3.0}
    fit = SimpleNamespace(space=space, v=space.encode(values), values=values)
    budget = SimpleNamespace(struck=False, failures=0)
    study = SimpleNamespace(problem=SimpleNamespace(budget=budget))
    (said,) = _fit_warnings(study, SimpleNamespace(name="payload", fit=fit))
    assert said.endswith(": reach")


def test_a_course_is_put_into_words_however_far_from_zero_it_is():
    """NumPy had warned of a badly conditioned parabola, on the user's terminal."""
    x = 1.7e9 + np.linspace(0.0, 1.0, 8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        said = _words("time", "s", "m", x, 3.0 * (x - x.mean()) ** 2)
    assert said.startswith("is lowest near time = 1.7e+09 s and rises to both sides")
