"""The gap by stage after each strike of a recording, as ``gap_diagnoser`` would have said it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.piano.view.tape.from_bag import stage_table
from pianobot_ros.piano.view.tape.tape import StageGaps, Tape

__all__ = ["fill_stages", "stage_history"]

FEWEST = 2  # strikes that a map can be made of
MARGIN = 1.2  # s around the strikes that are looked at


def stage_history(recording: Recording) -> Iterator[StageGaps]:
    """Gap by stage of the nominal twin over the latest eight strikes, strike by strike; strikes
    that no map can be made of are passed over. Takes some 0.1 s of a core a strike.
    """
    from pianobot_ros.piano.gap.diagnosis.live import LATEST, StageMap, stage_map

    strikes = recording.strikes
    for count in range(FEWEST, len(strikes) + 1):
        found = stage_map(_cut(recording, max(0, count - LATEST), count))
        if isinstance(found, StageMap):
            gaps = {name: gap for name, gap, _ in found.stages}
            table = stage_table({"stage_by_phase": found.phases})
            yield StageGaps(strikes[count - 1].end, count, gaps, table)


def fill_stages(recording: Recording, tape: Tape, more: Callable[[], bool] = lambda: True) -> None:
    """Put the stage gaps of a recording on a tape that has none from the live graph, as they are
    found, while there is ``more`` to do.
    """
    first = True
    for found in stage_history(recording):
        with tape.lock:
            tape.stages = [found] if first else [*tape.stages, found]
        first = False
        if not more():
            return


def _cut(recording: Recording, first: int, last: int) -> Recording:
    """What was measured around the strikes from number ``first`` up to before ``last``."""
    strikes = recording.strikes[first:last]
    low, high = strikes[0].start - MARGIN, strikes[-1].end + MARGIN
    signals = {}
    for name, signal in recording.signals.items():
        if not name.startswith("sim/"):
            inside = signal.between(low, high)
            if len(inside.time):
                signals[name] = inside
    notes = [e for e in recording.notes.get("real", ()) if low <= e.time <= high]
    return replace(recording, signals=signals, notes={"real": notes}, strikes=list(strikes))
