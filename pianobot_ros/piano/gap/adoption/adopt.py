"""From a verdict to the corrections that the twin may adopt."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.bounded_files import read_bytes
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.gap.simulation.corrections import (
    NOTHING,
    Correction,
    Corrections,
    cell_id,
    parse_corrections,
)
from pianobot_ros.piano.gap.simulation.description import nuisances

__all__ = ["Adoption", "adoption", "corrections_of", "diagnosis_file", "read_diagnosis"]

SHRINKS = 0.95
"""Largest held-out gap after refitting, of that before, at which the parameters of an unexplained
cell are worth adopting."""
LONGEST = 20_000_000  # bytes of a diagnosis.json


@dataclass(frozen=True)
class Adoption:
    """What follows from a verdict: ``corrections`` (false: nothing to adopt) and ``sentence``, in
    one line.
    """

    corrections: Corrections
    sentence: str


def diagnosis_file(path: Path) -> Path:
    """The diagnosis.json that ``path`` is or holds; a run has it in its folder ``diagnosis``."""
    if not path.is_dir():
        return path
    held = [folder / "diagnosis.json" for folder in (path, path / "diagnosis")]
    return next((file for file in held if file.is_file()), held[0])


def read_diagnosis(path: str | Path) -> dict[str, Any]:
    """A diagnosis.json, or the one that a folder holds (:func:`diagnosis_file`). Raises
    :class:`ConfigError` for what is none.
    """
    path = diagnosis_file(Path(path))
    if not path.exists():
        raise ConfigError(
            f"{path} does not exist: give a diagnosis.json, or the folder that has it"
        )
    data = read_bytes(path, LONGEST)
    try:
        document = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is not valid JSON: {error}") from error
    if not isinstance(document, dict) or not isinstance(document.get("verdict"), str):
        raise ConfigError(f"{path} is no diagnosis: it has no verdict")
    return document


def corrections_of(text: str) -> Corrections:
    """What a request names: the path of an overlay or of a diagnosis, or an overlay itself."""
    if not text.strip():
        raise ConfigError(
            "nothing is given to adopt: give an overlay, its path or a diagnosis.json"
        )
    if "\n" in text:
        return parse_corrections(text)
    path = Path(text)
    if path.is_dir() or path.suffix == ".json":
        found = adoption(read_diagnosis(path))
        if not found.corrections:
            raise ConfigError(found.sentence)
        return found.corrections
    return parse_corrections(read_bytes(path), str(path))


def adoption(document: Mapping[str, Any]) -> Adoption:
    """What to adopt of a diagnosis (the dictionary of diagnosis.json).

    ``none`` adopts nothing; ``unknown`` the parameters, and only where refitting them shrinks the
    held-out gap. Nothing is adopted that makes a measure of held-out strikes worse: the gap or Err
    of Eq. 5, by the 95 % interval of the change. Raises :class:`ConfigError` for a diagnosis of
    another cell and for values that are out of bounds.
    """
    verdict = str(document.get("verdict"))
    provenance = dict(document.get("provenance") or {})
    cell = str(provenance.get("cell") or cell_id())
    if verdict == "none":
        return Adoption(NOTHING, "verdict none: the gap is within the floor, nothing to adopt")
    gap = document.get("gap") or {}
    before, refit = (_finite(gap.get(n)) for n in ("before", "refit"))
    if verdict == "unknown" and not refit < SHRINKS * before:
        return Adoption(
            NOTHING,
            f"verdict unknown: refitting takes the held-out gap from {before:.2f} to {refit:.2f}"
            " floors only, nothing to adopt",
        )
    if worse := _worse(document.get("adopting")):
        return Adoption(NOTHING, f"verdict {verdict}: adopting it {worse}, so nothing is adopted")
    families: dict[str, dict[str, Correction]] = {}
    parameters = _parameters(document.get("parameters"), families)
    for effect in document.get("effects") or []:
        families[str(effect["name"])] = {
            str(n): _correction(p) for n, p in effect["parameters"].items()
        }
    found = Corrections(
        parameters,
        families,
        cell,
        _source(document, provenance),
        _open(document, verdict),
        str(provenance.get("adopted") or ""),
    )
    checked = parse_corrections(found.to_yaml(), "the diagnosis")
    return Adoption(checked, _sentence(checked))


def _worse(measures: Any) -> str:
    """Which measure of strikes that were not fitted grows for certain, in words; "" for none."""
    shown = {"gap": ("the gap", 1.0, " floors"), "err": ("Err", 100.0, " %")}
    for name, (words, factor, unit) in shown.items():
        node = (measures or {}).get(name) or {}
        low, high, before, after = (
            factor * _finite(node.get(n)) for n in ("low", "high", "before", "after")
        )
        if low > 0.0:
            return (
                f"takes {words} of strikes that were not fitted from {before:.2f} to"
                f" {after:.2f}{unit} (95 %: {low:+.2f} to {high:+.2f})"
            )
    return ""


def _parameters(node: Any, families: dict[str, dict[str, Correction]]) -> dict[str, Correction]:
    """The nuisances of the cell; those of effects that were adopted before go to their family.

    What belongs to the recording (the constant errors of its stamps) is left out.
    """
    own = {p.name for p in nuisances()}
    home = {p.name: name for name, f in LIBRARY.items() for p in f.parameters}
    found = {}
    for name, entry in (node or {}).items():
        if name in own:
            found[name] = _correction(entry)
        elif name in home:
            families.setdefault(home[name], {})[name] = _correction(entry)
    return found


def _correction(entry: Mapping[str, Any]) -> Correction:
    value = _finite(entry.get("value"))
    if math.isnan(value):
        raise ConfigError("the diagnosis holds a parameter without a value")
    low, high = _finite(entry.get("low")), _finite(entry.get("high"))
    return Correction(value, low, high, str(entry.get("unit") or "1"))


def _finite(x: Any) -> float:
    return float(x) if isinstance(x, (int, float)) and not isinstance(x, bool) else math.nan


def _source(document: Mapping[str, Any], provenance: Mapping[str, Any]) -> dict[str, Any]:
    names = ("recordings", "strikes", "commit", "version", "date")
    kept = {n: provenance[n] for n in names if provenance.get(n) not in (None, "", [])}
    sentence = " ".join(str(document.get("sentence") or "").split())[:2000]
    return {"verdict": str(document.get("verdict")), "sentence": sentence, **kept}


def _open(document: Mapping[str, Any], verdict: str) -> tuple[str, ...]:
    """What the corrections leave unexplained, in one line each."""
    lines = []
    if verdict == "unknown":
        unknown = document.get("unknown") or {}
        text = " ".join(str(unknown.get("text") or "no member of the library explains it").split())
        lines.append(f"the cause is unknown: {text}"[:2000])
    for group in document.get("inseparable") or []:
        lines.append("cannot be told apart: " + ", ".join(map(str, group)))
    return tuple(lines)


def _sentence(found: Corrections) -> str:
    what = f"{len(found.parameters)} parameters"
    if found.effects:
        what += " and " + ", ".join(found.effects)
    return f"adopts {what}" + (f"; open: {'; '.join(found.open)}" if found.open else "")
