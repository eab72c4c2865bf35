"""Felt as Hunt and Crossley describe contact: force grows with a power of the compression, and the
loss is in proportion to it, so that it neither jumps at touch nor pulls at parting.

    F = k d^p (1 + b d')            d compression, never negative

Stands for the linear spring and damper of coupler, front rail and string in a key with its hammer.
One compiled loop (numba), nothing is allocated in a step. The exact hybrid model
(:mod:`~pianobot_ros.piano.action.hybrid`) keeps the paper's linear laws; this one says what they
cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.action.parameters import ActionParameters

__all__ = ["FELTS", "FeltAction", "FeltHistory", "felt_force", "felts_of"]

STEP = 2e-5  # s: Runge and Kutta's fourth order
COUPLER, RAIL, STRING = range(3)
STIFFNESS, POWER, LOSS = range(3)
FELTS = ("coupler", "front rail", "string")
MASS, DAMPING, SPRING, HAMMER, BUSHING, WEIGHT, DIP, HEIGHT = range(8)


@njit(cache=True)  # type: ignore[untyped-decorator]
def felt_force(depth: float, rate: float, felt: Array) -> float:
    """Force (N) of a ``felt`` (3,): stiffness N/m^p, power, loss s/m; at compression ``depth`` m
    and its ``rate`` m/s. Never pulls.
    """
    if depth <= 0.0:
        return 0.0
    force: float = felt[STIFFNESS] * depth ** felt[POWER] * (1.0 + felt[LOSS] * rate)
    return max(force, 0.0)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _rates(z: Array, push: float, given: float, p: Array, felts: Array, out: Array) -> float:
    """Time derivative of z = (x, x', x_H, x_H') into ``out``; returns the force on the key. With
    ``given`` a number the key's acceleration is imposed, with NaN it follows from ``push``.
    """
    coupler = felt_force(z[0] - z[2], z[1] - z[3], felts[COUPLER])
    rail = felt_force(z[0] - p[DIP], z[1], felts[RAIL])
    string = felt_force(z[2] - p[HEIGHT], z[3], felts[STRING])
    against = p[DAMPING] * z[1] + p[SPRING] * z[0] + coupler + rail
    out[0], out[2] = z[1], z[3]
    out[1] = (push - against) / p[MASS] if np.isnan(given) else given
    out[3] = (coupler - string - p[WEIGHT] - p[BUSHING] * z[3]) / p[HAMMER]
    answer: float = p[MASS] * out[1] + against
    return answer


@njit(cache=True)  # type: ignore[untyped-decorator]
def _run(
    push: Array, given: Array, step: float, p: Array, felts: Array, z: Array, out: Array
) -> None:
    """March over ``push`` (n,) and ``given`` (n,); ``out`` (n, 5): state and force on the key."""
    k1, k2, k3, k4, w = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for i in range(push.size):
        for j in range(4):
            out[i, j] = z[j]
        out[i, 4] = _rates(z, push[i], given[i], p, felts, k1)
        for j in range(4):
            w[j] = z[j] + 0.5 * step * k1[j]
        _rates(w, push[i], given[i], p, felts, k2)
        for j in range(4):
            w[j] = z[j] + 0.5 * step * k2[j]
        _rates(w, push[i], given[i], p, felts, k3)
        for j in range(4):
            w[j] = z[j] + step * k3[j]
        _rates(w, push[i], given[i], p, felts, k4)
        for j in range(4):
            z[j] += step / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j])


def felts_of(p: ActionParameters) -> Array:
    """The felts (3, 3) of coupler, rail and string: as stiff as the linear ones (secant) and as
    lossy (at the usual speed) where the configured force compresses them.
    """
    h, f = p.hammer, p.felt
    linear = (
        (h.coupler_stiffness, h.coupler_damping),
        (p.front_rail.stiffness, p.front_rail.damping),
        (p.string.stiffness, p.string.damping),
    )
    rows = []
    for k, b in linear:
        depth = f.force / k
        rows.append((k * depth ** (1.0 - f.power), f.power, b / f.force))
    return np.array(rows)


@dataclass(frozen=True)
class FeltHistory:
    """Of a run: ``time`` (n,) s; ``key``, ``hammer`` (n,) m with their velocities (m/s); ``force``
    (n,) N that acts on the key.
    """

    time: Array
    key: Array
    key_velocity: Array
    hammer: Array
    hammer_velocity: Array
    force: Array


class FeltAction:
    """Key and hammer with felts (3, 3), by default :func:`felts_of`; ``power`` 1 in all and no
    loss give plain unilateral springs. ``armature`` says whether the rig's moves with the key.
    """

    def __init__(
        self, p: ActionParameters, felts: Array | None = None, *, armature: bool = False
    ) -> None:
        own = p.armature if armature else None
        self.parameters = p
        self.felts = felts_of(p) if felts is None else np.ascontiguousarray(felts, dtype=float)
        self._numbers = np.array(
            [
                p.key.mass + p.key.whippen_mass + (own.mass if own else 0.0),
                p.key.damping + (own.damping if own else 0.0),
                own.stiffness if own else 0.0,
                p.hammer.mass,
                p.hammer.bushing_damping,
                p.hammer.weight,
                p.key.dip,
                p.string.height,
            ]
        )

    def press(self, force: Array, step: float = STEP) -> FeltHistory:
        """Under ``force`` (n,) N at steps of ``step`` s, from rest with the hammer on the felt."""
        return self._march(np.ascontiguousarray(force), np.full(force.size, np.nan), step)

    def follow(self, acceleration: Array, step: float = STEP) -> FeltHistory:
        """With the key's ``acceleration`` (n,) m/s² imposed: its force is the reaction."""
        return self._march(
            np.zeros(acceleration.size), np.ascontiguousarray(acceleration, dtype=float), step
        )

    def _march(self, push: Array, given: Array, step: float) -> FeltHistory:
        stiffness, power, _ = self.felts[COUPLER]
        sunk = (self._numbers[WEIGHT] / stiffness) ** (1.0 / power)
        z = np.array([0.0, 0.0, -sunk, 0.0])
        out = np.zeros((push.size, 5))
        _run(push, given, step, self._numbers, self.felts, z, out)
        time = np.asarray(step * np.arange(push.size), dtype=np.float64)
        return FeltHistory(time, out[:, 0], out[:, 1], out[:, 2], out[:, 3], out[:, 4])
