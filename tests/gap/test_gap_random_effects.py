"""What is another in each block: estimated from repeats, and whitened with all else."""

from __future__ import annotations

import numpy as np
import pytest
from examples import fewer
from gap_toy import Toy, recordings
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.gap.floor.estimate import estimates
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.whitening.random_effects import directions, inverse_root
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


@fewer(0.2)
@given(st.integers(1, 5), st.floats(0.0, 50.0), st.integers(0, 10_000))
def test_the_inverse_root_is_that_of_the_covariance(k, size, seed):
    a = size * np.random.default_rng(seed).normal(size=(30, k))
    root = np.eye(30) - a @ inverse_root(a) @ a.T
    assert root @ (np.eye(30) + a @ a.T) @ root == pytest.approx(np.eye(30), abs=1e-6)


def problem_with(own: Array, white: float = 0.01) -> tuple[Problem, Array, Array]:
    """A problem, the rate of its force, and residuals in which each block's force has so much of
    that rate, beside white noise.
    """
    problem = Problem(Toy(), recordings(), Options())
    nominal = problem.predict(problem.nominal(), ())
    along = directions(problem, nominal, np.zeros((problem.size, 1)))
    noise = white * np.random.default_rng(3).normal(size=problem.size)
    return problem, along, along[:, 1] * own[problem.block_of] + noise


def series(problem: Problem) -> list[int]:
    return [o for o in problem.present if problem.observables[o].kind == "series"]


def test_how_much_blocks_differ_is_estimated_from_their_repeats():
    blocks = len(recordings())
    own = 0.02 * np.random.default_rng(1).normal(size=blocks)
    problem, along, residual = problem_with(own)
    found = estimates(problem, residual, Options(tolerance=0.0), directions=along)
    for o in series(problem):
        effects = found.noises[o].effects
        assert effects is not None
        assert effects.deviation[1] == pytest.approx(np.std(own), rel=0.5)
        assert effects.correlated < 0.5 * found.noises[o].correlated


def test_repeats_that_are_nothing_but_noise_have_no_effects_of_their_own():
    problem, along, residual = problem_with(np.zeros(len(recordings())))
    found = estimates(problem, residual, Options(tolerance=0.0), directions=along)
    assert all(found.noises[o].effects is None for o in series(problem))


def test_what_a_prediction_inherits_of_noise_is_no_effect_of_a_block():
    """A derivative by a gain holds the noise of what was measured, and so does the residual: a
    block seems to differ along it, by as much in all of them.
    """
    problem = Problem(Toy(), recordings(), Options())
    rng = np.random.default_rng(3)
    inherited = np.convolve(rng.normal(size=problem.size + 8), np.ones(9) / 3.0, "valid")
    nominal = problem.predict(problem.nominal(), ())
    along = directions(problem, nominal, (nominal + inherited)[:, None])
    residual = 0.01 * rng.normal(size=problem.size) - 0.5 * inherited
    found = estimates(problem, residual, Options(tolerance=0.0), directions=along)
    for o in series(problem):
        effects = found.noises[o].effects
        assert effects is None or effects.deviation[0] == 0.0
        assert effects is None or effects.tau < 2.0 * found.noises[o].tau


def test_what_differs_from_block_to_block_is_as_white_as_noise():
    own = 0.02 * np.random.default_rng(1).normal(size=len(recordings()))
    problem, along, residual = problem_with(own)
    options = Options(tolerance=0.0, timing_tolerance=0.0)
    with_own, without = (
        NoiseModel(problem, options, estimates(problem, residual, options, directions=d))
        for d in (along, None)
    )
    for o in series(problem):
        judged = (problem.obs_of == o) & problem.mask
        z = with_own.whiten(residual)[judged]
        assert np.mean(z**2) == pytest.approx(1.0, abs=0.2)
        # a slow shape of another kind stands out more than where the scatter is all wander
        shape = np.where(judged, np.cos(0.05 * np.arange(problem.size)) * np.std(residual), 0.0)
        assert np.sum(with_own.whiten(shape) ** 2) > np.sum(without.whiten(shape) ** 2)


def test_unwhitening_is_the_transposed_of_whitening_with_effects_of_blocks():
    own = 0.02 * np.random.default_rng(1).normal(size=len(recordings()))
    problem, along, residual = problem_with(own)
    noise = NoiseModel(problem, Options(), estimates(problem, residual, Options(), None, along))
    rng = np.random.default_rng(0)
    x, w = rng.normal(size=(2, problem.size))
    assert noise.whiten(x) @ w == pytest.approx(float(x @ noise.unwhiten(w[:, None])[:, 0]))
