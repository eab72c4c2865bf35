"""A score by the name of a phrase or a file."""

from __future__ import annotations

from pathlib import Path

from pianobot_ros.cell.errors import ScoreError, unknown_name
from pianobot_ros.cell.numbers.bounded_files import regular_file
from pianobot_ros.cell.numbers.config import config_dir
from pianobot_ros.cell.score.midi_file import read_midi
from pianobot_ros.cell.score.phrase import read_phrase
from pianobot_ros.cell.score.types import Score

__all__ = ["load_score", "phrase_names"]


def phrase_names() -> tuple[str, ...]:
    """Names of the phrases in ``config/phrases``."""
    return tuple(sorted(p.stem for p in (config_dir() / "phrases").glob("*.yaml")))


def load_score(score: str | Path, *, transpose: int = 0, tempo: float = 1.0) -> Score:
    """The score in a file, or the phrase of that name in ``config/phrases``.

    ``transpose`` in semitones; ``tempo`` as a factor on the note lengths' pace. Raises
    :class:`ScoreError` in one line.
    """
    path = Path(score)
    if not path.suffix and regular_file(path) == "does not exist":
        path = config_dir() / "phrases" / f"{score}.yaml"
        if regular_file(path):
            raise ScoreError(
                unknown_name("phrase", str(score), phrase_names())
                + "; or give a .yaml or .mid file"
            )
    if reason := regular_file(path):
        raise ScoreError(
            f"score {path} {reason}: give a phrase (.yaml), a MIDI file (.mid) or one of "
            f"{', '.join(phrase_names())}"
        )
    if path.suffix.lower() in (".yaml", ".yml"):
        return read_phrase(path, transpose=transpose, tempo=tempo)
    if path.suffix.lower() in (".mid", ".midi", ".smf"):
        return read_midi(path, transpose=transpose, tempo=tempo)
    raise ScoreError(f"{path.name} is neither a phrase (.yaml) nor a standard MIDI file (.mid)")
