"""A bag, and the diagnosis beside it, as a tape."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pianobot_ros.bags.message_types import typestore
from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.piano.view.tape.strike_rows import strike_rows
from pianobot_ros.piano.view.tape.tape import CELLS, STREAMS, Fault, GapTable, StageGaps, Tape

__all__ = ["Loaded", "find_diagnosis", "load_tape", "stage_table", "tape_of", "with_twin"]

HOLE = 0.3  # s without a message of a stream that counts as a fault
DIAGNOSIS = "diagnosis.json"


class Loaded(NamedTuple):
    """A bag as a ``tape``, the times in s at which it begins and ends, and the ``recording``."""

    tape: Tape
    span: tuple[float, float]
    recording: Recording


def load_tape(path: str | Path) -> Loaded:
    """The tape of a bag with the gap as it was seen live and a ``diagnosis.json`` beside it.

    A bag without the simulated cell gets the twin's answer to its commands. Raises
    :class:`RecordingError` for what is no bag of a cell.
    """
    path = Path(path)
    recording = with_twin(read_bag(path))
    tape = tape_of(recording)
    _live_gaps(path, tape)
    if (file := find_diagnosis(path)) is not None:
        try:
            document = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise RecordingError(f"{file} is no diagnosis: {error}") from error
        if not isinstance(document, dict) or "verdict" not in document:
            raise RecordingError(f"{file} is no diagnosis: it has no verdict")
        tape.verdicts = [(-np.inf, document)]
        report = file.with_name("report.html")
        tape.report = str(report) if report.exists() else ""
        if not tape.stages:
            tape.stages = [_stages_of(document, len(tape.rows), -np.inf)]
    ends = [(s.time[0], s.time[-1]) for s in recording.signals.values() if len(s.time)]
    if not ends:
        raise RecordingError(f"{path} holds no samples of a cell: there is nothing to see")
    span = float(min(e[0] for e in ends)), float(max(e[1] for e in ends))
    return Loaded(tape, span, recording)


def find_diagnosis(path: Path) -> Path | None:
    """``diagnosis.json`` in the bag's directory, beside it, or in a folder ``diagnosis`` there."""
    folder = path if path.is_dir() else path.parent
    places = (folder, folder.parent, folder / "diagnosis", folder.parent / "diagnosis")
    return next((p / DIAGNOSIS for p in places if (p / DIAGNOSIS).is_file()), None)


def with_twin(recording: Recording) -> Recording:
    """The recording, with the twin's answer to its commands where the simulated cell is missing."""
    if any(name.startswith("sim/") for name in recording.signals):
        return recording
    if "command/wrist.position" not in recording.signals:
        return recording
    from pianobot_ros.piano.twin.stepping.rollout import play

    print("the bag holds no simulated cell: the twin plays its commands …", file=sys.stderr)
    commands = Commands.from_recording(recording)
    start = float(commands.time[0])
    shifted = replace(
        commands,
        time=commands.time - start,
        vacuum_time=np.maximum(commands.vacuum_time - start, 0.0),
    )
    found = play(shifted).recording(shifted, recording.fsr_note or 64)
    sim = {
        name: replace(signal, time=signal.time + start)
        for name, signal in found.signals.items()
        if name.startswith("sim/")
    }
    if (vacuum := recording.signals.get("command/vacuum.pressure")) is not None:
        held = np.arange(vacuum.time[0], found.signals["sim/wrist/state.position"].time[-1], 0.05)
        at = np.searchsorted(vacuum.time, held + 1e-9, side="right") - 1
        sim["sim/vacuum/state.measured"] = replace(vacuum, time=held, value=vacuum.value[at])
    notes = [replace(e, time=e.time + start) for e in found.notes["sim"]]
    return replace(
        recording, signals=recording.signals | sim, notes={**recording.notes, "sim": notes}
    )


def tape_of(recording: Recording) -> Tape:
    """Everything in a recording that the page shows."""
    tape = Tape(epoch=recording.epoch, fsr_note=recording.fsr_note)
    for name, signal in recording.signals.items():
        if name.startswith(CELLS):
            tape.add(name, signal.time, signal.value)
    for cell in CELLS:
        tape.notes[cell] = sorted(recording.notes.get(cell, ()), key=lambda e: e.time)
    tape.strikes = list(recording.strikes)
    tape.rows = strike_rows(recording)
    tape.faults = _faults(recording, tape)
    tape.remarks = tuple(recording.warnings)
    return tape


def _faults(recording: Recording, tape: Tape) -> list[Fault]:
    """Streams that fell silent amid the recording, and keys that did not sound."""
    found = []
    for cell in CELLS:
        for stream in STREAMS:
            names = [n for n in recording.signals if n.startswith(f"{cell}/{stream}.")]
            for time in [recording.signals[n].time for n in names[:1]]:
                for i in np.flatnonzero(np.diff(time) > HOLE).tolist():
                    text = f"/{cell}/{stream} silent for {time[i + 1] - time[i]:.1f} s"
                    found.append(Fault(float(time[i]), float(time[i + 1]), text))
    for row in tape.rows:
        for cell, stroke in (("real", row.real), ("sim", row.sim)):
            if stroke is None:
                text = f"strike {row.index + 1}: the {cell} key did not sound"
                found.append(Fault(row.start, row.time, text))
    return sorted(found, key=lambda f: f.time)


def _live_gaps(path: Path, tape: Tape) -> None:
    """What ``gap_diagnoser`` said while the bag was recorded, and what the twin had adopted."""
    store = typestore()
    adopted: list[tuple[float, tuple[str, ...]]] = []
    for raw in read_raw(path):
        if not raw.topic.endswith(("/gap/diagnosis", "/gap/live")):
            continue
        message = store.deserialize_cdr(raw.data, raw.type)
        time = raw.log_time * 1e-9 - tape.epoch
        if raw.topic.endswith("/gap/live"):
            adopted.append((time, tuple(message.adopted)))
            continue
        strike = sum(row.time <= time for row in tape.rows)
        document = json.loads(message.json) if message.json else {}
        gaps = {s.name: float(s.gap) for s in message.stages}
        if not gaps:  # who leads while a diagnosis runs
            continue
        tape.stages.append(StageGaps(time, strike, gaps, stage_table(document)))
        tape.said.append((time, message.sentence))
        if message.verdict:
            tape.verdicts.append((time, document))
    for i, row in enumerate(tape.rows):  # a strike is compared once it is over
        names = next((names for time, names in adopted if time >= row.time), ())
        tape.rows[i] = replace(row, adopted=names)


def stage_table(document: Mapping[str, Any]) -> GapTable | None:
    """The map stage × phase of a diagnosis, if it holds one."""
    found = document.get("stage_by_phase")
    if not found:
        return None
    values = np.array(
        [[np.nan if v is None else v for v in row] for row in found["values"]], dtype=float
    )
    return GapTable(tuple(found["rows"]), tuple(found["columns"]), values)


def _stages_of(document: Mapping[str, Any], strikes: int, time: float) -> StageGaps:
    gaps = {s["name"]: np.nan if s["gap"] is None else s["gap"] for s in document.get("stages", ())}
    return StageGaps(time, strikes, gaps, stage_table(document))
