"""How repeats scatter, which of them are strays, and how far each is from the others.

Scatter has heavy tails: now and then an event, or a whole recording, is far from its repeats, for
reasons that nobody will know. What is not systematic is no gap: so few strays as chance brings are
not judged at all, more of them are a rare fault, which counts as gap.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc, ndtri

from pianobot_ros.gap.problem.constants import NEGLIGIBLE, OF_MEDIAN, RARE, SMALL, STRAY
from pianobot_ros.gap.problem.types import Array

MEAN_DEPARTURE = float(np.sqrt(2.0 / np.pi))
"""Mean distance of Gaussian repeats from their middle, in standard deviations."""


def by_chance(count: int) -> int:
    """How many of `count` repeats may be strays although nothing is wrong: the chance of more is
    small.
    """
    more = bdtrc(np.arange(count + 1), count, NEGLIGIBLE)  # the chance of more than 0, 1, ...
    return int(np.argmax(more <= SMALL))


def strays(away: Array, least: float) -> NDArray[np.bool_]:
    """Which repeats (n,) are strays, by how far `away` each is from the median of its group.

    A rare fault is no scatter: a repeat that is far from the others, where most of all repeats are
    close to theirs, would hide itself if it counted. `least` is the scatter below which nothing is
    a stray.
    """
    usual = max(OF_MEDIAN * float(np.median(away)), least)
    far = away > STRAY * usual
    return far if far.sum() <= RARE * far.size else np.zeros(far.size, bool)


def departures(x: Array) -> Array:
    """Distance (..., n) of each of n ≥ 2 repeats `x` (..., n) from their median, in its unit.

    It is what a twin predicts where an effect scatters moments: that raises the floor of the
    moments themselves, and shows only in how far they are apart. From the mean of a few repeats one
    stray would move all of them alike, as an effect of their condition would.

    Scaled so that it is :data:`MEAN_DEPARTURE` standard deviations on average where repeats are
    independent and Gaussian, however few they are: the median of few lies near one of them. The
    scale is from approximate normal order statistics (Blom 1958).
    """
    away = np.abs(x - np.median(x, axis=-1, keepdims=True))
    return np.asarray(away * _scale_of(x.shape[-1]))


@lru_cache
def _scale_of(count: int) -> float:
    """What makes the mean departure of so many repeats :data:`MEAN_DEPARTURE`."""
    usual = ndtri((np.arange(1, count + 1) - 0.375) / (count + 0.25))
    return float(MEAN_DEPARTURE / np.mean(np.abs(usual)))
