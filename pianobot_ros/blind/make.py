"""Blind cases: bags of emulated cells, and the answers in another file to which the folder is committed by a hash."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell_gap.effects import NAMES

if TYPE_CHECKING:
    from pianobot_ros.emulator.plant.case import Case

__all__ = ["MANIFEST", "SHARES", "commitment", "make_cases"]

MANIFEST = "manifest.json"
SHARES = {"effect": 0.56, "none": 0.12, "parameters": 0.12, "unknown": 0.10, "two": 0.10}
"""Kinds of cases and their share (see ``emulator.plant.draw``)."""


def make_cases(
    folder: str | Path,
    answers: str | Path,
    *,
    cases: int = 120,
    seed: int = 0,
    strikes: int = 40,
    rig: bool = True,
    magnitude: tuple[float, float] = (1.0, 10.0),
    parameter_error: float = 0.2,
    jobs: int = 1,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Write ``cases`` bags into ``folder`` (which must be new or empty) and the answers to the file ``answers``.

    Kinds are dealt by :data:`SHARES`, families in turn, everything else is drawn by ``seed``. ``magnitude``: strength in
    units of the repeatability floor, log-uniform; ``parameter_error``: uniform up to ±; ``jobs`` processes record. Only
    ``answers`` says what was drawn; ``folder`` holds its SHA-256.
    """
    from joblib import Parallel, delayed

    from pianobot_ros.emulator.plant.draw import draw_case
    from pianobot_ros.emulator.plant.effects import EFFECTS

    folder, answers = Path(folder), Path(answers)
    if cases < 1:
        raise ConfigError(f"--cases is {cases}: give at least 1")
    if folder.exists() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty: give a new folder for the blind cases")
    if answers.resolve().is_relative_to(folder.resolve()):
        raise ConfigError("the answers must not lie in the folder of the cases: give another place")
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng([seed, 0xB11D])
    kinds = _deal(cases, random)
    known = [n for n in NAMES if n in EFFECTS]
    foreign = [n for n, e in EFFECTS.items() if not e.in_library]
    turns = {"effect": _turns(known, random), "unknown": _turns(foreign, random)}
    drawn: list[tuple[str, str, Case, int]] = []
    for i, kind in enumerate(kinds):
        names = [next(turns[kind])] if kind in turns else None
        case = draw_case(
            int(random.integers(2**31)), kind, magnitude=magnitude, parameter_error=parameter_error, names=names
        )
        drawn.append((f"case{i:03d}", kind, case, int(random.integers(2**31))))
    parallel = Parallel(n_jobs=jobs, return_as="generator_unordered")
    work = (delayed(_record)(str(folder / name), case, seed, strikes, rig) for name, _, case, seed in drawn)
    for i, name in enumerate(parallel(work)):
        if progress:
            progress(f"recorded {name}", (i + 1) / cases)
    told = {name: {"kind": kind, "effects": dict(case.effects), "stages": [EFFECTS[e].stage for e in case.effects],
                   "parameters": dict(case.parameters)} for name, kind, case, _ in drawn}  # fmt: skip
    text = json.dumps({"salt": secrets.token_hex(16), "seed": seed, "cases": told}, indent=1) + "\n"
    answers.parent.mkdir(parents=True, exist_ok=True)
    answers.write_text(text, encoding="utf-8")
    manifest = {"cases": sorted(told), "commitment": commitment(answers), "strikes": strikes, "rig": rig,
                "magnitude": list(magnitude), "parameter_error": parameter_error}  # fmt: skip
    path = folder / MANIFEST
    path.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return path


def _record(bag: str, case: Case, seed: int, strikes: int, rig: bool) -> str:
    """Play ``strikes`` strikes drawn by ``seed`` on the emulated cell into a bag; returns the bag's name."""
    from pianobot_ros.emulator.offline import simulate_commands, standard_strikes

    write_bag(simulate_commands(standard_strikes(seed, strikes), case, encoder=rig), Path(bag))
    return Path(bag).name


def commitment(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _deal(cases: int, random: np.random.Generator) -> list[str]:
    """So many kinds in their shares (largest remainder), shuffled."""
    exact = {k: s * cases for k, s in SHARES.items()}
    counts = {k: int(x) for k, x in exact.items()}
    for k in sorted(exact, key=lambda k: counts[k] - exact[k])[: cases - sum(counts.values())]:
        counts[k] += 1
    kinds = [k for k, n in counts.items() for _ in range(n)]
    return [kinds[i] for i in random.permutation(cases)]


def _turns(names: list[str], random: np.random.Generator) -> Any:
    """The names in random order, again and again."""
    while True:
        for i in random.permutation(len(names)):
            yield names[i]
