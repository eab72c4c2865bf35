"""Moments that scatter: one stray among many is none of the causes, and scatter of all is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, Observable, departures, diagnose
from pianobot_ros.gap.floor.scatter import MEAN_DEPARTURE

USUAL = 1e-3
"""What an onset scatters by for reasons of measurement alone, s."""
REPEATS = 4


class Scattering(Toy):
    observables = (
        *Toy.observables,
        Observable("apart", "motion", "apart", "s", "event", floor_hint=2e-4, tolerance=6e-4),
    )

    def simulate(self, blocks, values, effects):
        found = super().simulate(blocks, values, effects)
        return [p | {"apart": MEAN_DEPARTURE * USUAL} for p in found]


def onsets(shift: np.ndarray, *, fc: float) -> list[Block]:
    """36 blocks, each condition four times, whose onsets are moved by `shift` (36,) s."""
    blocks = recordings(fc=fc, n=shift.size, conditions=shift.size // REPEATS)
    onset = np.array([b.events["onset"] for b in blocks]) + shift
    names = np.array([b.condition for b in blocks])
    apart = np.zeros(shift.size)
    for name in set(names):
        apart[names == name] = departures(onset[names == name])
    return [
        replace(b, events={"onset": float(t), "apart": float(x)})
        for b, t, x in zip(blocks, onset, apart, strict=True)
    ]


@pytest.mark.long
def test_one_stray_of_36_leaves_the_right_effect_first():
    shift = np.zeros(36)
    shift[4] = 100 * USUAL
    d = diagnose(Scattering(), onsets(shift, fc=0.1))
    assert [e.name for e in d.effects] == ["friction"]
    assert d.candidates[0].probability > 0.8


def test_scatter_of_all_is_a_gap():
    shift = np.random.default_rng(5).normal(0.0, 8 * USUAL, 36)
    d = diagnose(Scattering(), onsets(shift, fc=0.0))
    assert d.verdict == "unknown"
    assert d.unknown is not None
    assert d.unknown.observable == "apart"


@pytest.mark.parametrize("n", [3, 4, 8])
def test_departures_of_gaussian_repeats(n):
    x = np.random.default_rng(n).normal(size=(4000, n))
    mean = np.mean([departures(row) for row in x])
    assert mean == pytest.approx(MEAN_DEPARTURE, rel=0.05)


def test_a_stray_hardly_moves_the_departures_of_its_repeats():
    x = np.array([0.0, 1.0, 2.0, 3.0])
    far = departures(np.append(x, 1000.0))
    assert far[:4].max() <= departures(x).max() * 1.5
    assert far[4] > 900.0
