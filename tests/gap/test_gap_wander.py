"""A robot that wanders for some seconds: repeats that follow each other show little of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from gap_toy import Toy, recordings

from pianobot_ros.gap import Signal, diagnose
from pianobot_ros.gap.floor.estimate import estimates
from pianobot_ros.gap.floor.session.wander import growth
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.constants import LASTING as SHARES
from pianobot_ros.gap.problem.constants import SIZES
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.search.opening import open_evidence

CONDITIONS, REPEATS, LASTING = 9, 4, 3.0


def wander(rng, starts, sigma, tau=LASTING):
    """An Ornstein-Uhlenbeck process at some times."""
    alike = np.exp(-np.abs(starts[:, None] - starts) / tau)
    return sigma * np.linalg.cholesky(alike) @ rng.normal(size=starts.size)


def condition_of(rounds: bool):
    """Of each block which condition it is of."""
    blocks = np.arange(CONDITIONS * REPEATS)
    return blocks % CONDITIONS if rounds else blocks // REPEATS


def grown(seed: int, sigma: float, rounds: bool) -> float:
    """How much the variance grows by the repeats of one number, with white scatter of 1."""
    rng = np.random.default_rng(seed)
    condition = condition_of(rounds)
    starts = 1.1 * np.arange(condition.size)
    x = wander(rng, starts, sigma) + rng.normal(size=starts.size)
    groups = [(starts[condition == c], x[condition == c, None]) for c in range(CONDITIONS)]
    return growth(groups, starts)


def test_scatter_grows_where_repeats_follow_each_other_and_the_robot_wanders():
    usual = np.mean([grown(seed, 2.0, rounds=False) for seed in range(40)])
    apart = np.abs(np.arange(1, REPEATS)) * 1.1
    pairs = np.average(np.exp(-apart / LASTING), weights=REPEATS - np.arange(1, REPEATS))
    assert 0.7 < usual / (5.0 / (1.0 + 4.0 * (1.0 - pairs))) < 1.3


def test_repeats_in_rounds_are_far_apart_and_nothing_grows():
    assert max(grown(seed, 2.0, rounds=True) for seed in range(20)) < 1.02


def test_white_scatter_hardly_grows():
    assert np.mean([grown(seed, 0.0, rounds=False) for seed in range(40)]) < 1.3


def test_pairs_that_tell_nothing_of_a_wander_leave_it_as_likely_as_beforehand():
    """All repeats lie equally far apart, so any wander makes the same levels."""
    starts = np.arange(16.0)
    level = np.random.default_rng(3).normal(size=16)
    found = growth([(starts[k : k + 2], level[k : k + 2, None]) for k in range(0, 16, 2)], starts)
    apart = np.abs(starts[:, None] - starts)[~np.eye(16, dtype=bool)]
    grown = [
        (1.0 + size * np.mean(1.0 - np.exp(-apart / t))) / (1.0 + size * (1.0 - np.exp(-1.0 / t)))
        for size in SIZES[1:]
        for t in 15.0 * np.asarray(SHARES)
    ]
    assert SIZES[0] == 0.0
    assert np.isclose(found, np.mean([1.0, *grown]), rtol=1e-9)


def sound(seed: int, rounds: bool):
    """Blocks of a sound robot whose force has a level that wanders."""
    rng, condition = np.random.default_rng([seed, 1]), condition_of(rounds)
    starts = 5.0 * np.arange(condition.size)
    level = wander(rng, starts, 0.06, 2.0 * 5.0)
    given = recordings(seed, condition.size, conditions=CONDITIONS)
    own = [[b for b in given if b.condition == f"w{1 + c}"] for c in range(CONDITIONS)]
    out = []
    for c, t0, more in zip(condition, starts, level, strict=True):
        block = own[c].pop()
        outputs = {
            name: Signal(s.t + t0, s.y + more * (name == "f"), s.unit)
            for name, s in block.outputs.items()
        }
        u = block.inputs["u"]
        phases = {n: (a + t0, b + t0) for n, (a, b) in block.phases.items()}
        out.append(
            replace(block, outputs=outputs, inputs={"u": replace(u, t=u.t + t0)}, phases=phases)
        )
    return out


def gap_of(rounds: bool) -> float:
    """RMS gap (floors) of the force of twelve sound robots."""
    squares = []
    for seed in range(12):
        evidence = open_evidence(Toy(), sound(seed, rounds), 0, Budget(), 1, Options())
        squares.append(evidence.gauge.gaps(evidence.nominal)[1] ** 2)
    return float(np.sqrt(np.mean(squares)))


def test_a_sound_robot_that_wanders_has_hardly_a_gap_in_whatever_order_it_is_recorded():
    """By the scatter of repeats that follow each other it is at 1.34 floors."""
    assert 0.95 < gap_of(rounds=True) < 1.05
    assert 0.95 < gap_of(rounds=False) < 1.25


def white_of_onsets(seed: int, stray: float | None) -> float:
    """Scatter of an event that wanders, s, one of which is a `stray`, or was not recorded."""
    rng, blocks = np.random.default_rng(seed), sound(seed, rounds=False)
    onset = wander(rng, 5.0 * np.arange(len(blocks)), 0.04, 15.0)
    onset += 0.3 + 0.02 * rng.normal(size=len(blocks))
    events = [{"onset": float(t)} for t in onset]
    events[5] = {} if stray is None else {"onset": stray}
    problem = Problem(Toy(), [replace(b, events=e) for b, e in zip(blocks, events, strict=True)])
    residual = problem.y - problem.predict(problem.nominal(), ())
    return estimates(problem, residual, Options()).noises[2].white


def test_a_stray_event_says_nothing_of_how_the_others_wander():
    for seed in range(3):
        assert np.isclose(white_of_onsets(seed, 3.0), white_of_onsets(seed, None), rtol=1e-3)


def test_repeats_that_follow_each_other_bring_a_warning():
    said = [diagnose(Toy(), sound(1, rounds)).warnings for rounds in (False, True)]
    assert ["follow each other" in " ".join(w) for w in said] == [True, False]
