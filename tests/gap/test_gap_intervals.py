"""Intervals of parameters where what the twin or a law is wrong by does not average out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, diagnose
from pianobot_ros.gap.fitting.intervals import correlated_variance
from pianobot_ros.gap.floor.whitening.whiten import Whitener


class Bare(Toy):
    """The toy with nothing to find but its parameters."""

    effects = ()


def test_weights_of_whitened_residuals_become_those_of_residuals() -> None:
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0.0, 1.0, 40))
    own = Whitener.of(t, np.full(40, 0.3), (rng.uniform(0.5, 1.0, 40), 0.1), (0.4, 2.0))
    other = Whitener.of(t, np.full(40, 0.1), (0.7, 0.3), at=np.arange(40, 80))
    both = Whitener.joined([own, other])
    np.testing.assert_allclose(both.transposed(np.eye(80)), both.apply(np.eye(80)).T, atol=1e-12)


def test_variance_of_a_weighted_sum_of_correlated_errors() -> None:
    rng = np.random.default_rng(2)
    t, tau = np.sort(rng.uniform(0.0, 1.0, 60)), 0.1
    covariance = np.exp(-np.abs(t[:, None] - t) / tau)
    moved = rng.normal(size=(60, 3))
    expected = np.diag(moved.T @ covariance @ moved)
    np.testing.assert_allclose(correlated_variance(t, moved, tau), expected)


def bent(blocks: Sequence[Block], seed: int) -> list[Block]:
    """Blocks whose force is off by one tolerance, as the same function of position in all."""
    rng = np.random.default_rng(seed)
    rate, phase = rng.uniform(1.0, 8.0), rng.uniform(-np.pi, np.pi)
    out = []
    for block in blocks:
        force, x = block.outputs["f"], block.outputs["x"]
        off = np.sqrt(2.0) * 0.01 * np.std(force.y) * np.cos(rate * x.y + phase)
        bent = replace(force, y=force.y + off)
        out.append(replace(block, outputs={**block.outputs, "f": bent}))
    return out


def test_an_error_within_tolerance_that_all_blocks_share_is_in_the_interval() -> None:
    held = 0
    for seed in range(8):
        blocks = bent(recordings(seed, conditions=12), seed)
        interval = diagnose(Bare(), blocks).parameters["c"]
        held += interval.low <= 0.5 <= interval.high
    assert held >= 6
