"""Where a log repeats itself: cycles, moves, and stretches that come again at any time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.signal import fftconvolve

from pianobot_ros.gap.problem.types import Array

SAME_SHARE = 0.95
"""Share of the samples that must agree in repeats; the others are edges of steps."""
SAME = 0.02
"""Of the spread of the driving signal, by which repeats may differ."""
SAME_POSE = 0.1
"""Of the spread of another joint, by which it may be elsewhere in repeats."""
COARSE, MOST = 0.05, 20_000
"""Seconds between samples, and samples, among which repeats are looked for first."""
FEWEST = 3
"""Stretches that must come again, else a log is cut into windows."""

Cuts = list[tuple[int, int]]


def pieces(cuts: Cuts, longest: int) -> Cuts:
    """Each of some cuts (samples) in equally many parts of at most `longest`, so that parts of
    repeats are repeats.
    """
    typical = max(1, round(float(np.median([j - i for i, j in cuts]))))
    parts = max(1, math.ceil(0.98 * typical / longest))
    if parts == 1:
        return cuts
    steps = np.linspace(0, typical, parts + 1).astype(int)
    edges = [np.minimum(i + steps, j).tolist() for i, j in cuts]
    return [(int(a), int(b)) for e in edges for a, b in pairwise(e) if b > a]


def again(x: Array, dt: float, length: int) -> Cuts:
    """Stretches of `length` samples of x (n,) that come again, and what lies between; empty if
    hardly any does.
    """
    n = x.size
    step = max(1, round(COARSE / dt), n // MOST)
    y, w = x[::step], max(4, length // step)
    spread = float(np.std(x))
    if y.size < 3 * w or spread == 0.0:
        return []
    centred = y - y.mean()
    energy = np.concatenate([[0.0], np.cumsum(centred**2)])
    power = energy[w:] - energy[:-w]
    used = np.zeros(n, bool)
    cuts: Cuts = []
    found = 0
    for i in range(0, y.size - w + 1, w):
        at = i * step
        if used[at : at + length].any() or at + length > n:
            continue
        own = [at]
        part = centred[i : i + w]
        if float(np.std(part)) > 0.1 * spread:
            apart = power - 2 * fftconvolve(centred, part[::-1], "valid") + power[i]
            own += _elsewhere(x, np.sqrt(np.maximum(apart, 0.0) / w) / spread, own[0], length, step)
            own = [k for k in own if k == at or not used[k : k + length].any()]
        found += len(own) > 1
        for k in own:
            used[k : k + length] = True
            cuts.append((k, k + length))
    return sorted(cuts) if found >= FEWEST else []


def _elsewhere(x: Array, apart: Array, at: int, length: int, step: int) -> list[int]:
    """Starts (samples) of what agrees with x[at : at + length], apart from it and each other."""
    out: list[int] = []
    shape = x[at : at + length]
    spread = float(np.std(x))
    for k in np.argsort(apart)[: 40 * max(1, length // step)]:
        if apart[k] > 10 * SAME or len(out) > 4:
            break
        near = int(k) * step
        if any(abs(near - other) < length for other in (at, *out)):
            continue
        tried = range(max(0, near - step), min(x.size - length, near + step) + 1)
        if not tried:
            continue
        start = min(tried, key=lambda j: float(np.mean(np.abs(x[j : j + length] - shape))))
        off = difference(x[start : start + length], shape)
        if float(np.quantile(off, SAME_SHARE)) < SAME * spread:
            out.append(start)
    return out


def conditions(x: Array, cuts: Sequence[tuple[int, int]], others: Mapping[str, Array]) -> list[int]:
    """A label for each cut: those in which the driving signal x (n,) agrees within 2 % of its
    spread, and other joints (n,) are where they were, are repeats of one condition. They may be
    shifted against each other by a part of a sample.
    """
    spread = float(np.std(x)) or 1.0
    places = {k: y for k, y in others.items() if float(np.std(y)) > 1e-6}
    limits = {k: SAME_POSE * float(np.std(y)) for k, y in places.items()}
    kept: list[tuple[int, int]] = []
    labels: list[int] = []
    for i, j in cuts:
        for label, (a, b) in enumerate(kept):
            if abs((j - i) - (b - a)) > 0.02 * (j - i) + 2:
                continue
            off = difference(x[i:j], x[a:b])
            if float(np.quantile(off, SAME_SHARE)) >= SAME * spread:
                continue
            n = min(j - i, b - a)
            moved = (
                np.quantile(np.abs(y[i : i + n] - y[a : a + n]), SAME_SHARE)
                for y in places.values()
            )
            if all(m < limit for m, limit in zip(moved, limits.values(), strict=True)):
                labels.append(label)
                break
        else:
            kept.append((i, j))
            labels.append(len(kept) - 1)
    return labels


def spread_over(labels: Sequence[int], count: int) -> list[int]:
    """At most `count` of some cuts, evenly spread, so that of each condition that is kept there are
    repeats wherever there are any.
    """
    if count >= len(labels):
        return list(range(len(labels)))
    groups: dict[int, list[int]] = {}
    for k, label in enumerate(labels):
        groups.setdefault(label, []).append(k)
    repeated = [g for g in groups.values() if len(g) > 1]
    if not repeated:
        return [int(k) for k in np.unique(np.linspace(0, len(labels) - 1, count).astype(int))]
    chosen: list[int] = []
    wanted = min(len(groups), max(1, count // 2))
    every = list(groups.values())
    kept = [every[k] for k in np.unique(np.linspace(0, len(every) - 1, wanted).astype(int))]
    if not any(len(g) > 1 for g in kept):
        kept[0] = repeated[0]
    each = max(2, count // len(kept))
    for g in kept:
        take = min(each, len(g))
        chosen += [g[k] for k in np.unique(np.linspace(0, len(g) - 1, take).astype(int))]
    return sorted(chosen)[: max(count, 2)]


def difference(piece: Array, shape: Array) -> Array:
    """|piece - shape| over the samples of both, with the shift (within a sample or two, and a part
    of one) at which the two agree best.
    """
    n = min(piece.size, shape.size)
    best = np.abs(piece[:n] - shape[:n])
    for shift in (-2, -1, 0, 1, 2):
        a, b = max(0, shift), max(0, -shift)
        m = min(piece.size - a, shape.size - b)
        off, slope = piece[a : a + m] - shape[b : b + m], np.gradient(shape[b : b + m])
        power = float(slope @ slope)
        part = float(np.clip(off @ slope / power, -1.0, 1.0)) if power > 0 else 0.0
        rest = np.abs(off - part * slope)
        if rest.mean() < best.mean():
            best = rest
    return np.asarray(best)
