"""Recordings of a cell: signals, note events and strike marks on one time axis, whatever file they
came from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError, unknown_name
from pianobot_ros.cell.numbers.shown import in_kpa
from pianobot_ros.cell.recordings.keystroke import NoteEvent

__all__ = ["Recording", "Strike", "TimeSeries"]


@dataclass(frozen=True)
class TimeSeries:
    """A sampled signal: ``time`` (n,) s, increasing; ``value`` (n,) or (n, m) in ``unit``."""

    time: Array
    value: Array
    unit: str

    def between(self, start: float, end: float) -> TimeSeries:
        """The samples with start <= time <= end."""
        low, high = np.searchsorted(self.time, [start, end + 1e-12])
        return TimeSeries(self.time[low:high], self.value[low:high], self.unit)


@dataclass(frozen=True)
class Strike:
    """One strike as the conductor announced it (message StrikeMark); times in s on the recording's
    axis.
    """

    index: int
    phrase: str
    condition: str
    finger: str
    note: int
    start: float
    end: float
    speed: float
    depth: float
    hold: float
    pressure: float
    note_length: float

    @property
    def motion(self) -> str:
        """What was played, and how: strikes of one motion are repeats unless it is said
        otherwise.
        """
        return (
            f"{self.finger} {self.note} {self.speed:.2f} m/s {1e3 * self.depth:.0f} mm"
            f" {self.hold:.1f} s {in_kpa(self.pressure)}"
        )


@dataclass(frozen=True)
class Recording:
    """A whole recording.

    ``signals`` by name, ``<cell>/<topic>.<field>``: ``command/wrist.position`` (n, 3) m,
    ``command/vacuum.pressure`` (n, 3)
    Pa, and for each cell ``real`` and ``sim``: ``…/wrist/state.position`` (n, 3) m,
    ``…/wrist/state.rotation`` (n, 3) rotation vector rad, ``…/wrist/state.currents`` (n, 6) A,
    ``…/vacuum/state.setpoint`` and ``….measured`` (n, 3) Pa in the order of thumb, index, middle,
    ``…/fsr.force`` (n,) N, ``…/fsr.counts`` (n,), ``…/key_angle.<note>`` (n,) rad,
    ``…/joint_states.position`` (n, 6) rad. ``command/wrist.rotation`` likewise. ``fsr_note`` is the
    key that carries the force sensor. ``notes`` holds the MIDI events by cell. Time 0 is the first
    message; ``epoch`` is its wall time in s. ``refusals`` are the times, s, from and to which
    commands that the real cell did not obey as given show, and their topics. ``warnings`` says in
    one line each what had to be left out.
    ``corrections`` is the overlay that the twin had adopted meanwhile, as YAML. ``sights`` says by
    topic (``real/fsr``) what its stamps show of the device's clock: when a message was sent, ns
    since the epoch, and its stamp less that, s; of a second's messages the one with the least
    delay.
    """

    signals: dict[str, TimeSeries]
    notes: dict[str, list[NoteEvent]] = field(default_factory=dict)
    strikes: list[Strike] = field(default_factory=list)
    fsr_note: int | None = None
    epoch: float = 0.0
    source: str = ""
    refusals: tuple[tuple[float, float, str], ...] = ()
    warnings: tuple[str, ...] = ()
    corrections: str = ""
    sights: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict)

    def spoilt(self, strike: Strike) -> bool:
        """Whether the real cell did not obey all commands of a strike as given."""
        return any(begin <= strike.end and strike.start <= end for begin, end, _ in self.refusals)

    def signal(self, name: str) -> TimeSeries:
        """The signal ``name``. Raises :class:`RecordingError` naming what is there."""
        if name not in self.signals:
            raise RecordingError(
                f"{self.source or 'recording'}: " + unknown_name("signal", name, self.signals)
            )
        return self.signals[name]
