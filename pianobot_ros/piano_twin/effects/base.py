"""What a family of structural effects is: the engine's description of it, and the places where its
law acts on the twin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano_twin.effects.filters import STATE
from pianobot_ros.twin.reduced.strike_laws import NULLS

__all__ = [
    "Array",
    "Family",
    "Memory",
    "Title",
    "Values",
    "by_name",
    "family",
    "mechanics",
    "recall",
    "shifted",
]

Values = Mapping[str, float]

DEVICES = ("wrist", "vacuum", "fsr", "midi")
"""Sources of time stamps in the real cell; the board that reads the FSR also reads the key's angle.
"""


class Memory:
    """What a law remembers between the pieces of a signal; a fresh one before the first piece."""

    def __init__(self) -> None:
        self.state: Array = np.zeros(STATE)
        self.past: tuple[Array, Array] | None = None


def recall(memory: Memory | None) -> Array:
    """The state (STATE,) to go on from; a fresh one for a signal that comes whole."""
    return np.zeros(STATE) if memory is None else memory.state


@dataclass(frozen=True)
class Family:
    """One effect. Every hook is optional and gets the effect's parameter values first.

    The hooks of signals are causal and take a last argument ``memory``: with one and the same
    memory a signal may come in pieces, as in the live twin; without, it is whole.

    ``mechanics(v)`` numbers of the strike model; ``side(v)`` relative joint stiffness that a vacuum
    reached from less vacuum has over one reached from more, half of it; ``wrist(v, t, z, force)``
    the wrist's height (n,) m on a uniform grid after the nominal servo (``force``: contact force on
    the wrist, N); ``feels(v)`` within how many s that law must know the force; ``pressure(v, t,
    p)`` likewise in Pa; ``read(v, t, f)`` the FSR's reading of a force, N; ``unread(v, t, y)`` the
    force behind a reading; ``velocity(v, x)`` MIDI velocity from the nominal one; ``triggers(v)``
    shifts of the on and off angle, rad; ``note_delay(v)`` s;
    ``jitter(v)`` its spread, s; ``skew(v, device)`` how much a device's clock gains, as a share of
    its own time.

    Parameters are properties of the cell: they hold in any session. ``states`` names those that are
    not, but say in what state strikes that are simulated one by one begin; nobody adopts them,
    since who simulates a session whole has that state himself. Where a clock stands is no parameter
    at all: recordings have their stamps' constants (``time_stamps.py``), the running twin looks
    (``session_clocks.py``).
    """

    effect: Effect
    mechanics: Callable[[Values], dict[str, float]] | None = None
    side: Callable[[Values], float] | None = None
    wrist: Callable[..., Array] | None = None
    feels: Callable[[Values], float] | None = None
    pressure: Callable[..., Array] | None = None
    read: Callable[..., Array] | None = None
    unread: Callable[[Values, Array, Array], Array] | None = None
    velocity: Callable[[Values, Array], Array] | None = None
    triggers: Callable[[Values], tuple[float, float]] | None = None
    note_delay: Callable[[Values], float] | None = None
    jitter: Callable[[Values], float] | None = None
    skew: Callable[[Values, str], float] | None = None
    states: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """Canonical name."""
        return self.effect.name


class Title(NamedTuple):
    """What an effect is called: canonical name, the stage in which it acts, and a few words."""

    name: str
    stage: str
    description: str


def by_name(names: Iterable[str], v: Values) -> dict[str, float]:
    """Hook ``mechanics`` of a family whose parameters are themselves numbers of the strike model;
    :func:`family` gives it their ``names``.
    """
    return {name: v[name] for name in names}


def family(
    title: Title,
    parameters: list[Parameter],
    starts: list[dict[str, float]],
    null: float = 0.0,
    **hooks: object,
) -> Family:
    """A family whose first parameter is its magnitude."""
    name, stage, description = title
    described = tuple(
        Parameter(p.name, p.nominal, p.low, p.high, p.unit, stage, p.sd, p.log) for p in parameters
    )
    effect = Effect(name, stage, described, tuple(starts), null=null, description=description)
    if hooks.get("mechanics") is by_name:
        hooks["mechanics"] = partial(by_name, tuple(p.name for p in parameters))
    return Family(effect, **hooks)  # type: ignore[arg-type]


def shifted(t: Array, x: Array, delay: float, memory: Memory | None = None) -> Array:
    """x (n,) on the grid t (n,) delayed by ``delay`` s; held at the ends."""
    if memory is None:
        return np.asarray(np.interp(t - delay, t, x))
    if memory.past is not None:
        new = slice(int(np.searchsorted(t, memory.past[0][-1], side="right")), None)
        past = memory.past[0], memory.past[1]
        all_t, all_x = np.concatenate([past[0], t[new]]), np.concatenate([past[1], x[new]])
    else:
        all_t, all_x = t, x
    first = max(int(np.searchsorted(all_t, t[-1] - delay)) - 1, 0)
    memory.past = all_t[first:].copy(), all_x[first:].copy()
    return np.asarray(np.interp(t - delay, all_t, all_x))


def mechanics(laws: Iterable[Family], values: Values) -> dict[str, float]:
    """Numbers of the strike model with the nuisances and ``laws`` in it. Two laws may move one
    number.
    """
    own = ("joint_stiffness", "joint_damping", "key_stiffness", "key_damping", "key_inertia")
    numbers = NULLS | {name: values[name] for name in own}
    for law in laws:
        if law.mechanics:
            for name, x in law.mechanics(values).items():
                numbers[name] += x - NULLS[name]
    return numbers
