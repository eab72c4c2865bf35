"""The two sets of blind cases: what is drawn by their seeds, their bags and their answers."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from foreign_cell.law_table import FAMILIES, IN_LIBRARY, OUTSIDE, Acting
from foreign_cell.size_up import Size, size_up
from foreign_cell.whole_cell import play
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.numbers.nominal import PARAMETERS
from pianobot_ros.emulator.plant.offline import standard_strikes
from pianobot_ros.piano.blind.folder import MANIFEST
from pianobot_ros.piano.blind.make import commitment

__all__ = ["SETS", "DrawnCell", "SetDesign", "draw_set", "make_set"]

STRIKES = 40
EFFECT_CASES, NO_EFFECT_CASES, PARAMETER_CASES, TWO_CASES = 26, 4, 4, 3
PARAMETER_ERROR = 0.1
STRONG_SHARE, LEAST, BAND, MOST = 0.6, 1.0, 3.0, 7.0  # share of at least BAND floors; floors


class SetDesign(NamedTuple):
    """A set: its ``seed``, the share of families that act by their ``second_law``, and which of
    the effects that are ``outside`` of the library it holds, by number.
    """

    seed: int
    second_law: float
    outside: tuple[int, ...]


SETS = {
    "dev": SetDesign(41001, 0.0, (0, 2, 3, 4, 5)),
    "held": SetDesign(90417, 0.75, (1, 6, 2, 4, 0)),
    "second": SetDesign(90418, 0.75, (1, 6, 2, 4, 0)),
    "third": SetDesign(90419, 0.75, (1, 6, 2, 4, 0)),
    "fourth": SetDesign(90420, 0.75, (1, 6, 2, 4, 0)),
}
"""For development, and four held back: scored rarely, never looked into."""


class DrawnEffect(NamedTuple):
    """The family ``name`` by ``law``, to be as large as ``target`` floors."""

    name: str
    law: int
    target: float


class DrawnCell(NamedTuple):
    """One case before it is played: ``seed`` of the cell and its noise, ``strike_seed`` of what it
    plays, ``parameters`` as factors.
    """

    name: str
    kind: str
    effects: tuple[DrawnEffect, ...]
    parameters: dict[str, float]
    seed: int
    strike_seed: int


def draw_set(design: SetDesign) -> list[DrawnCell]:
    """All cases of a set, always the same."""
    random = np.random.default_rng([design.seed, 1])
    drawn = []
    for i, (kind, names) in enumerate(_kinds(design, random)):
        seed, strike_seed = int(random.integers(2**31)), int(random.integers(2**31))
        parameters = {}
        if kind != "none":
            parameters = {
                name: float(1 + random.uniform(-PARAMETER_ERROR, PARAMETER_ERROR))
                for name in PARAMETERS
            }
        effects = tuple(
            DrawnEffect(name, _law(name, design, random), _target(random)) for name in names
        )
        drawn.append(DrawnCell(f"case{i:03d}", kind, effects, parameters, seed, strike_seed))
    return drawn


def _kinds(design: SetDesign, random: np.random.Generator) -> list[tuple[str, list[str]]]:
    """Kinds of the cases and the families at work in each, shuffled."""
    families = [IN_LIBRARY[i] for i in random.permutation(len(IN_LIBRARY))][:EFFECT_CASES]
    kinds = [("effect", [name]) for name in families]
    kinds += [("none", [])] * NO_EFFECT_CASES + [("parameters", [])] * PARAMETER_CASES
    kinds += [("unknown", [OUTSIDE[i]]) for i in design.outside]
    for _ in range(TWO_CASES):
        while True:
            chosen = random.choice(len(IN_LIBRARY), 2, replace=False)
            one, other = (IN_LIBRARY[i] for i in chosen)
            if FAMILIES[one].stage != FAMILIES[other].stage:
                break
        kinds.append(("two", [one, other]))
    return [kinds[i] for i in random.permutation(len(kinds))]


def _law(name: str, design: SetDesign, random: np.random.Generator) -> int:
    if len(FAMILIES[name].phrases) < 2 or random.random() >= design.second_law:
        return 1
    return 2


def _target(random: np.random.Generator) -> float:
    """A size in floors, log-uniform in one of two bands."""
    strong = random.random() < STRONG_SHARE
    low, high = (BAND, MOST) if strong else (LEAST, BAND)
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def make_set(
    folder: Path,
    answers: Path,
    drawn: Sequence[DrawnCell],
    jobs: int = 1,
    progress: Callable[[str, float], None] | None = None,
) -> None:
    """Record the cells ``drawn`` into bags in ``folder``, and write the manifest and the file
    ``answers`` as ``pianobot blind make`` does. Every diagnosis has the whole library.
    """
    from joblib import Parallel, delayed

    folder.mkdir(parents=True, exist_ok=True)
    parallel = Parallel(n_jobs=jobs, return_as="generator")
    truths = {}
    work = (delayed(_record)(str(folder), cell) for cell in drawn)
    for cell, truth in zip(drawn, parallel(work), strict=True):
        truths[cell.name] = truth
        if progress:
            progress(f"recorded {cell.name}", len(truths) / len(drawn))
    answers.write_text(json.dumps({"cases": truths}, indent=1) + "\n", encoding="utf-8")
    manifest = {
        "cases": sorted(truths),
        "commitment": commitment(answers),
        "strikes": STRIKES,
        "without": {},
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")


def _record(folder: str, cell: DrawnCell) -> dict[str, Any]:
    """Size up the effects of a cell, record it, and return its answer."""
    commands = standard_strikes(cell.strike_seed, STRIKES)
    sizes: dict[str, Size] = {}
    for name, law, target in cell.effects:
        sizes[name] = size_up(commands, name, law, target, cell.parameters, cell.seed)
    effects = {e.name: Acting(e.law, sizes[e.name].strength) for e in cell.effects}
    recording = play(commands, effects, cell.parameters, cell.seed)
    write_bag(recording, Path(folder) / cell.name)
    return {
        "kind": cell.kind,
        "effects": {name: round(size.floors, 3) for name, size in sizes.items()},
        "stages": [FAMILIES[e.name].stage for e in cell.effects],
        "law": "; ".join(f"{e.name}: {FAMILIES[e.name].phrases[e.law - 1]}" for e in cell.effects),
        "laws": {e.name: e.law for e in cell.effects},
        "parameters": cell.parameters,
        "strength": {name: size.strength for name, size in sizes.items()},
        "largest_in": {name: size.largest for name, size in sizes.items()},
        "seed": cell.seed,
        "strike_seed": cell.strike_seed,
    }
