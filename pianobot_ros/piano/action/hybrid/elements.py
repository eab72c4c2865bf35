"""Building blocks of the hybrid action: spring-damper elements, switching rules, and the linear
modes they span.

The state is z = [x, x', x_H, x_H', s, 1, F, F'] (SI): key, hammer, a memory that the backcheck
uses, the constant that carries offsets, and the driving force with its slope. Every mode is then z'
= A z with no input, and a matrix exponential solves it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.cell.arrays import Array

__all__ = [
    "FORCE",
    "HAMMER",
    "HAMMER_VELOCITY",
    "KEY",
    "KEY_VELOCITY",
    "MEMORY",
    "ONE",
    "SIZE",
    "SLOPE",
    "Bodies",
    "Element",
    "Mode",
    "Rule",
    "row",
]

Mode = frozenset[str]  # names of the active elements, and of latches such as "jack"

KEY, KEY_VELOCITY, HAMMER, HAMMER_VELOCITY, MEMORY, ONE, FORCE, SLOPE = range(8)
SIZE = 8


def row(coefficients: Mapping[int, float]) -> Array:
    """A linear functional of z from its non-zero ``coefficients``."""
    out = np.zeros(SIZE)
    for index, value in coefficients.items():
        out[index] = value
    return out


@dataclass(frozen=True)
class Element:
    """A spring and damper along a direction of (x, x_H): force f = preload + k d + b d', with d =
    direction . (x, x_H) - offset.

    While active it acts on the key with -f direction[0] and on the hammer with -f direction[1].
    ``remembers`` takes the offset from the memory state instead. Units m, N, N/m, N*s/m.
    """

    name: str
    direction: tuple[float, float]
    offset: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    preload: float = 0.0
    remembers: bool = False

    @property
    def stretch(self) -> Array:
        """Functional that gives d [m]."""
        x, h = self.direction
        if self.remembers:
            return row({KEY: x, HAMMER: h, MEMORY: -1.0})
        return row({KEY: x, HAMMER: h, ONE: -self.offset})

    @property
    def rate(self) -> Array:
        """Functional that gives d' [m/s]."""
        return row({KEY_VELOCITY: self.direction[0], HAMMER_VELOCITY: self.direction[1]})

    @property
    def force(self) -> Array:
        """Functional that gives f [N]."""
        return self.stiffness * self.stretch + self.damping * self.rate + row({ONE: self.preload})

    def stored(self, z: Array) -> Array:
        """Energy [J] that the element can give back, for states ``z`` (..., 8)."""
        stretch = np.maximum(z @ self.stretch, 0.0)
        return np.asarray(0.5 * self.stiffness * stretch**2 + self.preload * stretch)


@dataclass(frozen=True)
class Rule:
    """A switching rule: where all of ``needs`` and none of ``bars`` are in the mode, it fires as
    soon as all guards exceed 0.

    It then removes ``removes`` from the mode and adds ``adds``; with ``remembers`` it stores that
    functional in the memory.
    """

    name: str
    guards: tuple[Array, ...]
    needs: Mode = frozenset()
    bars: Mode = frozenset()
    adds: Mode = frozenset()
    removes: Mode = frozenset()
    remembers: Array | None = field(default=None)

    def applies(self, mode: Mode) -> bool:
        """Whether the rule can fire in ``mode``."""
        return self.needs <= mode and not (self.bars & mode)

    def apply(self, mode: Mode, z: Array) -> tuple[Mode, Array]:
        """Mode and state right after firing."""
        state = z.copy()
        if self.remembers is not None:
            state[MEMORY] = self.remembers @ z
        return (mode - self.removes) | self.adds, state


@dataclass(frozen=True)
class Bodies:
    """The two bodies and what always acts on them: flexure and dampers to ground, the hammer's
    weight (SI).
    """

    mass: float
    damping: float
    stiffness: float
    home: float
    hammer_mass: float
    hammer_damping: float
    hammer_weight: float

    def dynamics(self, active: list[Element]) -> Array:
        """A (8, 8) of z' = A z with the elements ``active``."""
        a = np.zeros((SIZE, SIZE))
        a[KEY, KEY_VELOCITY] = a[HAMMER, HAMMER_VELOCITY] = a[FORCE, SLOPE] = 1.0
        key = row(
            {
                KEY: -self.stiffness,
                KEY_VELOCITY: -self.damping,
                ONE: self.stiffness * self.home,
                FORCE: 1.0,
            }
        )
        hammer = row({HAMMER_VELOCITY: -self.hammer_damping, ONE: -self.hammer_weight})
        for element in active:
            key = key - element.direction[0] * element.force
            hammer = hammer - element.direction[1] * element.force
        a[KEY_VELOCITY] = key / self.mass
        a[HAMMER_VELOCITY] = hammer / self.hammer_mass
        return a

    def energy(self, z: Array) -> Array:
        """Kinetic energy, flexure and hammer height [J] for states ``z`` (..., 8)."""
        return np.asarray(
            0.5 * self.mass * z[..., KEY_VELOCITY] ** 2
            + 0.5 * self.hammer_mass * z[..., HAMMER_VELOCITY] ** 2
            + 0.5 * self.stiffness * (z[..., KEY] - self.home) ** 2
            + self.hammer_weight * z[..., HAMMER]
        )
