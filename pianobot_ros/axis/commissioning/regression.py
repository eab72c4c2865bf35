"""Linear regression of effort: first values of inertia, friction, gravity and cogging."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.signals.cleaning import (
    Clean,
    counted,
    motion_noise,
    quantisation,
    unsure_speed,
)
from pianobot_ros.axis.signals.filtering import derivative, low_pass
from pianobot_ros.axis.signals.segment import stretches
from pianobot_ros.gap.problem.types import Array

__all__ = [
    "HELPS",
    "HELPS_ONE",
    "INFLATED",
    "design",
    "effort_of",
    "finest",
    "hanging",
    "held_out",
    "inflation",
    "of_twist",
    "regress",
    "rippling",
    "robust",
    "waves",
]

SOFT = 2.0
"""Residuals of so many typical ones count linearly."""
HELPS, HELPS_ONE = 0.87, 0.75
"""Share of the squared residual that what is taken in may leave, in several logs and in one, whose
effort may only seem to depend on it.
"""
AGAIN, FINEST = 4, 2000.0
"""Passages of two waves on end from which a torque is known to repeat with position, and the waves
per rad that no joint's exceeds.
"""
INFLATED = 5.0
"""Variance inflation from which a coefficient is no longer to be relied on (James et al. 2013, An
Introduction to Statistical Learning, 3.3.3)."""


def design(c: Clean) -> Array:
    """Regressors (n, 6) of effort: inertia, viscous, constant, Coulomb, sine and cosine."""
    slow = max(unsure_speed(c), 1e-9)
    a = c.a if c.model is None else c.a * c.model[:, 2]
    columns = [a, c.v, np.ones(c.v.size), np.tanh(c.v / slow), np.sin(c.q), np.cos(c.q)]
    return np.asarray(np.array(columns).T[:: c.step])


def of_twist(c: Clean) -> Array:
    """Acceleration (n, 1) of the twist between motor and link, which what turns with the link does
    not take part in; (n, 0) where no twist was measured.
    """
    if c.twist is None:
        return np.empty((c.q.size, 0))
    return derivative(derivative(c.twist, c.dt), c.dt)[:, None]


def regress(logs: Sequence[Clean]) -> dict[str, float]:
    """Inertia, viscous and Coulomb friction, gravity and a constant load by robust least squares;
    noise of the encoder's steps does not shrink them. Empty without effort.
    """
    use = [c for c in logs if c.effort is not None]
    if not use:
        return {}
    x, y, _ = effort_of(use)
    steps, noise = (np.max([of(c) for c in use], axis=0) for of in (quantisation, motion_noise))
    beta = robust(x, y, _errors(steps))
    # In a single sine the angle would take the acceleration's place, being measured better.
    errors = _errors(noise)
    whole, plain = robust(x, y, errors), robust(x[:, :4], y, errors[:4])
    hangs = _left(x, y, whole, errors) < HELPS * _left(x[:, :4], y, plain, errors[:4])
    if not hangs and plain[0] > beta[0]:
        beta[0] = plain[0]
    size, speed = float(np.sqrt(np.mean(y**2))), float(np.sqrt(np.mean(x[:, 1] ** 2)))
    acceleration = float(np.sqrt(np.mean(x[:, 0] ** 2)))
    usual = 0.1 * size / max(acceleration, 1e-9)
    if use[0].log.inertia > 0 and use[0].log.effort_unit in ("Nm", "N"):
        usual = use[0].log.inertia
    inertia = float(beta[0]) if beta[0] > 0 else usual
    gravity, angle = hanging(beta[4], beta[5])
    return {
        "inertia": max(inertia, 1e-3 * size / max(acceleration, 1e-9)),
        "viscous": max(float(beta[1]), 0.01 * size / max(speed, 1e-9)),
        "coulomb": max(float(beta[3]), 0.0),
        "gravity": gravity,
        "gravity_angle": angle,
        "constant": float(beta[2]),
    }


def effort_of(use: Sequence[Clean]) -> tuple[Array, Array, list[NDArray[np.bool_]]]:
    """Regressors (n, 6) and effort (n,) of all logs, and which samples of each count."""
    kept = [counted(c)[:: c.step] for c in use]
    x = np.concatenate([design(c)[k] for c, k in zip(use, kept, strict=True)])
    y = np.concatenate([c.own_effort[:: c.step][k] for c, k in zip(use, kept, strict=True)])  # type: ignore[index]
    return x, y, kept


def _errors(noise: Array) -> Array:
    """Variances (6,) of the regressors of `design` by the RMS errors (3,) of q, v and a."""
    return np.array([noise[2] ** 2, noise[1] ** 2, 0, 0, 0, 0])


def _left(x: Array, y: Array, beta: Array, noise: Array) -> float:
    """Mean square that coefficients (k,) leave of y (n,), less what the regressors' own errors, of
    variance `noise` (k,), make of it.
    """
    return float(np.mean((y - x @ beta) ** 2) - beta**2 @ noise)


def hanging(sine: float, cosine: float) -> tuple[float, float]:
    """Size of a gravity, and the angle (rad) at which it hangs, from its parts that go with the
    angle's sine and cosine.
    """
    return float(np.hypot(sine, cosine)), float(math.atan2(-cosine, sine))


def robust(x: Array, y: Array, noise: Array) -> Array:
    """Coefficients (k,) of y (n,) on x (n, k) with Huber weights; `noise` (k,) is the variance of
    the regressors' errors.
    """
    norm = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    z, share = x / norm, np.minimum(noise / norm**2, 0.5)
    weight = np.ones(y.size)
    beta = np.zeros(x.shape[1])
    for _ in range(4):
        gram = (z.T * weight) @ z / weight.sum()
        gram += np.diag(1e-6 - share)
        beta = np.linalg.lstsq(gram, (z.T * weight) @ y / weight.sum(), rcond=1e-9)[0]
        off = np.abs(y - z @ beta)
        limit = SOFT * 1.48 * float(np.median(off)) + 1e-12
        weight = np.minimum(1.0, limit / np.maximum(off, 1e-300))
    return np.asarray(beta / norm)


def waves(logs: Sequence[Clean], high: float, count: int = 3) -> list[float]:
    """Spatial frequencies (per rad) up to `high` where the effort's residual has most power, by
    least squares on a grid.
    """
    use = [c for c in logs if c.effort is not None]
    if not use:
        return [8.0, 24.0]
    x = np.concatenate([design(c) for c in use])
    y = np.concatenate([np.asarray(c.own_effort)[:: c.step] for c in use])
    q = np.concatenate([c.q[:: c.step] for c in use])
    r = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    travel = max(float(np.ptp(q)), 1e-3)
    low = max(2.5, 1.5 * 2 * np.pi / travel)
    grid = np.arange(low, max(high, low + 1.0 / travel), 0.5 / travel)[:6000]
    stride = max(1, q.size // 4000)
    qs, rs = q[::stride], r[::stride]
    power = np.array([np.abs(np.sum(rs * np.exp(-1j * w * qs))) for w in grid])
    chosen: list[float] = []
    for k in np.argsort(-power):
        if all(abs(grid[k] - w) > 2.0 * 2 * np.pi / travel for w in chosen):
            chosen.append(float(grid[k]))
        if len(chosen) == count:
            break
    return chosen or [8.0]


def finest(logs: Sequence[Clean]) -> float:
    """The highest spatial frequency (per rad) of which the joint passes two waves on end, `AGAIN`
    times and more, so slowly that the smoothed signals hold them; `FINEST` at most.

    Of finer ones each start and each stop shows a part, with a phase of its own, and nothing tells
    that it repeats: any weight would explain what a joint does before it is under way.
    """
    for w in np.geomspace(FINEST, 2.5, 60):
        passed = 0
        for c in logs:
            speed = np.abs(c.v)
            slow = (speed > unsure_speed(c)) & (speed * w < 2.0 * np.pi * c.cutoff) & c.valid
            first, last = stretches(slow).T
            ways = np.abs(c.q[last - 1] - c.q[first])
            passed += int(np.sum(np.floor(ways * w / (4.0 * np.pi))))
        if passed >= AGAIN:
            return float(w)
    return 2.5


def rippling(logs: Sequence[Clean], candidates: Sequence[float]) -> dict[str, float]:
    """Cogging at one of the spatial frequencies (per rad), by robust least squares beside inertia,
    friction and gravity; empty where it does not help these.
    """
    use = [c for c in logs if c.effort is not None]
    if not use:
        return {}
    x, y, kept = effort_of(use)
    best, found = HELPS * _left(x, y, robust(x, y, np.zeros(6)), np.zeros(6)), dict[str, float]()
    for w in candidates:
        pairs = [
            np.stack([low_pass(of(w * c.position), c.dt, c.cutoff) for of in (np.sin, np.cos)], 1)
            for c in use
        ]
        wave = [z[:: c.step][k] for z, c, k in zip(pairs, use, kept, strict=True)]
        both = np.hstack([x, np.concatenate(wave)])
        beta = robust(both, y, np.zeros(8))
        left = _left(both, y, beta, np.zeros(8))
        if left < best:
            size, phase = float(np.hypot(*beta[6:])), math.atan2(beta[7], beta[6])
            best, found = left, {"cogging": size, "cogging_waves": w, "cogging_phase": phase}
    return found


def inflation(of: Array, beside: Array) -> Array:
    """Variance inflation factors (k,) of regressors `of` (n, k) beside others (n, m), a constant
    among these.
    """
    left = of - beside @ np.linalg.lstsq(beside, of, rcond=None)[0]
    return np.asarray(np.var(of, axis=0) / np.maximum(np.var(left, axis=0), 1e-300))


def held_out(x: Array, y: Array, fold: Array) -> float:
    """Mean squared residual where each fold is predicted from the others; a little ridge."""
    z = x / (np.sqrt(np.mean(x**2, axis=0)) + 1e-12)
    left = np.empty(y.size)
    for k in np.unique(fold):
        a, b = fold != k, fold == k
        gram = z[a].T @ z[a] + 1e-3 * a.sum() * np.eye(z.shape[1])
        left[b] = y[b] - z[b] @ np.linalg.solve(gram, z[a].T @ y[a])
    return float(np.mean(np.minimum(left**2, 9.0 * np.median(left**2))))
