"""The closed forms against brute force, and small properties."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from examples import fewer
from gap_toy import Toy, recordings
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from pianobot_ros import gap
from pianobot_ros.gap import (
    Block,
    Effect,
    Observable,
    Options,
    Parameter,
    Signal,
    Stage,
    propose_experiment,
)
from pianobot_ros.gap.engine import diagnose
from pianobot_ros.gap.explain.experiment import information
from pianobot_ros.gap.fitting.fit import Fitter
from pianobot_ros.gap.fitting.quadratic import extend, quadratic, solve_map
from pianobot_ros.gap.fitting.score import open_parameters, sureness
from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.floor.measure import closed, drawn_together
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.posterior.verdict import credible_set, rarity, unknown_probability
from pianobot_ros.gap.problem.constants import DIFFERENCES, NEGLIGIBLE
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.search.screening import Screened, shortlist


def test_quadratic_is_the_sum_of_squares():
    rng = np.random.default_rng(0)
    n, p = 300, 4
    r, jac, w = rng.normal(size=n), rng.normal(size=(n, p)), rng.uniform(0.1, 1, n)
    runs = [(20 * k, 20 * k + 20, k % 5, k % 3) for k in range(15)]
    quad = quadratic(r, jac, runs, (5, 3), w)
    d = rng.normal(size=p)
    left = w * (r - jac @ d) ** 2
    assert quad.error(d).sum() == pytest.approx(left.sum())
    assert quad.error(d)[2, 1] == pytest.approx(left[140:160].sum())
    s = rng.normal(size=n)
    wide = extend(quad, r, jac, s, runs, w)
    full = quadratic(r, np.column_stack([jac, s]), runs, (5, 3), w)
    assert np.allclose(wide.products, full.products)


@fewer(0.4)
@given(seed=st.integers(0, 10_000))
def test_bounded_step_stays_in_its_box_and_lowers_the_cost(seed):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(8, 4))
    big, g, v = a.T @ a, rng.normal(size=4) * 5, rng.normal(size=4)
    low, high = -rng.uniform(0.1, 1, 4), rng.uniform(0.1, 1, 4)
    d = solve_map(big, g, v, low, high)
    assert np.all(d >= low - 1e-9)
    assert np.all(d <= high + 1e-9)

    def cost(x):
        return x @ big @ x - 2 * g @ x + (v + x) @ (v + x)

    assert cost(d) <= cost(np.zeros(4)) + 1e-9


@given(st.floats(0.3, 4.0), st.floats(-0.9, 0.9))
def test_space_round_trip(a, b):
    space = Space(
        (Parameter("a", 1.0, 0.1, 10.0, sd=0.3, log=True), Parameter("b", 0.0, -1.0, 1.0, sd=0.5))
    )
    assert space.decode(space.encode({"a": a, "b": b})) == pytest.approx({"a": a, "b": b})
    assert np.allclose(space.encode({"a": 1.0}), 0.0)


@given(st.lists(st.floats(0.001, 1.0), min_size=1, max_size=8))
def test_credible_set_is_the_smallest_that_holds_enough(raw):
    p = [x / sum(raw) for x in raw]
    names = [str(i) for i in range(len(p))]
    chosen = credible_set(names, p)
    mass = sum(p[int(n)] for n in chosen)
    assert mass >= 0.95 - 1e-9
    assert sum(p[int(n)] for n in chosen[:-1]) < 0.95
    assert p[int(chosen[-1])] == min(p[int(n)] for n in chosen)


@pytest.mark.parametrize(("count", "groups"), [(3, 6), (4, 4)])
def test_a_bootstrap_draws_blocks_unless_the_end_of_an_interval_were_one_alone(count, groups):
    blocks = np.repeat(np.arange(count), 2)
    assert np.unique(drawn_together(["one"] * blocks.size, blocks)).size == groups
    chance = float(count) ** -count  # that a draw is one and the same
    assert (chance < 0.025) == (groups == count)


def test_closed_fraction():
    assert closed(5.0, 1.0) == 1.0
    assert closed(5.0, 3.0) == pytest.approx(0.5)
    assert np.isnan(closed(1.0, 1.0))


def test_unknown_probability_grows_with_what_is_left_open():
    c = gap.Calibration()
    shares = (0.0, 0.02, c.imprecision, 0.8, 0.9, 1.0, 2.0)
    p = [unknown_probability(c, share, 4.0) for share in shares]
    assert p == sorted(p)
    assert p[0] == c.mimic
    assert p[2] == pytest.approx(0.5)
    assert p[-1] == pytest.approx(1.0 - c.certain)
    assert unknown_probability(c, 0.9, 1.05) == c.mimic  # nothing is unknown at the floor


def test_two_effects_are_rarer_than_one_and_an_unknown_cause_is_not():
    c = gap.Calibration()
    assert rarity(c, 1, 12) == 1.0
    assert 1.0 < rarity(c, 2, 12) < rarity(c, 3, 12)
    one, two = (unknown_probability(c, 0.3, 4.0, rarity(c, n, 12)) for n in (1, 2))
    assert two > one + 0.1


def test_what_all_blocks_agree_on_is_sure_however_unlike_their_gains_are():
    problem = Problem(Toy(), recordings(n=12))
    blocks = problem.block_of_unit
    agreed, one, against = (np.full(12, x) for x in (0.5, -0.5, 0.5))
    agreed[3], one[3], against[3] = 70.0, 70.0, -70.0

    def sure(gains: np.ndarray) -> float:
        each = gains[blocks] / np.bincount(blocks)[blocks]
        return sureness(problem, each, np.zeros(blocks.size), 0)

    assert sure(agreed) == 1.0
    assert sure(one) < 0.975  # a Bayesian bootstrap gives the one block little weight at times
    assert sure(against) < 0.1
    assert sure(agreed) + sure(-agreed) == pytest.approx(1.0)


def test_shortlist_covers_every_open_observable():
    def screened(name, gain, *relief):
        return Screened(name, gain, 0.0, {}, *(np.zeros(1) for _ in range(4)), np.array(relief))

    loud = [screened(f"series{k}", 100.0 - k, 0.5, 0.0) for k in range(5)]
    quiet = screened("event", 1.0, 0.0, 0.9)
    assert [s.effect for s in shortlist([*loud, quiet], 2, [])] == ["series0", "series1"]
    assert [s.effect for s in shortlist([*loud, quiet], 2, [1])] == ["series0", "series1", "event"]
    assert quiet not in shortlist([*loud, quiet], 2, [0])


def test_next_experiment_prefers_the_motion_that_tells_candidates_apart():
    blocks = recordings(c3=0.1)
    d = diagnose(Toy(), blocks)
    offered = [replace(b, units={"rate": "rad/s"}) for b in recordings(n=3, k=1.0)]
    small = recordings(n=1, k=0.05)[0]
    ranked = propose_experiment(Toy(), d, [*offered, small])
    assert ranked[-1].block is small  # a cubic term is invisible in small motions
    assert ranked[0].gain > 10 * ranked[-1].gain
    with_proposal = diagnose(Toy(), blocks, experiments=offered).to_json()["next_experiment"]
    assert with_proposal["expected_gain"] > 0
    assert with_proposal["units"] == {"rate": "rad/s"}


def test_next_experiment_also_tells_what_may_hide_behind_refitted_parameters():
    # In small motions a cubic force cannot be told from a stiffer spring: nothing but "parameters"
    # was fitted, and yet there is something to find out.
    d = diagnose(Toy(), recordings(k=0.3, c=0.7))
    assert d.verdict == "parameters"
    assert "cubic" in {h.name for h in d.hiding}
    assert all(h.probability == pytest.approx(_mass(d, h.name)) for h in d.hiding)
    small, large = recordings(n=1, k=0.3)[0], recordings(n=1, k=1.0)[0]
    first, last = propose_experiment(Toy(), d, [small, large])
    assert first.block is large
    assert "cubic" in first.pair
    assert first.gain > 10 * last.gain


def test_what_blocks_tell_saturates_at_what_is_open():
    weight = np.array([0.5, 0.5])
    gained = [information(weight, d * (1.0 - np.eye(2))) for d in (0.0, 0.1, 1.0, 50.0)]
    assert gained[0] == 0.0
    assert gained == sorted(gained)
    assert gained[-1] == pytest.approx(np.log(2.0))
    # Two that are told apart for certain leave nothing to ask, however far a strike would set them.
    sure = np.array([0.98, 0.02])
    even = information(weight, 0.5 * (1.0 - np.eye(2)))
    assert information(sure, 50.0 * (1.0 - np.eye(2))) < even


def _mass(d, name):
    return next(c.probability for c in d.candidates if c.name == name)


def test_gap_knows_no_piano_and_no_ros():
    for path in Path(gap.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = (
                [a.name for a in node.names]
                if isinstance(node, ast.Import)
                else ([node.module or ""] if isinstance(node, ast.ImportFrom) else [])
            )
            for name in names:
                assert not name.startswith(("rclpy", "mujoco", "examples")), f"{path.name}: {name}"
                assert not name.startswith("pianobot") or name.startswith("pianobot_ros.gap"), (
                    f"{path.name}: {name}"
                )


class Valleys:
    """A twin whose misfit has a valley every third of a unit: a slope alone does not find the
    deepest.
    """

    stages = (Stage("only"),)
    observables = (Observable("y", "only", "y", "1", tolerance=1e-3),)
    parameters = (Parameter("a", 1.0, 0.5, 2.0, sd=0.2, stage="only"),)
    effects = (Effect("phase", "only", (Parameter("p", 0.0, -2.0, 2.0, sd=0.33),), ({"p": 0.1},)),)

    def simulate(self, blocks, values, effects):
        p = values["p"] if "phase" in effects else 0.0
        return [
            {
                "y": values["a"]
                * (np.sin(19.0 * (b.inputs["u"].y - p)) + 0.5 * (b.inputs["u"].y - p))
            }
            for b in blocks
        ]


def valleys() -> Fitter:
    """Of recordings whose deepest valley is at 0.35."""
    rng = np.random.default_rng(3)
    u = np.linspace(0.0, 3.0, 400)
    y = np.sin(19.0 * (u - 0.35)) + 0.5 * (u - 0.35)
    blocks = [
        Block(
            f"b{k}", "c", {"u": Signal(u, u)}, {"y": Signal(u, y + 0.02 * rng.normal(size=u.size))}
        )
        for k in range(6)
    ]
    problem = Problem(Valleys(), blocks)
    residual = problem.y - problem.predict(problem.nominal(), ())
    return Fitter(problem, NoiseModel.by(problem, residual, Options()))


def test_a_hop_leaves_a_local_optimum():
    fitter = valleys()
    stuck = fitter.refine(fitter.start(("phase",), np.array([0.0, 0.05])), 40)
    assert abs(stuck.values["p"] - 0.35) > 0.2
    found = fitter.hop(stuck, [1], 40)
    assert found.values["p"] == pytest.approx(0.35, abs=0.01)
    calls = fitter.problem.budget.calls
    fitter.problem._memo.clear()
    assert fitter.hop(found, [1], 40) is found
    assert fitter.problem.budget.calls == calls + 2  # a prior deviation up and down


def test_a_step_that_promises_a_small_part_of_a_nat_is_not_simulated():
    fitter = valleys()
    fit = fitter.refine(fitter.start((), np.zeros(1)), 40)
    near = fitter.start((), fit.v + 0.3 * fit.sd)
    assert near.cost > fit.cost
    calls = fitter.problem.budget.calls
    assert fitter.refine(near, 40).cost == near.cost
    assert fitter.problem.budget.calls == calls + len(DIFFERENCES)  # of one parameter


def test_a_hop_is_taken_for_what_counts_as_a_gain_of_any_fit(monkeypatch):
    """A tenth of what tells hypotheses apart."""
    fitter = valleys()
    fit = fitter.refine(fitter.start(("phase",), np.array([0.0, 0.35])), 40)
    counts = 0.1 * (6.0 + 0.01 * fit.cost)
    for share, taken in ((0.9, False), (1.1, True)):
        cost = fit.cost - share * counts
        monkeypatch.setattr(fitter.likelihood, "cost", lambda *_, cost=cost: cost)
        assert (fitter.hop(fit, [1], 0, rounds=1) is not fit) == taken


@fewer(0.4)
@given(
    st.integers(0, 10_000),
    st.lists(st.booleans(), min_size=1, max_size=4).filter(any),
    st.integers(1, 6),
    st.floats(0.2, 3.0),
)
def test_a_prediction_is_as_wide_as_the_other_units_leave_parameters_open(seed, free, n, kappa):
    rng, free, p = np.random.default_rng(seed), np.array(free), len(free)
    jac, e = rng.normal(size=(n, p)), 3.0 * rng.normal(size=n)
    root = rng.normal(size=(p, p))
    train = np.eye(p) + root @ root.T
    d = rng.normal(size=p)
    moving, known = jac[:, free], train[np.ix_(free, free)]  # the others are held
    spread = moving @ np.linalg.solve(known, moving.T)
    assume(kappa * np.trace(spread) > NEGLIGIBLE)
    r = e + jac @ d  # the residual where the units were linearised
    left = quadratic(r, jac, [(0, n, 0, 0)], (1, 1), np.ones(n))
    found = open_parameters(left, d, np.array([kappa]), train, free)[0, 0]
    sure = np.eye(n) / kappa
    exact, narrow = (multivariate_normal.logpdf(e, np.zeros(n), c) for c in (sure + spread, sure))
    assert found == pytest.approx(exact - narrow, abs=1e-8)
