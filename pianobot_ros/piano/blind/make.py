"""Blind cases: bags of emulated cells, and the answers in another file to which the folder is
committed by a hash.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.piano.blind.folder import MANIFEST
from pianobot_ros.piano.gap.effects import NAMES

if TYPE_CHECKING:
    from pianobot_ros.emulator.plant.cases.case import Case
    from pianobot_ros.piano.gap.diagnosis.investigate import Goal

__all__ = ["SHARES", "WITHHELD", "Design", "commitment", "make_cases"]

SHARES = {"effect": 0.56, "none": 0.12, "parameters": 0.12, "unknown": 0.10, "two": 0.10}
"""Kinds of cases and their share (see ``emulator.plant.draw``)."""
WITHHELD = 1 / 3
"""Share of the cases with one effect of the library whose diagnosis must do without it."""


@dataclass(frozen=True)
class Design:
    """What the cases shall be.

    Attributes:
        cases: how many; kinds are dealt by :data:`SHARES`, families in turn.
        seed: everything else is drawn by it.
        strikes: of each case.
        rig: whether the key's angle is measured.
        magnitude: strength in units of the repeatability floor, log-uniform.
        parameter_error: of the twin's parameters, uniform up to ±.
        laws: those of the plant that an effect may act by.
    """

    cases: int = 120
    seed: int = 0
    strikes: int = 40
    rig: bool = True
    magnitude: tuple[float, float] = (1.0, 10.0)
    parameter_error: float = 0.2
    laws: Sequence[int] = (0, 1, 2)


class _Drawn(NamedTuple):
    """One case before it is played."""

    name: str
    kind: str
    case: Case
    seed: int


def make_cases(
    folder: str | Path,
    answers: str | Path,
    design: Design | None = None,
    *,
    jobs: int = 1,
    goal: Goal | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Write the bags of ``design`` into ``folder`` (which must be new or empty) and the answers to
    the file ``answers``; returns the path of the manifest.

    ``jobs`` processes record. Every case is dealt a family that its diagnosis must do without, the
    true one in :data:`WITHHELD` of the cases of one effect, another else. With a ``goal`` each cell
    is investigated until it is reached, with the whole library, and the results are there at once.
    Only ``answers`` says what was drawn; ``folder`` holds its SHA-256.
    """
    from joblib import Parallel, delayed

    design = design or Design()
    folder, answers = _checked(Path(folder), Path(answers), design)
    folder.mkdir(parents=True, exist_ok=True)
    drawn = _draw(design)
    without = _withhold(drawn, design.seed)
    parallel = Parallel(n_jobs=jobs, return_as="generator_unordered")
    work = (
        delayed(_record)(str(folder / d.name), d.case, d.seed, design.strikes, design.rig, goal)
        for d in drawn
    )
    for i, name in enumerate(parallel(work)):
        if progress:
            progress(f"recorded {name}", (i + 1) / design.cases)
    truths = _truth(drawn)
    secret = {"salt": secrets.token_hex(16), "seed": design.seed, "cases": truths}
    write_whole(answers, json.dumps(secret, indent=1) + "\n")
    manifest = {
        "cases": sorted(truths),
        "commitment": commitment(answers),
        "strikes": design.strikes,
        "rig": design.rig,
        "magnitude": list(design.magnitude),
        "parameter_error": design.parameter_error,
        "laws": list(design.laws),
        # an investigation has the whole library
        "without": {} if goal else dict(zip((d.name for d in drawn), without, strict=True)),
    }
    return write_whole(folder / MANIFEST, json.dumps(manifest, indent=1) + "\n")


def _checked(folder: Path, answers: Path, design: Design) -> tuple[Path, Path]:
    """Folder and answers, if they are where they may be. Raises :class:`ConfigError`."""
    if design.cases < 1:
        raise ConfigError(f"--cases is {design.cases}: give at least 1")
    if folder.exists() and any(folder.iterdir()):
        raise ConfigError(f"{folder} is not empty: give a new folder for the blind cases")
    if answers.resolve().is_relative_to(folder.resolve()):
        raise ConfigError("the answers must not lie in the folder of the cases: give another place")
    return folder, answers


def _draw(design: Design) -> list[_Drawn]:
    from pianobot_ros.emulator.plant.cases.draw import draw_case
    from pianobot_ros.emulator.plant.cases.effects import EFFECTS

    random = np.random.default_rng([design.seed, 0xB11D])
    kinds = _deal(design.cases, random)
    known = [n for n in NAMES if n in EFFECTS]
    foreign = [n for n, e in EFFECTS.items() if not e.in_library]
    turns = {"effect": _turns(known, random), "unknown": _turns(foreign, random)}
    drawn = []
    for i, kind in enumerate(kinds):
        names = [next(turns[kind])] if kind in turns else None
        case = draw_case(
            int(random.integers(2**31)),
            kind,
            magnitude=design.magnitude,
            parameter_error=design.parameter_error,
            names=names,
            laws=design.laws,
        )
        drawn.append(_Drawn(f"case{i:03d}", kind, case, int(random.integers(2**31))))
    return drawn


def _truth(drawn: Sequence[_Drawn]) -> dict[str, dict[str, Any]]:
    """The answers by the cases' names."""
    from pianobot_ros.emulator.plant.cases.effects import EFFECTS

    return {
        name: {
            "kind": kind,
            "effects": dict(case.effects),
            "stages": [EFFECTS[e].stage for e in case.effects],
            "parameters": dict(case.parameters),
            "laws": {e: case.laws.get(e, 0) for e in case.effects},
        }
        for name, kind, case, _ in drawn
    }


def _withhold(drawn: Sequence[_Drawn], seed: int) -> list[str]:
    """For every case the family that its diagnosis must do without. Those of fewest turns come
    first, so that all are withheld in turn, be it as the true one or as another.
    """
    random = np.random.default_rng([seed, 0x717])
    true, other = dict.fromkeys(NAMES, 0), dict.fromkeys(NAMES, 0)
    single = [i for i, d in enumerate(drawn) if d.kind == "effect"]
    chosen: dict[int, str] = {}
    for _ in range(round(WITHHELD * len(single))):
        left = [i for i in random.permutation(single) if i not in chosen]
        i = min(left, key=lambda i: true[next(iter(drawn[i].case.effects))])
        chosen[i] = next(iter(drawn[i].case.effects))
        true[chosen[i]] += 1
    for i, (_, _, case, _) in enumerate(drawn):
        if i not in chosen:
            names = [NAMES[k] for k in random.permutation(len(NAMES))]
            chosen[i] = min((n for n in names if n not in case.effects), key=other.__getitem__)
            other[chosen[i]] += 1
    return [chosen[i] for i in range(len(drawn))]


def _record(
    bag: str, case: Case, seed: int, strikes: int, rig: bool, goal: Goal | None = None
) -> str:
    """Play ``strikes`` strikes drawn by ``seed`` on the emulated cell into a bag, and investigate
    it where there is a ``goal``; returns the bag's name.
    """
    from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes

    write_bag(simulate_commands(standard_strikes(seed, strikes), case, encoder=rig), Path(bag))
    if goal is not None:
        from pianobot_ros.piano.blind.investigated import investigate_case

        investigate_case(Path(bag), case, goal, rig)
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
