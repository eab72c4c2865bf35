"""Repeats that a log holds: long cycles, stretches that come again, other joints elsewhere."""

from __future__ import annotations

from collections import Counter

import numpy as np

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.signals.log_repeats import again, conditions, spread_over
from pianobot_ros.axis.signals.segment import blocks_of

DT = 0.02


def wave(seconds: float, seed: int) -> np.ndarray:
    """A smooth signal that never repeats itself."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / DT)) * DT
    window = np.sin(np.pi * np.arange(t.size) / t.size)
    return window * sum(
        rng.normal() * np.sin(2 * np.pi * f * t + 6.3 * rng.random())
        for f in (0.11, 0.23, 0.37, 0.6)
    )


def log_of(u: np.ndarray, **more: object) -> Log:
    t = np.arange(u.size) * DT
    return Log("x", t, u, np.interp(t - 0.06, t, u), None, None, **more)


def repeated(log: Log) -> int:
    """Conditions that occur more than once."""
    blocks, _ = blocks_of(clean(log))
    return sum(n > 1 for n in Counter(b.condition for b in blocks).values())


def test_parts_of_a_long_cycle_are_repeats_of_each_other():
    cycle = wave(40.0, 1)
    blocks, how = blocks_of(clean(log_of(np.tile(cycle, 4))))
    assert "periodic" in how
    count = Counter(b.condition for b in blocks)
    assert sum(n >= 3 for n in count.values()) == 4
    assert sum(b.outputs["position"].t.size for b in blocks) * DT > 140.0


def test_stretches_that_come_again_at_any_time_are_repeats():
    same = wave(24.0, 2)
    u = np.concatenate([wave(11.0, 3), same, wave(17.3, 4), same, wave(5.0, 5)])
    assert len(again(u, DT, 100)) > 10
    assert repeated(log_of(u)) >= 3
    assert repeated(log_of(wave(70.0, 6))) == 0


def test_another_joint_elsewhere_is_another_condition():
    x = np.tile(wave(6.0, 7), 4)
    cuts = [(300 * k, 300 * (k + 1)) for k in range(4)]
    still = conditions(x, cuts, {"next": np.sin(np.tile(np.arange(300), 4) / 50.0)})
    assert still == [0, 0, 0, 0]
    elsewhere = conditions(x, cuts, {"next": np.repeat([0.0, 1.0, 0.0, 1.0], 300)})
    assert elsewhere == [0, 1, 0, 1]


def test_thinning_keeps_repeats():
    labels = [*range(10)] * 5
    kept = spread_over(labels, 12)
    count = Counter(labels[k] for k in kept)
    assert len(kept) <= 12 and min(count.values()) >= 2
    assert spread_over(list(range(50)), 5) == [0, 12, 24, 36, 49]
