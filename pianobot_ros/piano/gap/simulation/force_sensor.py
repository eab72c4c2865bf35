"""The force sensor as a hypothesis has it: its gain, its effects' laws, and what they remember of
the session before a strike.

What a sensor was loaded with before is measured, so it is spliced in: the laws are undone over the
readings up to the strike, and go on from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.gap import Effect
from pianobot_ros.piano.gap.effects.base import ForceLaw, Memory, acting
from pianobot_ros.piano.gap.evidence.blocks import StrikeData
from pianobot_ros.piano.twin.reduced.splicing import Session

__all__ = ["ForceSensor"]

PIECE = 25  # readings after which the past is remembered: a tenth of a second


class ForceSensor:
    """``gain`` and the laws of those of the ``effects`` that act on the reading, with ``values``.

    ``key`` is all that its readings depend on: an effect's parameters and nothing else.
    """

    def __init__(self, effects: Sequence[Effect], values: Mapping[str, float]) -> None:
        self.gain = values["fsr_gain"]
        own = acting(effects, ForceLaw)
        self._laws = list(own.values())
        self._values = values
        used = [values[p.name] for e in effects if e.name in own for p in e.parameters]
        self.key: tuple[object, ...] = (*own, *used, self.gain)
        self.bent = bool(self._laws)
        self._past: dict[Session, list[tuple[float, list[Memory]]]] = {}

    def read(self, data: StrikeData, force: Array) -> Array:
        """Reading (n,) N of a force (n,) N on the strike's grid."""
        x = self.gain * force
        for law, memory in zip(self._laws, self._begun(data), strict=True):
            x = law.read(self._values, data.grid, x, memory)
        return x

    def undone(self, data: StrikeData, reading: Array) -> Array:
        """What a reading (n,) N on the strike's grid would be without the laws."""
        return self._undone(data.grid, reading, self._begun(data))

    def _undone(self, t: Array, x: Array, memories: list[Memory]) -> Array:
        for law, memory in zip(self._laws[::-1], memories[::-1], strict=True):
            x = law.unread(self._values, t, x, memory)
        return x

    def _begun(self, data: StrikeData) -> list[Memory]:
        """What the laws remember as a strike begins."""
        found = [Memory() for _ in self._laws]
        if not any(law.lasting for law in self._laws) or data.reading is None:
            return found
        if data.session not in self._past:
            self._past[data.session] = self._remembered(data.session)
        for before, kept in self._past[data.session]:
            if before > data.start:
                break
            for memory, old in zip(found, kept, strict=True):
                memory.state = old.state.copy()
        return found

    def _remembered(self, session: Session) -> list[tuple[float, list[Memory]]]:
        """The laws' memories at moments of the session, in its order."""
        t, y = session.pressed
        memories = [Memory() for _ in self._laws]
        out: list[tuple[float, list[Memory]]] = []
        for cut in np.array_split(np.arange(t.size), max(1, t.size // PIECE)):
            if not cut.size:
                continue
            self._undone(t[cut], y[cut], memories)
            kept = [Memory() for _ in memories]
            for new, old in zip(kept, memories, strict=True):
                new.state = old.state.copy()
            out.append((float(t[cut[-1]]), kept))
        return out
