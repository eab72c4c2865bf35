"""What a family of structural effects is: the engine's description of it, and the places where its law acts on the twin."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap import Effect, Parameter

__all__ = ["Array", "Family", "Values", "family", "shifted"]

Array = NDArray[np.float64]
Values = Mapping[str, float]

DEVICES = ("wrist", "vacuum", "fsr", "midi")
"""Sources of time stamps in the real cell; the board that reads the FSR also reads the key's angle."""


@dataclass(frozen=True)
class Family:
    """One effect. Every hook is optional and gets the effect's parameter values first.

    ``mechanics(v)`` numbers of the strike model; ``side(v)`` relative joint stiffness that a vacuum reached from less
    vacuum has over one reached from more, half of it; ``wrist(v, t, z, force)`` the wrist's height (n,) m on a uniform grid after
    the nominal servo (``force``: contact force on the wrist, N); ``pressure(v, t, p)`` likewise in Pa; ``read(v, t, f)`` the
    FSR's reading of a force, N; ``unread(v, t, y)`` the force behind a reading; ``velocity(v, x)`` MIDI velocity from the
    nominal one; ``triggers(v)`` shifts of the on and off angle, rad; ``note_delay(v)`` s; ``jitter(v)`` its spread, s;
    ``clock(v, t, device)`` the true time of a stamp.
    """

    effect: Effect
    mechanics: Callable[[Values], dict[str, float]] | None = None
    side: Callable[[Values], float] | None = None
    wrist: Callable[[Values, Array, Array, Array], Array] | None = None
    pressure: Callable[[Values, Array, Array], Array] | None = None
    read: Callable[[Values, Array, Array], Array] | None = None
    unread: Callable[[Values, Array, Array], Array] | None = None
    velocity: Callable[[Values, Array], Array] | None = None
    triggers: Callable[[Values], tuple[float, float]] | None = None
    note_delay: Callable[[Values], float] | None = None
    jitter: Callable[[Values], float] | None = None
    clock: Callable[[Values, Array, str], Array] | None = None

    @property
    def name(self) -> str:
        """Canonical name."""
        return self.effect.name


def family(name: str, stage: str, description: str, parameters: list[Parameter], starts: list[dict[str, float]],
           null: float = 0.0, **hooks: object) -> Family:  # fmt: skip
    """A family whose first parameter is its magnitude."""
    described = tuple(Parameter(p.name, p.nominal, p.low, p.high, p.unit, stage, p.sd, p.log) for p in parameters)
    effect = Effect(name, stage, described, tuple(starts), null=null, description=description)
    return Family(effect, **hooks)  # type: ignore[arg-type]


def shifted(t: Array, x: Array, delay: float) -> Array:
    """x (n,) on the grid t (n,) delayed by ``delay`` s; held at the ends."""
    return np.asarray(np.interp(t - delay, t, x))
