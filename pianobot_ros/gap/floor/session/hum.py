"""A disturbance on its own clock where only each block's own time is known, or whose clock wanders:
a line of one frequency and one amplitude whose phase is another in every block.

It would count as scatter and hide in the floor. It is told from scatter by two things that noise
has not: the power of what repeats differ by stands out at one frequency from those about it (an F
test of the spectrum, as Thomson 1982, Proceedings of the IEEE 70, 13), and there all blocks have
the same amplitude, where that of noise, however narrow its band, has an exponential distribution of
power.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import chain

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import fdtrc

from pianobot_ros.gap.floor.session.lines import Rows, line_of, sharpened, waves
from pianobot_ros.gap.problem.constants import ABOUT, CHANCE, FINER, LEADERS, LOBE, TINY
from pianobot_ros.gap.problem.types import Array

MANY = 200
"""Blocks from which more make the same amplitude no surer (numerical)."""


@dataclass(frozen=True)
class Hum:
    """Lines (Hz) and what they are of each block (n,), by the groups that were looked at."""

    hertz: tuple[float, ...]
    lines: list[list[Array]]


def unphased_lines(groups: list[Rows], share: float) -> Hum | None:
    """Lines that the scatter of repeats has, `groups` of which are given with their times; None
    where there are none. Together they must be `share` of the scatter.
    """
    whole = [[x - x.mean() for _, x in group] for group in groups]
    left, hertz = whole, list[float]()
    while len(hertz) < LEADERS and (line := _strongest(groups, left)) is not None:
        hertz.append(line)
        left = [
            [x - _line(t, x, line) for (t, _), x in zip(group, own, strict=True)]
            for group, own in zip(groups, left, strict=True)
        ]
    if not hertz or _scatter(whole) - _scatter(left) < share * _scatter(whole):
        return None
    pairs = (zip(x, rest, strict=True) for x, rest in zip(whole, left, strict=True))
    return Hum(tuple(hertz), [[x - rest for x, rest in each] for each in pairs])


def _scatter(groups: list[list[Array]]) -> float:
    """Sum of the squares by which blocks differ from the mean of their group; a block that is alone
    in its group, from nothing.
    """
    return float(sum(np.sum(_apart(np.array(g)) ** 2) for g in groups))


def _apart(rows: Array) -> Array:
    """Rows (repeats, n) less their mean, if there are others."""
    return np.asarray(rows - rows.mean(0) if len(rows) > 1 else rows)


def _strongest(groups: list[Rows], left: list[list[Array]]) -> float | None:
    """Frequency (Hz) of the line that stands out most from the scatter and is as large in all
    blocks, else None.
    """
    times = [t for group in groups for t, _ in group]
    step = max((float(np.median(np.diff(t))) for t in times if t.size > 1), default=0.0)
    width = 1.0 / max(min((float(np.ptp(t)) for t in times), default=0.0), TINY)
    if not 0.0 < step * width < 0.2 / (2.0 * LOBE + ABOUT):
        return None
    count = FINER * max(int(float(np.ptp(t)) / step) + 1 for t in times)
    hertz = np.fft.rfftfreq(count, step)
    allowed = (hertz >= 2.0 * LOBE * width) & (hertz <= 0.4 / step)
    hertz = hertz[allowed]
    amplitudes = [
        np.array([_spectrum(t, x, step, count)[allowed] for (t, _), x in zip(g, own, strict=True)])
        for g, own in zip(groups, left, strict=True)
    ]
    power = np.sum([np.sum(np.abs(_apart(a)) ** 2, axis=0) for a in amplitudes], axis=0)
    freedom = 2 * sum(max(len(a) - 1, 1) for a in amplitudes)
    ratio = power / _about(power, width / float(hertz[1] - hertz[0]))
    at = int(np.argmax(ratio))
    looked = float(hertz[-1] - hertz[0]) / width
    chance = looked * float(fdtrc(freedom, freedom * ABOUT, ratio[at]))
    sizes = np.abs(np.concatenate([a[:, at] for a in amplitudes])) ** 2
    if chance > CHANCE or _unequal(sizes) > _unequal_by_chance(min(sizes.size, MANY)):
        return None
    rows = list(zip(times, chain(*left), strict=True))

    def explained(hertz: float) -> float:
        return sum(float(np.sum(_line(t, x, hertz) ** 2)) for t, x in rows)

    # what a line that is a little off leaves would look like another one
    return sharpened(explained, float(hertz[at]), width)


def _spectrum(t: Array, x: Array, step: float, count: int) -> Array:
    """Complex amplitudes (count // 2 + 1,) of x (n,) under a Hann window, on a grid of `step` s."""
    local = (t - t[0]) / float(np.ptp(t))
    window = np.sin(np.pi * local) ** 2
    at = np.minimum(np.rint((t - t[0]) / step).astype(int), count - 1)
    grid = np.bincount(at, window * x, count)
    return np.asarray(np.fft.rfft(grid) / max(float(np.sum(window)), TINY))


def _about(power: Array, resolution: float) -> Array:
    """Median power about each frequency, without what a line there reaches itself; a `resolution`
    is so many frequencies.
    """
    near, far = round(LOBE * resolution), round(ABOUT * resolution)
    around = np.ones(2 * far + 1, bool)
    around[far - near : far + near + 1] = False
    about = median_filter(power, footprint=around, mode="reflect")
    return np.asarray(np.maximum(about, TINY), float)


def _unequal(power: Array) -> Array:
    """Mean square of powers (..., n) over the square of their mean: 1 where all are equal, 2 where
    they are those of noise.
    """
    return np.asarray(np.mean(power**2, -1) / np.maximum(np.mean(power, -1) ** 2, TINY))


@lru_cache
def _unequal_by_chance(count: int) -> float:
    """What the powers of so many blocks of noise fall below with the probability of chance."""
    draws = np.random.default_rng(0).exponential(size=(20_000, count))
    return float(np.quantile(_unequal(draws), CHANCE))


def _line(t: Array, x: Array, hertz: float) -> Array:
    """The line (n,) of this frequency that fits x (n,)."""
    local = t - t[0]
    return np.asarray(waves(local, [hertz]) @ line_of([(local, x)], hertz))
