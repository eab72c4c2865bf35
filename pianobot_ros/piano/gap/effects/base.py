"""The piano's effects are the engine's :class:`~pianobot_ros.gap.Effect`; here are the kinds of law
that they may have, by the place in the twin where a law acts.

Every function of a law gets the effect's parameter values ``v`` first. Those of signals are causal
and take a last argument ``memory``: with one and the same memory a signal may come in pieces, as in
the live twin; without, it is whole.

Parameters are properties of the cell: they hold in any session (but see :class:`StrikeLaw`). Where
a clock stands is no parameter at all: recordings have their stamps' constants
(``time_stamps.py``), the running twin looks (``session_clocks.py``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.gap import Effect
from pianobot_ros.piano.gap.effects.filters import STATE
from pianobot_ros.piano.twin.reduced.strike_laws import NULLS

__all__ = [
    "Array",
    "ClockLaw",
    "ForceLaw",
    "LatencyLaw",
    "Memory",
    "PressureLaw",
    "StrikeLaw",
    "TriggerLaw",
    "Values",
    "VelocityLaw",
    "WristLaw",
    "acting",
    "mechanics",
    "recall",
    "shifted",
    "states_of",
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
class StrikeLaw:
    """A law inside the strike models: of the stages hand, contact and key.

    Attributes:
        numbers: the numbers of the strike model (``piano/twin/reduced/strike_laws.py``) by name;
            None where the effect's parameters are such numbers themselves.
        side: half the relative joint stiffness that a vacuum reached from less vacuum has over one
            reached from more.
        states: parameters that are no properties of the cell, but say in what state strikes that
            are simulated one by one begin; nobody adopts them, since who simulates a session whole
            has that state himself.
    """

    numbers: Callable[[Values], dict[str, float]] | None = None
    side: Callable[[Values], float] | None = None
    states: frozenset[str] = frozenset()


@dataclass(frozen=True)
class WristLaw:
    """``height(v, t, z, force, memory)``: the wrist's height (n,) m on a uniform grid t (n,) s
    after the nominal servo, z (n,) m, under the contact force (n,) N; ``feels(v)``: within how many
    s it must know that force.
    """

    height: Callable[..., Array]
    feels: Callable[[Values], float] | None = None


@dataclass(frozen=True)
class PressureLaw:
    """``pressure(v, t, p, memory)``: a finger's pressure (n,) Pa at its setpoint p (n,) Pa."""

    pressure: Callable[..., Array]


@dataclass(frozen=True)
class ForceLaw:
    """``read(v, t, f, memory)``: the FSR's reading (n,) N of a force (n,) N; ``unread(v, t, y,
    memory)`` the force behind a reading. One memory serves both: what it was read or undone up to,
    the other goes on from. ``lasting``: it remembers earlier strikes.
    """

    read: Callable[..., Array]
    unread: Callable[..., Array]
    lasting: bool = False


@dataclass(frozen=True)
class VelocityLaw:
    """``velocity(v, x)``: MIDI velocity (n,) from the nominal one."""

    velocity: Callable[[Values, Array], Array]


@dataclass(frozen=True)
class TriggerLaw:
    """``shifts(v)`` of the angles of note-on and note-off, rad."""

    shifts: Callable[[Values], tuple[float, float]]


@dataclass(frozen=True)
class LatencyLaw:
    """``delay``: the parameter that is the delay of note events, s. ``spread(v, u)``: what of it
    (n,) s differs from event to event, by two uniform random numbers each, u (n, 2).
    """

    delay: str
    spread: Callable[[Values, Array], Array] | None = None


@dataclass(frozen=True)
class ClockLaw:
    """``skew(v, device)``: how much a device's clock gains, as a share of its own time."""

    skew: Callable[[Values, str], float]


Law = TypeVar("Law")


def acting(effects: Iterable[Effect], kind: type[Law]) -> dict[str, Law]:
    """The laws of one ``kind`` by the names of their effects, in the order of these."""
    return {e.name: e.law for e in effects if isinstance(e.law, kind)}


def states_of(effect: Effect) -> frozenset[str]:
    """Parameters of the effect that are no properties of the cell (see :class:`StrikeLaw`)."""
    return effect.law.states if isinstance(effect.law, StrikeLaw) else frozenset()


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


def mechanics(effects: Iterable[Effect], values: Values) -> dict[str, float]:
    """Numbers of the strike model with the nuisances and ``effects`` in it. Two laws may move one
    number.
    """
    own = ("joint_stiffness", "joint_damping", "key_stiffness", "key_damping", "key_inertia")
    numbers = NULLS | {name: values[name] for name in own}
    for effect in effects:
        if isinstance(effect.law, StrikeLaw):
            moved = effect.law.numbers
            found = moved(values) if moved else {p.name: values[p.name] for p in effect.parameters}
            for name, x in found.items():
                numbers[name] += x - NULLS[name]
    return numbers
