"""From bags to a diagnosis with its report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from pianobot_ros.bags.read import read_bag
from pianobot_ros.cell.budget import DIAGNOSIS_BUDGET
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recording import Recording
from pianobot_ros.cell_gap.proposals import candidate_strikes
from pianobot_ros.cell_gap.settings import OPTIONS
from pianobot_ros.cell_gap.twin import PianoTwin
from pianobot_ros.gap import Diagnosis, GapError, Options, diagnose

__all__ = ["Progress", "diagnose_bag", "diagnose_recordings", "write_results"]

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the work that is done, 0 to 1."""


def diagnose_bag(
    path: str | Path | Sequence[str | Path],
    *,
    output: str | Path | None = None,
    seed: int = 0,
    strikes: int = 0,
    progress: Progress | None = None,
    budget: float = DIAGNOSIS_BUDGET,
    threads: int = 1,
    options: Options | None = None,
) -> Diagnosis:
    """Diagnose one bag or several of the same cell.

    ``output``: folder for report.html and diagnosis.json (None: nothing is written); ``strikes``: use at most so many (0:
    all); ``budget``: wall time in s; ``threads`` for the rollouts. Raises :class:`RecordingError` for a bag that cannot be
    diagnosed, naming what is missing.
    """
    tell = progress or (lambda *_: None)
    paths = [path] if isinstance(path, (str, Path)) else list(path)
    if not paths:
        raise RecordingError("no recording given: name at least one bag")
    recordings = []
    for i, p in enumerate(paths):
        tell(f"reading {Path(p).name}", 0.1 * i / len(paths))
        recordings.append(read_bag(p))
    return diagnose_recordings(
        recordings,
        output=output,
        seed=seed,
        strikes=strikes,
        progress=progress,
        budget=budget,
        threads=threads,
        options=options,
    )


def diagnose_recordings(
    recordings: Sequence[Recording],
    *,
    output: str | Path | None = None,
    seed: int = 0,
    strikes: int = 0,
    progress: Progress | None = None,
    budget: float = DIAGNOSIS_BUDGET,
    threads: int = 1,
    options: Options | None = None,
) -> Diagnosis:
    """As :func:`diagnose_bag`, for recordings in memory."""
    tell = progress or (lambda *_: None)
    tell("cutting into strikes", 0.1)
    twin = PianoTwin(recordings, strikes=strikes, threads=threads)
    tell(f"diagnosing {len(twin.blocks)} strikes", 0.2)
    try:
        found = diagnose(
            twin,
            twin.blocks,
            seed=seed,
            budget=budget,
            options=options or OPTIONS,
            experiments=candidate_strikes(twin, seed),
        )
    except GapError as error:
        raise RecordingError(f"{recordings[0].source or 'recording'}: {error}") from error
    sources = [r.source for r in recordings if r.source]
    found = replace(
        found,
        warnings=(*twin.warnings, *found.warnings),
        provenance={**found.provenance, "recordings": [Path(s).name for s in sources], "strikes": len(twin.blocks)},
    )
    if output is not None:
        tell("writing the report", 0.95)
        write_results(found, output)
    tell("done", 1.0)
    return found


def write_results(diagnosis: Diagnosis, folder: str | Path) -> Path:
    """Write report.html and diagnosis.json into ``folder``; returns the report's path."""
    from pianobot_ros.report import write_json, write_report

    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_json(diagnosis, folder / "diagnosis.json")
        return write_report(diagnosis, folder / "report.html")
    except OSError as error:
        raise RecordingError(f"cannot write the report to {folder}: {error.strerror}") from error
