"""From the key's motion to note events, with the sensing effects that act on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np
from scipy.special import ndtri

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Midi, keyboard
from pianobot_ros.cell.recordings.keystroke import Keystroke
from pianobot_ros.gap import Effect, departures
from pianobot_ros.piano.gap.effects.base import (
    ClockLaw,
    LatencyLaw,
    TriggerLaw,
    VelocityLaw,
    acting,
)
from pianobot_ros.piano.gap.evidence.time_stamps import stamp_parameter
from pianobot_ros.piano.twin.reduced.strike_model import Stroke, key_strokes

__all__ = ["Keystrokes", "NoteSensor", "note_departures"]

Keystrokes = Callable[[Stroke, int, float, Midi], list[Keystroke]]
GROUPS = 500
"""Groups of repeats that are drawn of a distribution: 2000 notes, where a session has dozens."""


class NoteSensor:
    """The key's contacts and the MIDI device as a hypothesis has them: with ``values``, and those
    of the ``effects`` that act there.
    """

    def __init__(self, values: Mapping[str, float], effects: Sequence[Effect]) -> None:
        midi = keyboard().midi
        on, off = midi.trigger_on, midi.trigger_off
        for law in acting(effects, TriggerLaw).values():
            up, down = law.shifts(values)
            on, off = on + up, off + down
        on = max(on, 1e-3)
        self._midi = Midi(
            trigger_on=on,
            trigger_off=min(max(off, 5e-4), on),
            velocity_gain=midi.velocity_gain,
            delay=midi.delay,
        )
        late = sum(values[law.delay] for law in acting(effects, LatencyLaw).values())
        self._delay = midi.delay + values.get(stamp_parameter("midi"), 0.0) + late
        gained = sum(law.skew(values, "midi") for law in acting(effects, ClockLaw).values())
        self._pace = 1.0 + gained  # to first order
        self._gain = midi.velocity_gain * values["midi_velocity_gain"]
        self._laws, self._values = list(acting(effects, VelocityLaw).values()), values

    def events(
        self, stroke: Stroke, note: int, radius: float, keystrokes: Keystrokes = key_strokes
    ) -> dict[str, float]:
        """Count, onset (s since the stroke's start), velocity, hold (s) and release velocity of a
        stroke's note; NaN for what does not happen.

        Clock effects of the MIDI device act here, because events have one time each.
        """
        strokes = keystrokes(stroke, note, radius, self._midi)
        out = {"note.count": float(len(strokes))} | dict.fromkeys(
            ("note.onset", "note.velocity", "note.hold", "note.release"), math.nan
        )
        if not strokes:
            return out
        first = strokes[0]
        begin = (first.onset + self._delay) * self._pace
        end = (first.onset + first.t_hold + self._delay) * self._pace
        out["note.onset"] = begin - stroke.start
        out["note.hold"] = end - begin
        out["note.velocity"] = self._velocity(self._gain * first.v_pre)
        out["note.release"] = self._velocity(self._gain * first.v_rel)
        return out

    def _velocity(self, x: float) -> float:
        if not math.isfinite(x):
            return math.nan
        for law in self._laws:
            x = float(law.velocity(self._values, np.array([x]))[0])
        return min(max(x, 1.0), 127.0)


def note_departures(
    own: float, repeats: int, values: Mapping[str, float], effects: Sequence[Effect]
) -> Array:
    """How far notes are from their repeats (see :func:`~pianobot_ros.gap.departures`), s: a large
    sample (n,) in rising order. ``own``: standard deviation of the moments without any effect, s;
    ``repeats`` of a condition.

    The same random numbers each time, so that it changes smoothly with the values.
    """
    uniform, gaussian = _drawn(repeats)
    late = own * gaussian
    for law in acting(effects, LatencyLaw).values():
        if law.spread:
            late = late + law.spread(values, uniform)
    return np.sort(departures(late).ravel())


@lru_cache
def _drawn(repeats: int) -> tuple[Array, Array]:
    """Of :data:`GROUPS` groups of so many repeats, two uniform numbers (GROUPS, repeats, 2) and a
    Gaussian one (GROUPS, repeats) each.
    """
    uniform = np.random.default_rng(0).random((GROUPS, repeats, 3))
    return uniform[..., :2], np.asarray(ndtri(uniform[..., 2]))
