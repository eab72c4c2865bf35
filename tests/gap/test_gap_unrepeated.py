"""What may be noise where nothing repeats, and lines whose phase is another in each block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, Options, Signal, diagnose
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.fitting.dependence import (
    SESSION,
    Table,
    explained_share,
    recurrent_share,
    regressions,
    table_of,
)
from pianobot_ros.gap.floor.session.hum import _spectrum, unphased_lines
from pianobot_ros.gap.floor.unrepeated import noise_share, uneven
from pianobot_ros.gap.posterior import leftover
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.constants import LOBE, PIECES
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.search.study import gaps

Row = tuple[np.ndarray, np.ndarray]


@pytest.mark.parametrize("count", [4, 12])
def test_the_most_uneven_noise_is_a_random_walk(count: int) -> None:
    """Half of all sets of walks are more uneven than their median, and passed for a gap."""
    rng = np.random.default_rng(1)
    walks = np.cumsum(rng.normal(size=(400, count, 10 * PIECES)), axis=2)
    pieces = (walks**2).reshape(400, count * PIECES, -1).mean(2)
    ratios = pieces.mean(1) / np.median(pieces, axis=1)
    assert 0.01 < np.mean(ratios > uneven(count)) < 0.1


def unlike(
    of: Callable[[np.random.Generator, np.ndarray], np.ndarray], n: int = 12
) -> tuple[Problem, float]:
    """Motions of which none is like another, with something in the force, and the share of the
    force's residual that may be noise.
    """
    rng, blocks = np.random.default_rng(2), recordings(n=n, conditions=n)
    for b in blocks:
        b.outputs["f"].y[:] += of(rng, b.outputs["f"].t)
    problem = Problem(Toy(), blocks)
    at = problem.predict(problem.nominal(), ())
    cells = [c for c in problem.cells if c.observable == 1]
    dependent = explained_share(problem, at, 1)
    return problem, noise_share(problem, cells, problem.y - at, dependent)


def wind(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    x = np.zeros(t.size)
    for i in range(1, t.size):
        x[i] = 0.97 * x[i - 1] + 0.006 * rng.normal()
    return x


def test_a_wind_may_be_noise_a_knock_and_a_ripple_may_not() -> None:
    assert unlike(wind)[1] > 0.9
    assert unlike(lambda _, t: 0.5 * np.exp(-(((t - t[0] - 2.0) / 0.1) ** 2)))[1] < 0.2
    assert unlike(lambda _, t: 0.2 * np.sin(20.0 * (t - t[0])))[1] < 0.2
    assert unlike(lambda rng, t: 10.0 * wind(rng, t))[1] < 0.2, "no machine repeats as badly"


def test_a_wind_on_motions_that_are_not_repeated_is_no_unknown_cause() -> None:
    rng, blocks = np.random.default_rng(3), recordings(n=12, conditions=12)
    for b in blocks:
        b.outputs["f"].y[:] += wind(rng, b.outputs["f"].t)
    found = diagnose(Toy(), blocks)
    assert found.verdict in ("none", "parameters")
    assert max(s.gap for s in found.signals) > 1.3
    assert "passes for noise" in found.sentence


def test_walks_of_a_few_motions_may_be_noise() -> None:
    """Of half of them a part could not, up to 30 %: one went further than the median of walks, or
    along some feature by chance.
    """

    def walk(seed: int) -> Callable[[np.random.Generator, np.ndarray], np.ndarray]:
        rng = np.random.default_rng(seed)
        return lambda _, t: 0.001 * np.cumsum(rng.normal(size=t.size))

    shares = np.array([unlike(walk(seed), n=5)[1] for seed in range(12)])
    assert np.mean(shares > 0.99) > 0.8


@pytest.mark.parametrize("of_rest", [1.0, 0.0])
def test_noise_is_the_same_for_all_hypotheses(
    monkeypatch: pytest.MonkeyPatch, of_rest: float
) -> None:
    """Of what refitting leaves all may be noise, by itself: beside it any rest was unknown, and
    refitting lacked nothing where a law that closes half of the gap leaves some that is no noise.
    """
    blocks = recordings(n=6, conditions=6, fc=0.3)
    study = investigate(Toy(), blocks, Budget(), options=Options(only=("friction",)))
    refit, found = (study.entry(n) for n in ("parameters", "friction"))
    half = 0.5 * (refit.held_out + found.held_out)
    found = replace(found, held_out=half)
    monkeypatch.setattr(leftover, "_noise", lambda _, e, __: of_rest if e is found else 1.0)
    before, after = (np.maximum(gaps(study, e)[1] ** 2, 1.0) for e in (refit, found))
    assert before - after > 1.0
    assert leftover.excess(study, refit)[1] == 0.0
    noise = leftover.common_noise(study, (refit, found))
    left = before - after if of_rest else before - 1.0
    assert leftover.excess(study, refit, noise)[1] == pytest.approx(left)
    alone = leftover.common_noise(study, (refit,))
    assert leftover.excess(study, refit, alone)[1] == pytest.approx(0.0)
    assert leftover.excess(study, found, noise)[1] <= leftover.excess(study, refit, noise)[1]


def test_what_one_block_alone_goes_along_is_not_sure() -> None:
    rng, x = np.random.default_rng(0), np.tile(np.linspace(0.0, 1.0, 100), 6)
    size = np.repeat([1.0, 1.0, 1.0, 1.0, 1.0, 6.0], 100)
    group = np.repeat(np.arange(6.0), 100)

    def told(residual: np.ndarray) -> tuple[float, float]:
        (found,) = regressions(Table(residual, group, {"x": (x, "")}, None, residual))
        return found.explained, found.surely

    noise = rng.normal(size=x.size)
    explained, surely = told(np.sin(9.0 * x) * size + noise)
    assert explained > 0.05 > surely
    explained, surely = told(np.sin(9.0 * x) + noise)
    assert explained > surely > 0.2


def test_what_is_left_of_a_signal_may_depend_on_that_signal() -> None:
    """As what a heater radiates does on its temperature, which nothing else tells. By what was
    measured noise would, too.
    """

    class Alone(Toy):
        observables = (replace(Toy.observables[0], name="x"),)

    def left(of: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> float:
        rng, blocks = np.random.default_rng(5), []
        for b in recordings(3, n=8, conditions=8):
            x = b.outputs["x"]
            slow = np.repeat(rng.normal(size=x.t.size // 20 + 1), 20)[: x.t.size]
            u = replace(b.inputs["u"], y=np.cumsum(slow) * 0.05)  # no state comes back
            x = replace(x, y=of(u.y, rng))
            blocks.append(replace(b, inputs={}, outputs={"x": x}, attributes={"u": 0.0}))
            drive[b.name] = u.y
        problem = Problem(Alone(), blocks)
        return explained_share(problem, problem.predict(problem.nominal(), ()), 0)

    drive: dict[str, np.ndarray] = {}

    def simulate(self: Toy, blocks: list[Block], values: object, effects: object) -> list:
        return [{"x": drive[b.name]} for b in blocks]

    Alone.simulate = simulate  # type: ignore[method-assign,assignment]
    assert left(lambda u, rng: u + 0.2 * u**2 + 0.01 * rng.normal(size=u.size)) > 0.5
    assert left(lambda u, rng: u + 0.3 * rng.normal(size=u.size)) < 0.05


def test_what_is_left_may_depend_on_what_was_commanded_whatever_is_offered() -> None:
    """As what a late command leaves does, of which what was measured tells nothing."""

    class Offering(Toy):
        def features(self, block: Block) -> dict[str, Signal]:
            return {"place": block.inputs["u"], "force": block.outputs["f"]}

    class Silent(Toy):
        def features(self, block: Block) -> dict[str, Signal]:
            return {"force": block.outputs["f"]}

    late = [
        replace(
            b, outputs=b.outputs | {"f": replace(f, y=np.random.default_rng(k).normal(size=400))}
        )
        for k, b in enumerate(recordings(n=8, conditions=8, d=0.05))
        for f in (b.outputs["f"],)
    ]
    for twin, names in ((Silent(), {"u", "rate of u"}), (Offering(), set())):
        problem = Problem(twin, late)
        prediction = problem.predict(problem.nominal(), ())
        table = table_of(problem, prediction, 0)
        assert {n for n in table.features if "u" in n.split()} == names
        assert table.drive == names
        assert (explained_share(problem, prediction, 0) > 0.5) == bool(names)


def both(amplitude: float) -> list[Block]:
    """Motions of which none is like another; a force goes with position and speed together, and
    with none of both alone.
    """
    blocks = recordings(3, n=12, conditions=12)
    for b in blocks:
        t, w = b.outputs["f"].t, b.attributes["rate"]
        x, v = np.sin(w * t), w * np.cos(w * t)
        b.outputs["f"].y[:] += amplitude * np.sin(5 * x) * np.sin(1.5 * v)
    return blocks


def test_a_state_that_comes_back_is_a_repeat() -> None:
    problem = Problem(Toy(), both(0.06))
    at = problem.predict(problem.nominal(), ())
    table = table_of(problem, at, 1)
    assert max(r.explained for r in regressions(table)) < 0.1
    assert recurrent_share(table).surely > 0.1
    assert diagnose(Toy(), both(0.08)).verdict == "unknown"


@pytest.mark.parametrize("back", [True, False])
def test_noise_is_not_told_by_states_that_come_back(back: bool) -> None:
    shares = []
    for seed in range(6):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 4.0, 0.01)
        angle = [(k + 1) * t * (1.3 if back else 0.1) for k in range(4)]
        features = {
            "x": (np.concatenate([np.sin(a) for a in angle]), ""),
            "v": (np.concatenate([np.cos(a) for a in angle]), ""),
        }
        residual = np.concatenate([wind(rng, t) for _ in angle])
        group = np.repeat(np.arange(4.0), t.size)
        shares.append(recurrent_share(Table(residual, group, features, None, residual)).explained)
    assert np.median(shares) < 0.05
    assert max(shares) < 0.3


def test_what_wanders_slower_than_the_state_comes_back_is_not_told_by_it() -> None:
    """A load swings while the trolley stands where it stopped, a little off: the next swing finds
    it off as before, and in the next block by another amount.
    """
    shares = []
    for seed in range(6):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 4.0, 0.01)
        swing = [0.1 * (1 + k) * np.sin((5.0 + 0.3 * k) * t) for k in range(7)]
        features = {
            "angle": (np.concatenate(swing), "rad"),
            "place": (np.repeat(0.2 * np.arange(7.0), t.size) + np.tile(0.01 * t, 7), "m"),
        }
        off = np.repeat(rng.normal(size=7), t.size) + 0.1 * rng.normal(size=7 * t.size)
        group = np.repeat(np.arange(7.0), t.size)
        shares.append(recurrent_share(Table(off, group, features, None, off)).explained)
    assert max(shares) < 0.1


def test_of_what_is_slower_than_a_block_a_few_levels_make_no_wave() -> None:
    t0 = np.repeat(20.0 * np.arange(7), 600)
    t = t0 + np.tile(np.arange(0.0, 6.0, 0.01), 7)
    features, noise = {SESSION: (t, "s")}, np.random.default_rng(0).normal(size=t.size)

    def told(residual: np.ndarray) -> list[tuple[float, float]]:
        table = Table(residual, t0, features, None, residual)
        return [(r.wave[0], r.explained) for r in regressions(table) if r.wave is not None]

    levels = told(np.where(t0 % 40 > 0, 1.0, -1.0) + 0.3 * noise)
    assert all(share < 0.2 for _, share in levels)
    ((hertz, share),) = told(np.sin(2 * np.pi * 0.5 * t) + 0.3 * noise)
    assert abs(hertz - 0.5) < 0.01 and share > 0.5


def test_a_feature_that_moves_in_one_block_alone_is_on_no_wave() -> None:
    group = np.repeat(np.arange(3.0), [600, 50, 50])
    fan = np.where(group == 0, np.sin(0.1 * np.arange(group.size)), 0.0)
    noise = np.random.default_rng(0).normal(size=group.size)
    found = regressions(Table(noise, group, {"fan": (fan, "")}, None, noise))
    assert all(r.wave is None for r in found)


@pytest.mark.parametrize("periods", [159.8, 159.99])
def test_blocks_are_asked_for_waves_however_far_apart_they_are(periods: float) -> None:
    """Of as many periods as are looked for at most, no block sees one (a crash)."""
    t = np.tile(np.linspace(0.0, 1.0, 100), 5) + np.repeat([0.0, 3.0, 7.0, 11.0, periods - 1], 100)
    noise = np.random.default_rng(0).normal(size=t.size)
    table = Table(noise, np.repeat(np.arange(5.0), 100), {SESSION: (t, "s")}, None, noise)
    assert next(r.feature for r in regressions(table)) == SESSION


def rows(of: Callable[[np.random.Generator, np.ndarray], np.ndarray]) -> list[list[Row]]:
    rng, t = np.random.default_rng(4), np.arange(0.0, 2.0, 0.01)
    return [[(t, 0.3 * rng.normal(size=t.size) + of(rng, t)) for _ in range(4)] for _ in range(6)]


def hum(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * (11.0 * t + rng.random()))


def test_a_line_of_another_phase_in_each_block_is_found() -> None:
    found = unphased_lines(rows(hum), 0.08)
    assert found is not None
    assert found.hertz == pytest.approx((11.0,), abs=0.05)
    assert np.std(found.lines[0][0]) == pytest.approx(np.sqrt(0.5), rel=0.2)


def test_a_line_reaches_as_far_as_its_lobe() -> None:
    t = np.arange(0.0, 2.0, 0.01)
    width, count = 1.0 / float(np.ptp(t)), 100 * t.size
    size = np.abs(_spectrum(t, np.cos(2 * np.pi * 11.0 * t), 0.01, count))
    near, end = (np.interp(11.0 + k * width, np.fft.rfftfreq(count, 0.01), size) for k in (1, LOBE))
    assert near > 0.2
    assert end < 0.002


def test_noise_is_no_line_however_narrow_its_band() -> None:
    def band(rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
        return rng.normal() * hum(rng, t) + rng.normal() * hum(rng, t)

    def same(_: np.random.Generator, t: np.ndarray) -> np.ndarray:
        return np.sin(2 * np.pi * 11.0 * t)

    for of in (wind, band, same):
        assert unphased_lines(rows(of), 0.08) is None


def test_a_hum_is_an_unknown_cause_also_where_stamps_start_anew() -> None:
    blocks: list[Block] = recordings(n=24)
    rng = np.random.default_rng(5)
    for b in blocks:
        for s in b.outputs.values():
            s.t[:] -= s.t[0]
        b.inputs["u"].t[:] -= b.inputs["u"].t[0]
        b.outputs["f"].y[:] += 0.2 * hum(rng, b.outputs["f"].t)
    found = diagnose(Toy(), blocks)
    assert found.verdict == "unknown"
    assert "a line of 11 Hz" in found.sentence
    assert any("of another phase in each, in f (11 Hz)" in w for w in found.warnings)
