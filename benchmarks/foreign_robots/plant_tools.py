"""What the four plants have in common: laws of delays and filters, and noise with a memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pianobot_ros.gap import Block

Array = NDArray[np.float64]


class PlantLaw(NamedTuple):
    """A law of the plant: the effect of the twin's library that it is a relative of (or
    ``unknown:…``), the sizes between which one of so many floors is looked for, and what it is.
    """

    family: str
    low: float
    high: float
    text: str


def sizes_by_place(laws: Mapping[str, PlantLaw], effects: Mapping[str, float]) -> Array:
    """Sizes of all laws in their order, as compiled code takes them; 0 is not at work."""
    size = np.zeros(len(laws))
    for place, name in enumerate(laws):
        size[place] = effects.get(name, 0.0)
    return size


def session(
    record: Callable[[Mapping[str, float], Array, Array, tuple[int, int], tuple[int, int]], Block],
    parameters: Mapping[str, float],
    size: Array,
    t: Array,
    seed: int,
    conditions: int,
    repeats: int,
) -> list[Block]:
    """Blocks of every condition, ``repeats`` times one after the other: ``record`` makes one at
    times ``t`` (s) of which repeat and condition, with noise by a seed of its own.
    """
    order = [(r, k) for r in range(repeats) for k in range(conditions)]
    return [record(parameters, size, t, which, (seed, j)) for j, which in enumerate(order)]


def stepping_times(samples: int, sample: float, step: float) -> Array:
    """Times (s) of a plant's steps in so many ``sample`` intervals."""
    return np.asarray(np.arange(samples * round(sample / step)) * step, dtype=np.float64)


def smooth_step(t: Array, start: float, duration: float) -> Array:
    """From 0 to 1 by the cubic that starts and ends at rest; times in s."""
    x = np.clip((t - start) / duration, 0, 1)
    return np.asarray(x * x * (3 - 2 * x))


def polled(t: Array, y: Array, period: float, phase: float) -> Array:
    """``y`` held between polls of that period (s); the first poll is ``phase`` of one earlier."""
    k = np.floor((t - t[0]) / period + phase)
    return np.asarray(np.interp(np.maximum((k - phase) * period + t[0], t[0]), t, y))


def jittered(t: Array, y: Array, mean: float, random: np.random.Generator, packet: float) -> Array:
    """``y`` by packets of ``packet`` s, each late by a gamma delay of that mean (s), in order."""
    n = int((t[-1] - t[0]) / packet) + 2
    sent = t[0] + packet * np.arange(n) - packet
    arrived = np.maximum.accumulate(sent + random.gamma(3.0, mean / 3.0, n))
    k = np.clip(np.searchsorted(arrived, t, side="right") - 1, 0, n - 1)
    late = np.maximum(arrived[k] - sent[k], 0)
    return np.asarray(np.interp(t - late, t, y))


def first_order_lag(y: Array, dt: float, tau: float) -> Array:
    """First-order lag of ``tau`` s by the end of a sample."""
    a = 1 - math.exp(-dt / tau)
    return np.asarray(lfilter([a], [1, a - 1], y, zi=[(1 - a) * y[0]])[0])


def second_order_lag(y: Array, dt: float, tau: float) -> Array:
    """Critically damped second order with a delay of ``tau`` s altogether."""
    a = math.exp(-dt / (tau / 2))
    for _ in range(2):
        y, _ = lfilter([1 - a], [1, -a], y, zi=[a * y[0]])
    return y


def moving_average(y: Array, dt: float, tau: float) -> Array:
    """Moving average over twice ``tau`` s, which delays by ``tau``."""
    n = max(1, round(2 * tau / dt))
    total = np.cumsum(np.concatenate([np.full(n, y[0]), y]))
    return np.asarray((total[n:] - total[:-n]) / n)


def delay_and_lag(y: Array, dt: float, tau: float) -> Array:
    """Half of ``tau`` s a pure delay, half a first-order lag."""
    place = np.arange(y.size)
    delayed = np.interp(place - tau / 2 / dt, place, y)
    a = math.exp(-dt / (tau / 2))
    return np.asarray(lfilter([1 - a], [1, -a], delayed, zi=[a * delayed[0]])[0])


def correlated_noise(
    random: np.random.Generator, count: int, dt: float, sd: float, tau: float
) -> Array:
    """Ornstein-Uhlenbeck noise of standard deviation ``sd`` that forgets within ``tau`` s."""
    a = math.exp(-dt / tau)
    e = random.standard_normal(count) * sd * math.sqrt(1 - a * a)
    return np.asarray(lfilter([1], [1, -a], e, zi=[a * sd * random.standard_normal()])[0])
