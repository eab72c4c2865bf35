"""Keystrokes by the MIDI parametrisation of "Data-driven Simulation Framework": Eq. 2, and their
error, Eq. 5.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pianobot_ros.cell.motion.geometry import Midi

__all__ = [
    "PAPER_LAMBDA",
    "Keystroke",
    "NoteEvent",
    "absolute_error",
    "crossing",
    "keystroke_error",
    "keystrokes_from_angle",
    "keystrokes_from_midi",
    "match_keystrokes",
    "midi_velocity",
    "velocity_from_midi",
]

PAPER_LAMBDA = (0.8, 0.2)
"""Weights of dynamics and articulation in the paper's experiment (V-B)."""


@dataclass(frozen=True)
class NoteEvent:
    """A MIDI note event: ``time`` s, ``on``, ``note`` 0 to 127, ``velocity`` 0 to 127."""

    time: float
    on: bool
    note: int
    velocity: int


@dataclass(frozen=True)
class Keystroke:
    """One keystroke. ``onset`` s; ``v_pre``, ``v_rel`` m/s; ``t_hold``, ``t_idle`` s; force N.

    ``radius`` m says for which contact point the speeds are; NaN: the key's usual one, as an
    instrument tells them (see :mod:`pianobot_ros.cell.recordings.contact_radius`). Unknown
    quantities are NaN: ``t_idle`` without a note length, ``peak_force`` without a sensor.
    """

    note: int
    onset: float
    v_pre: float
    v_rel: float
    t_hold: float
    t_idle: float = float("nan")
    peak_force: float = float("nan")
    radius: float = float("nan")

    def with_note_length(self, note_length: float) -> Keystroke:
        """The same keystroke with T_idle = T_N - T_hold (Eq. 2)."""
        return replace(self, t_idle=note_length - self.t_hold)


def midi_velocity(speed: float, midi: Midi) -> int:
    """MIDI velocity 1 to 127 of a key speed (m/s) at the contact point: the nominal linear
    curve.
    """
    return int(np.clip(np.rint(abs(speed) * midi.velocity_gain), 1, 127))


def velocity_from_midi(velocity: int, midi: Midi) -> float:
    """Key speed (m/s) that the nominal curve gives ``velocity``."""
    return velocity / midi.velocity_gain


def keystrokes_from_angle(
    time: ArrayLike, angle: ArrayLike, note: int, radius: float, midi: Midi
) -> list[Keystroke]:
    """Keystrokes of one key from its angle, by the trigger of Fig. 2(c).

    ``time`` and ``angle`` have shape (n,), s and rad; ``radius`` is r of Eq. 2, m. A key still
    down at the end gives none.
    """
    t, a = np.asarray(time, dtype=float), np.asarray(angle, dtype=float)
    strokes: list[Keystroke] = []
    start: tuple[float, float] | None = None
    for i in range(1, len(t)):
        if start is None and a[i - 1] < midi.trigger_on <= a[i]:
            start = crossing(t, a, i, midi.trigger_on)
        elif start is not None and a[i - 1] >= midi.trigger_off > a[i]:
            end, slope = crossing(t, a, i, midi.trigger_off)
            strokes.append(
                Keystroke(note, start[0], radius * start[1], radius * abs(slope), end - start[0])
            )
            start = None
    return strokes


def crossing(t: np.ndarray, a: np.ndarray, i: int, level: float) -> tuple[float, float]:
    """Time and rate at which the angle a (n,) passes ``level`` between samples i - 1 and i.

    The slope between two samples is the rate in their middle; from there it is carried to the
    crossing by the change of slope since the interval before. The slope alone is half a step of
    acceleration off, which makes V_rel of a key let go converge only linearly in the step.
    """
    slope = (a[i] - a[i - 1]) / (t[i] - t[i - 1])
    at = t[i - 1] + (level - a[i - 1]) / slope
    rate = slope
    if i > 1 and t[i - 1] > t[i - 2]:
        before = (a[i - 1] - a[i - 2]) / (t[i - 1] - t[i - 2])
        rate = slope + 2 * (slope - before) / (t[i] - t[i - 2]) * (at - 0.5 * (t[i - 1] + t[i]))
    return float(at), float(rate)


def keystrokes_from_midi(events: Iterable[NoteEvent], midi: Midi) -> list[Keystroke]:
    """Keystrokes from note-on and note-off pairs, in order of onset. A second note-on without
    note-off restarts the note.
    """
    sounding: dict[int, NoteEvent] = {}
    strokes = []
    for event in sorted(events, key=lambda e: e.time):
        if event.on and event.velocity > 0:
            sounding[event.note] = event
        elif (start := sounding.pop(event.note, None)) is not None:
            v_pre, v_rel = (
                velocity_from_midi(start.velocity, midi),
                velocity_from_midi(event.velocity, midi),
            )
            strokes.append(Keystroke(event.note, start.time, v_pre, v_rel, event.time - start.time))
    return sorted(strokes, key=lambda k: k.onset)


def match_keystrokes(
    real: Sequence[Keystroke], sim: Sequence[Keystroke], window: float = 0.5
) -> list[tuple[Keystroke | None, Keystroke | None]]:
    """Pair keystrokes of the same note whose onsets lie within ``window`` s, nearest first; the
    rest stay alone.
    """
    pairs: list[tuple[Keystroke | None, Keystroke | None]] = []
    candidates = sorted(
        (abs(r.onset - s.onset), i, j)
        for i, r in enumerate(real)
        for j, s in enumerate(sim)
        if r.note == s.note and abs(r.onset - s.onset) <= window
    )
    used_real: set[int] = set()
    used_sim: set[int] = set()
    for _, i, j in candidates:
        if i not in used_real and j not in used_sim:
            used_real.add(i)
            used_sim.add(j)
            pairs.append((real[i], sim[j]))
    pairs += [(r, None) for i, r in enumerate(real) if i not in used_real]
    pairs += [(None, s) for j, s in enumerate(sim) if j not in used_sim]
    return sorted(pairs, key=lambda p: (p[0] or p[1]).onset)  # type: ignore[union-attr]


def keystroke_error(
    sim: Keystroke,
    reference: Keystroke,
    weights: tuple[float, float] = PAPER_LAMBDA,
    t_idle: bool = True,
) -> float:
    """Err of Eq. 5 as a fraction. ``t_idle`` False counts T_hold once instead of T_hold and T_idle.

    NaN where a quantity is unknown in either, so that nothing is compared by accident.
    """

    def relative(name: str) -> float:
        wanted = getattr(reference, name)
        return abs(getattr(sim, name) - wanted) / abs(wanted) if wanted else float("nan")

    dynamics = 0.5 * (relative("v_pre") + relative("v_rel"))
    articulation = 0.5 * (relative("t_hold") + relative("t_idle")) if t_idle else relative("t_hold")
    return weights[0] * dynamics + weights[1] * articulation


def absolute_error(sim: Keystroke, reference: Keystroke) -> tuple[float, float]:
    """f_d (m/s) and f_a (s) of Eqs. 3 and 4 as printed: |ΔV_pre| + |ΔV_rel| and |ΔT_hold| +
    |ΔT_idle|. Their weighted sum adds m/s to s, so it is not formed here.
    """

    def apart(name: str) -> float:
        return abs(float(getattr(sim, name)) - float(getattr(reference, name)))

    return apart("v_pre") + apart("v_rel"), apart("t_hold") + apart("t_idle")
