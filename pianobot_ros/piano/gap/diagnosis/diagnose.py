"""From bags to a diagnosis with its report."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.version import code_version
from pianobot_ros.gap import Diagnosis, GapError, Options, diagnose
from pianobot_ros.piano.gap.diagnosis.err_held_out import with_err
from pianobot_ros.piano.gap.diagnosis.proposals import candidate_strikes
from pianobot_ros.piano.gap.diagnosis.settings import options as settings
from pianobot_ros.piano.gap.simulation.corrections import cell_id
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

if TYPE_CHECKING:
    from typing_extensions import Unpack

__all__ = ["Leading", "Progress", "diagnose_bag", "diagnose_recordings", "write_results"]

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the work that is done, 0 to 1."""
Leading = Callable[[tuple[tuple[str, float], ...]], None]
"""Called with the leading effects and their weights so far, best first."""


class How(TypedDict, total=False):
    """Options of :func:`diagnose_recordings`, by keyword."""

    output: str | Path | None
    """Folder for report.html and diagnosis.json; nothing is written where there is none."""
    seed: int
    strikes: int
    """Use at most so many; 0 (the default): all."""
    progress: Progress | None
    budget: int
    """Simulated strikes."""
    threads: int
    """For the rollouts; 1 by default."""
    options: Options | None
    """Of the engine; by default those of the piano cell."""
    without: Sequence[str]
    """Families of the library that the diagnosis must do without."""
    leading: Leading | None
    """Told who leads while the effects are compared."""


def diagnose_bag(path: str | Path | Sequence[str | Path], **how: Unpack[How]) -> Diagnosis:
    """Diagnose one bag or several of the same cell, see :func:`diagnose_recordings`. Raises
    :class:`RecordingError` for a bag that cannot be diagnosed, naming what is missing.
    """
    tell = how.get("progress") or (lambda *_: None)
    paths = [path] if isinstance(path, (str, Path)) else list(path)
    if not paths:
        raise RecordingError("no recording given: name at least one bag")
    recordings = []
    for i, p in enumerate(paths):
        tell(f"reading {Path(p).name}", 0.1 * i / len(paths))
        recordings.append(read_bag(p))
    return diagnose_recordings(recordings, **how)


def diagnose_recordings(recordings: Sequence[Recording], **how: Unpack[How]) -> Diagnosis:
    """Diagnose recordings of the same cell, as :class:`How` says. Raises
    :class:`RecordingError`.
    """
    tell = how.get("progress") or (lambda *_: None)
    leading, output = how.get("leading"), how.get("output")
    seed, without = how.get("seed", 0), how.get("without", ())
    tell("cutting into strikes", 0.1)
    strikes, threads = how.get("strikes", 0), how.get("threads", 1)
    twin = PianoTwin(recordings, strikes=strikes, threads=threads, without=without)

    def pass_on(doing: str, share: float, leaders: tuple[tuple[str, float], ...]) -> None:
        if leading is not None and leaders:
            leading(leaders)
        tell(f"{doing} ({len(twin.blocks)} strikes)", 0.2 + 0.75 * share)

    try:
        found = diagnose(
            twin,
            twin.blocks,
            seed=seed,
            budget=how.get("budget", DIAGNOSIS_BUDGET),
            options=how.get("options") or settings(),
            experiments=candidate_strikes(twin, seed),
            progress=pass_on,
        )
    except GapError as error:
        raise RecordingError(f"{recordings[0].source or 'recording'}: {error}") from error
    found = _signed(with_err(found, twin, seed), twin, recordings, without)
    if output is not None:
        tell("writing the report", 0.95)
        write_results(found, output)
    tell("done", 1.0)
    return found


def _signed(
    found: Diagnosis, twin: PianoTwin, recordings: Sequence[Recording], without: Sequence[str]
) -> Diagnosis:
    """The diagnosis with what its twin warns of, and where it comes from."""
    sources = [r.source for r in recordings if r.source]
    adopted = twin.corrections
    notes = (
        [f"the diagnosis starts from the twin with {', '.join(adopted.names())}, as adopted"]
        if adopted
        else []
    )
    return replace(
        found,
        warnings=(*notes, *twin.warnings, *found.warnings),
        provenance={
            **found.provenance,
            **code_version(),
            "cell": cell_id(),
            "recordings": [_named(Path(s)) for s in sources],
            "strikes": len(twin.blocks),
            **({"adopted": adopted.identity} if adopted else {}),
            **({"without": list(without)} if without else {}),
        },
    )


def _named(bag: Path) -> str:
    """A bag's name; that of its run first where each run has one of that name."""
    return f"{bag.parent.name}/{bag.name}" if bag.name.split("-")[0] == "bag" else bag.name


def _advice(diagnosis: Diagnosis, folder: Path) -> str:
    """How the twin of the cell takes over what was found, if it was anything."""
    if diagnosis.verdict not in ("effect", "parameters"):
        return ""
    return f"In this cell, pianobot adopt {folder} makes it corrections that the twin takes over."


def write_results(diagnosis: Diagnosis, folder: str | Path) -> Path:
    """Write report.html and diagnosis.json into ``folder``, both or, where one cannot be written,
    none; returns the report's path.
    """
    from pianobot_ros.gap.report import write_report

    folder = Path(folder)
    document, report = folder / "diagnosis.json", folder / "report.html"
    parts = {file: file.with_name(f"{file.name}.part") for file in (document, report)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        diagnosis.write_json(parts[document])
        write_report(diagnosis, parts[report], advice=_advice(diagnosis, folder))
        for file, part in parts.items():
            part.replace(file)
    except OSError as error:
        with contextlib.suppress(OSError):
            for part in parts.values():
                part.unlink(missing_ok=True)
        raise RecordingError(f"cannot write the report to {folder}: {error.strerror}") from error
    return report
