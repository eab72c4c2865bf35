"""Note events of keys from their angles (Fig. 2(c) and Eq. 2)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Midi
from pianobot_ros.cell.recordings.keystroke import Keystroke, NoteEvent, crossing, midi_velocity

__all__ = ["KeyTrigger"]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _passages(
    angle: Array, first: int, force: Array, on: float, off: float, down: Array, peak: Array
) -> Array:
    """Rows (m, 4) of sample, key, whether pressed, and largest force N up to a release: where a key
    passes a trigger in ``angle`` (n, keys) from sample ``first`` on, to which ``force`` (…, keys)
    belongs. ``down`` (keys,) and ``peak`` (keys,) are renewed. In compiled code, as a key that is
    held would cost a look at each of its samples in Python.
    """
    count, (samples, keys) = 0, angle.shape
    found = np.empty((samples * keys, 4))
    for key in range(keys):
        for i in range(force.shape[0]):
            peak[key] = max(peak[key], force[i, key])
        for i in range(max(first, 1), samples):
            before, now = angle[i - 1, key], angle[i, key]
            pressed = not down[key] and before < on <= now
            if pressed or (down[key] and before >= off > now):
                found[count, 0], found[count, 1] = i, key
                found[count, 2], found[count, 3] = pressed, peak[key]
                down[key] = pressed
                count += 1
                if not pressed:
                    peak[key] = 0.0
        if not down[key] and force[-1, key] == 0.0 and angle[-1, key] < off:
            peak[key] = 0.0
    return found[:count]


class KeyTrigger:
    """Note events of all keys, chunk by chunk."""

    def __init__(
        self, notes: tuple[int, ...], radius: Array, midi: Midi, gain: float = 1.0
    ) -> None:
        self.notes, self.radius = notes, radius
        self.set(midi, gain)
        self.reset()

    def set(
        self,
        midi: Midi,
        gain: float,
        law: Callable[[float], float] | None = None,
        late: Callable[[], float] | None = None,
    ) -> None:
        """From now on with these triggers, a velocity gain of ``gain`` times the nominal, a ``law``
        of velocity (what is told, where the nominal curve has x) and events ``late`` s late.
        """
        self.midi, self._gain, self._law, self._late = midi, gain, law, late

    def _told(self, speed: float) -> float:
        """The speed that the nominal curve gives the velocity that is told."""
        gain, x = self.midi.velocity_gain, self._gain * self.midi.velocity_gain * abs(speed)
        return (x if self._law is None else self._law(x)) / gain

    def reset(self) -> None:
        """All keys up."""
        self._time: Array = np.zeros(0)  # of the last two samples
        self._angle: Array = np.zeros((0, len(self.notes)))
        self._down = np.zeros(len(self.notes), dtype=bool)
        self._start: dict[int, tuple[float, float]] = {}
        self._peak = np.zeros(len(self.notes))

    def interrupt(self) -> None:
        """What plays now has lost a part of its time: it ends without a keystroke."""
        self._start.clear()

    def feed(
        self, time: Array, angle: Array, force: Array
    ) -> tuple[list[NoteEvent], list[Keystroke]]:
        """Events and finished keystrokes in the samples ``time`` (n,), ``angle`` and ``force`` (n,
        keys).
        """
        t = np.concatenate([self._time, time])
        # Copies of one kind: for any other numba would compile anew, amid a phrase.
        past = np.array(np.concatenate([self._angle, angle]), order="C")
        events: list[NoteEvent] = []
        strokes: list[Keystroke] = []
        on, off = self.midi.trigger_on, self.midi.trigger_off
        for row in _passages(
            past,
            self._time.size,
            np.array(force, dtype=float, order="C"),
            on,
            off,
            self._down,
            self._peak,
        ).tolist():
            i, key, pressed, peak = int(row[0]), int(row[1]), bool(row[2]), row[3]
            passed = crossing(t, past[:, key], i, on if pressed else off)
            if pressed:
                self._press(key, *passed, events)
            else:
                strokes += self._release(key, *passed, peak, events)
        self._time, self._angle = t[-2:].copy(), past[-2:].copy()
        return sorted(events, key=lambda e: e.time), sorted(strokes, key=lambda s: s.onset)

    def _press(self, key: int, time: float, slope: float, events: list[NoteEvent]) -> None:
        speed = self._told(float(self.radius[key]) * slope)
        time += self._late() if self._late else 0.0
        self._start[key] = time, speed
        events.append(NoteEvent(time, True, self.notes[key], midi_velocity(speed, self.midi)))

    def _release(
        self, key: int, time: float, slope: float, peak: float, events: list[NoteEvent]
    ) -> list[Keystroke]:
        v_rel = self._told(float(self.radius[key]) * slope)
        time += self._late() if self._late else 0.0
        events.append(NoteEvent(time, False, self.notes[key], midi_velocity(v_rel, self.midi)))
        if key not in self._start:
            return []
        onset, v_pre = self._start.pop(key)
        note, hold = self.notes[key], time - onset
        return [Keystroke(note, onset, v_pre, v_rel, hold, peak_force=peak)]
