"""Contact with surroundings: a limit of a joint's angle that other joints shift, found in logs
before anything is fitted.

An arm that is pressed on a table stops where its commands go on. Which angle that is depends on the
joints before and behind, so it looks like no end stop, and like friction or gravity of another size
at every pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.commissioning.around.other_joints import moves
from pianobot_ros.axis.laws.load.contact import Contact
from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.gap.problem.types import Array

__all__ = ["find", "untouched"]

CONTACT_MARGIN = 0.02
"""rad from a limit at which a joint may be in contact."""

TRIES = 600
"""Planes through three held-back samples that are tried for each choice of joints."""
SAMPLES = 6000
"""Samples that are looked at."""
HELD = 40
"""Samples at the limit, a tenth of a second each, without which there is no contact."""
TOGETHER = 0.3
"""Share of a joint's variance that the others must leave: of joints that move together nothing can
be told.
"""
MOSTLY, FORCED = 0.7, 7.0
"""Share of the samples commanded beyond the limit at which the joint must be at it, and how far the
command must go there now and then, in widths of the limit.
"""
EPISODES = 3
"""Separate times that the joint was held there, at least."""


@dataclass(frozen=True)
class _Samples:
    """Every tenth of a second of some logs: angle, command and other angles (n, …); `run` numbers
    them in time.
    """

    q: Array
    u: Array
    others: Array
    run: NDArray[np.intp]


def find(logs: Sequence[Clean], joint: str, names: Sequence[str]) -> Contact | None:
    """The contact that most samples speak for, or None; `names` are the joints in their order."""
    use = [c for c in logs if c.command is not None and c.log.unit == "rad"]
    if joint not in names or not use:
        return None
    i = names.index(joint)
    best, most = None, 0.0
    for pair in ((i - 1, i + 1), (i + 1, i + 2), (i - 2, i - 1)):
        if min(pair) < 0 or max(pair) >= len(names):
            continue
        own = [names[k] for k in pair]
        if not all(moves(use, n) for n in own):
            continue
        s = _samples(use, own)
        for side in (1.0, -1.0):
            found, score = _plane(s, side)
            if found is not None and score > most:
                slopes = zip(own, (float(x) for x in found[1:]), strict=True)
                best, most = Contact(side, float(found[0]), tuple(slopes)), score
    return best


def untouched(c: Clean, touched: Contact | None) -> Array:
    """Weight (n,) of the samples of a log: 0 where nothing was measured or something is touched."""
    free = c.valid
    if touched is not None and all(n in c.others for n, _ in touched.slopes):
        limit = touched.at([c.others[n] for n, _ in touched.slopes])
        free = free & (touched.side * (c.q - limit) <= -CONTACT_MARGIN)
    return np.asarray(free, float)


def _samples(logs: Sequence[Clean], own: Sequence[str]) -> _Samples:
    total = sum(c.t.size * c.dt for c in logs)
    q, u, others, run = [], [], [], []
    start = 0
    for c in logs:
        step = max(1, round(max(0.1, total / SAMPLES) / c.dt))
        kept = np.flatnonzero(c.valid)[::step]
        assert c.command is not None
        q.append(c.q[kept])
        u.append(c.command[kept])
        others.append(np.stack([np.ones(kept.size), *(c.others[n][kept] for n in own)], axis=1))
        run.append(start + kept // step)
        start += c.t.size + 10
    return _Samples(
        np.concatenate(q), np.concatenate(u), np.concatenate(others), np.concatenate(run)
    )


def _plane(s: _Samples, side: float) -> tuple[Array | None, float]:
    """Coefficients (3,) of the limit on 1 and the two angles, and how many samples speak for it.

    For it speak samples at which the command is well beyond the limit and the joint at it; against
    it those at which the joint is beyond.
    """
    follows = s.others @ np.linalg.lstsq(s.others, s.q, rcond=None)[0]
    if float(np.var(s.q - follows)) < TOGETHER * float(np.var(s.q)):
        return None, 0.0
    error = side * (s.u - s.q)
    middle = float(np.median(error))
    spread = 1.48 * float(np.median(np.abs(error - middle)))
    candidates = np.flatnonzero(error > middle + max(1.5 * spread, 1e-3))
    if candidates.size < HELD:
        return None, 0.0
    near = max(0.25 * spread, 0.005)
    best, most = _tried(s, side, candidates, near)
    if best is None or most < HELD:
        return None, 0.0
    for _ in range(3):
        at = _at(s, side, best, near)
        better = np.asarray(np.linalg.lstsq(s.others[at], s.q[at], rcond=None)[0], float)
        score = _score(s, side, better, near)
        if score < most:
            break
        best, most = better, score
    there = np.flatnonzero(_at(s, side, best, near))
    beyond = side * (s.u - s.others @ best)
    stopped = side * (s.q - s.others @ best) > -near
    if float(np.mean(stopped[beyond > 3.0 * near])) < MOSTLY:
        return None, 0.0
    if float(np.quantile(beyond[there], 0.9)) < FORCED * near:
        return None, 0.0  # friction may hold it back as far
    episodes = 1 + int(np.sum(np.diff(s.run[there]) > 10))
    varied = float(np.std(s.others[there] @ best)) > 2.0 * near  # else friction or an end stop
    return (best, most) if episodes >= EPISODES and varied else (None, 0.0)


def _tried(
    s: _Samples, side: float, candidates: NDArray[np.intp], near: float
) -> tuple[Array | None, float]:
    """The best of many planes through three of the candidates, and its score."""
    rng = np.random.default_rng(0)
    best: Array | None = None
    most = 0.0
    for _ in range(TRIES):
        three = rng.choice(candidates, 3, replace=False)
        x = s.others[three]
        if abs(np.linalg.det(x)) < 1e-3:
            continue
        plane = np.asarray(np.linalg.solve(x, s.q[three]), float)
        score = _score(s, side, plane, near)
        if score > most:
            best, most = plane, score
    return best, most


def _at(s: _Samples, side: float, plane: Array, near: float) -> NDArray[np.bool_]:
    limit = s.others @ plane
    return np.asarray((np.abs(s.q - limit) < near) & (side * (s.u - limit) > 3.0 * near))


def _score(s: _Samples, side: float, plane: Array, near: float) -> float:
    limit = s.others @ plane
    beyond = side * (s.q - limit) > 2.0 * near
    return float(np.sum(_at(s, side, plane, near))) - 5.0 * float(np.sum(beyond))
