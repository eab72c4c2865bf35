"""From the key's motion to note events, with the sensing effects that act on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

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

__all__ = ["note_departures", "note_events"]

GROUPS = 500
"""Groups of repeats that are drawn of a distribution: 2000 notes, where a session has dozens."""


def note_events(
    stroke: Stroke,
    note: int,
    radius: float,
    values: Mapping[str, float],
    effects: Sequence[Effect],
    keystrokes: Callable[[Stroke, int, float, Midi], list[Keystroke]] = key_strokes,
) -> dict[str, float]:
    """Count, onset (s since the stroke's start), velocity, hold (s) and release velocity; NaN for
    what does not happen.

    Clock effects of the MIDI device act here, because events have one time each.
    """
    midi = keyboard().midi
    on, off = midi.trigger_on, midi.trigger_off
    for law in acting(effects, TriggerLaw).values():
        up, down = law.shifts(values)
        on, off = on + up, off + down
    on = float(np.clip(on, 1e-3, None))
    off = float(np.clip(off, 5e-4, on))
    shifted = Midi(
        trigger_on=on, trigger_off=off, velocity_gain=midi.velocity_gain, delay=midi.delay
    )
    strokes = keystrokes(stroke, note, radius, shifted)
    out = {"note.count": float(len(strokes))} | dict.fromkeys(
        ("note.onset", "note.velocity", "note.hold", "note.release"), float("nan")
    )
    if not strokes:
        return out
    first = strokes[0]
    stamps = [first.onset, first.onset + first.t_hold]
    delay = (
        midi.delay
        + values.get(stamp_parameter("midi"), 0.0)
        + sum(values[law.delay] for law in acting(effects, LatencyLaw).values())
    )
    stamps = [t + delay for t in stamps]
    gained = sum(law.skew(values, "midi") for law in acting(effects, ClockLaw).values())
    stamps = [t * (1.0 + gained) for t in stamps]  # to first order
    gain = midi.velocity_gain * values["midi_velocity_gain"]
    out["note.onset"] = stamps[0] - stroke.start
    out["note.hold"] = stamps[1] - stamps[0]
    out["note.velocity"] = _velocity(gain * first.v_pre, values, effects)
    out["note.release"] = _velocity(gain * first.v_rel, values, effects)
    return out


def _velocity(x: float, values: Mapping[str, float], effects: Sequence[Effect]) -> float:
    if not np.isfinite(x):
        return float("nan")
    for law in acting(effects, VelocityLaw).values():
        x = float(law.velocity(values, np.array([x]))[0])
    return float(np.clip(x, 1.0, 127.0))


def note_departures(
    own: float, repeats: int, values: Mapping[str, float], effects: Sequence[Effect]
) -> Array:
    """How far notes are from their repeats (see :func:`~pianobot_ros.gap.departures`), s: a large
    sample (n,) in rising order. ``own``: standard deviation of the moments without any effect, s;
    ``repeats`` of a condition.

    The same random numbers each time, so that it changes smoothly with the values.
    """
    uniform = np.random.default_rng(0).random((GROUPS, repeats, 3))
    late = own * ndtri(uniform[..., 2])
    for law in acting(effects, LatencyLaw).values():
        if law.spread:
            late = late + law.spread(values, uniform[..., :2])
    return np.sort(departures(late).ravel())
