"""The force sensor as a hypothesis has it: its gain, its effects' laws, and what they remember of
the session before a strike.

What a sensor was loaded with before is measured, so it is spliced in: the laws are undone over the
readings up to the strike, and go on from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.gap import Effect
from pianobot_ros.piano.gap.effects.base import ForceLaw, Memory, acting
from pianobot_ros.piano.gap.evidence.strike_data import StrikeData
from pianobot_ros.piano.twin.reduced.splicing import Session

__all__ = ["ForceSensor"]


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
        self._past: dict[Session, tuple[Array, list[list[Memory]]]] = {}
        self._at: dict[StrikeData, list[Memory]] = {}

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
        if not any(law.lasting for law in self._laws) or data.reading is None:
            return [Memory() for _ in self._laws]
        if data not in self._at:
            if data.session not in self._past:
                self._past[data.session] = self._remembered(data.session)
            self._at[data] = self._up_to(data)
        return _copies(self._at[data])

    def _up_to(self, data: StrikeData) -> list[Memory]:
        """The laws' memories as a strike begins, from the last moment that is known before it."""
        t, y = data.session.pressed
        moments, kept = self._past[data.session]
        k = max(int(np.searchsorted(moments, data.start, side="right")) - 1, 0)
        rest = slice(int(np.searchsorted(t, moments[k])), int(np.searchsorted(t, data.start)))
        memories = _copies(kept[k])
        if rest.stop > rest.start:
            self._undone(t[rest], y[rest], memories)
        return memories

    def _remembered(self, session: Session) -> tuple[Array, list[list[Memory]]]:
        """Moments (n,) s of the session, its begin and where its strikes are announced, and the
        laws' memories there.
        """
        t, y = session.pressed
        moments = np.unique([t[0], *(s.start for s in session.recording.strikes)])
        cuts = [0, *np.searchsorted(t, moments)]
        memories = [Memory() for _ in self._laws]
        out: list[list[Memory]] = []
        for begin, end in pairwise(cuts):
            if end > begin:
                self._undone(t[begin:end], y[begin:end], memories)
            out.append(_copies(memories))
        return moments, out


def _copies(memories: list[Memory]) -> list[Memory]:
    """Memories of their own with the same states."""
    out = [Memory() for _ in memories]
    for new, old in zip(out, memories, strict=True):
        new.state = old.state.copy()
    return out
