"""Calibrate the diagnosis of the piano cell: cells with known causes are diagnosed, and what turns
scores into probabilities and credible sets is learned from them and written to one file.

python benchmarks/calibrate.py --cases 40 --seed 611 --laws 0,1 --keep DIR --out FILE

Learned are the constants of `TRIED`, among them η = 1 / temperature, one for series and one for
events, of p(h) ∝ prior · exp(η · held-out score) (Grünwald and van Ommen 2017), by the mean log
probability of the truth. One constant moves at a time, from what is set, and only while the gain
exceeds one standard error over cells: what the cells do not determine stays. Learned, too, is the
mass that a credible set must hold, by group of first answers, so that 95 % of the cells are covered
(adaptive prediction sets: Romano, Sesia and Candès 2020). Every cell counts twice where it has one
effect of the library: as it is, and without the hypotheses that hold the true effect, where
*unknown* or a declared relative is the truth. With `--narrow` every cell is diagnosed once more, by
a library whose laws have nothing but their size to fit: its laws are as far from the plant's as
they may be from a robot's, and what a law of the right kind leaves is learned from it. How well all
this does is measured on cells that were left out of the learning, in turn; the file is written only
if that is better than what is set.

The studies are kept in DIR (some 140 MB a cell), and a cell that is there is not diagnosed again;
cells that `pianobot blind make` made are taken as well (DIR/cases and DIR/answers.json).
"""

from __future__ import annotations

import argparse
import copy
import json
import math
import pickle
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.config import config_dir
from pianobot_ros.cell.version import code_version
from pianobot_ros.emulator.plant.laws.table import HELD_BACK
from pianobot_ros.gap import Effect
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.posterior.probabilities import posterior
from pianobot_ros.gap.posterior.verdict import LEVEL, group_of
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.options import Calibration
from pianobot_ros.gap.search.study import Study
from pianobot_ros.piano.blind import Design, make_cases
from pianobot_ros.piano.blind.folder import read_manifest
from pianobot_ros.piano.blind.reliability import calibration_error
from pianobot_ros.piano.gap.diagnosis.relatives import relatives_of
from pianobot_ros.piano.gap.diagnosis.settings import CALIBRATION, prior_options
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

TRIED: Mapping[str, tuple[float, ...]] = {
    "temperature": (4.0, 8.0, 15.0, 30.0, 60.0, 120.0),
    "event_temperature": (2.0, 4.0, 8.0, 16.0),
    "law_precision": (0.003, 0.01, 0.03),
    "effect_log_odds": (-4.0, -3.0, -2.0, -1.0, 0.0),
    "pair_log_odds": (-5.0, -4.0, -3.0, -2.0, -1.0),
    "hidden": (2.0, 4.0, 8.0, 16.0, 32.0),
    "imprecision": (0.05, 0.1, 0.2, 0.3, 0.4),
    "unknown_slope": (1.0, 1.5, 2.0, 3.0),
    "unknown_near": (0.15, 0.3, 0.6),
    "mimic": (0.02, 0.04, 0.06, 0.09, 0.13),
    "pair_share": (0.1, 0.15, 0.25, 0.4),
    "complete": (5.0, 10.0, 20.0, 40.0, 80.0),
}
"""Values that are tried of each constant of `gap.options.Calibration`."""
LEAST = 1e-3
"""Probability of the truth below which it costs no more: no cell may decide alone."""
ENOUGH = 20
"""Views of a group that a threshold of its own needs (95 % of fewer is all of them)."""
PARTS = 5
"""Parts of the cells that are left out in turn."""

Point = Mapping[str, float]
Losses = Callable[[Point], Array]


@dataclass(frozen=True)
class View:
    """One cell, seen with the whole library or without its cause. `names`: what is true, all of
    which a credible set must hold (of relatives `any_of` them).
    """

    cell: str
    names: tuple[str, ...]
    any_of: bool
    study: Study


@dataclass(frozen=True)
class Answer:
    """What is said of a view: the `first` answer with its probability, whether it is `right`, the
    probability of the `truth`, and the mass that comes `before` it in a credible set.
    """

    first: str
    probability: float
    right: bool
    truth: float
    before: float


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=611, help="a development seed: 1 to 999")
    parser.add_argument("--laws", default="0,1", help="laws of the plant; the others stay unseen")
    parser.add_argument("--budget", type=int, default=40_000, help="simulated strikes for a cell")
    parser.add_argument("--most", type=int, help="diagnose at most so many cells now (0: none)")
    parser.add_argument("--narrow", action="store_true", help="with narrow laws, too")
    parser.add_argument("--jobs", type=int, default=1, help="processes that diagnose")
    parser.add_argument("--keep", type=Path, required=True, help="folder of cells and studies")
    parser.add_argument("--out", type=Path, help=f"default: {CALIBRATION} of config/")
    options = parser.parse_args()
    laws = tuple(int(x) for x in options.laws.split(","))
    refuse_held_back(laws)
    cells, answers = options.keep / "cases", options.keep / "answers.json"
    if not (cells / "manifest.json").is_file():
        make_cases(cells, answers, Design(cases=options.cases, seed=options.seed, laws=laws))
    manifest, secret = read_manifest(cells), json.loads(answers.read_text(encoding="utf-8"))
    refuse_held_back(manifest.get("laws", [0]))
    widths = (False, True) if options.narrow else (False,)
    investigate_cells(
        options.keep, manifest["cases"], options.budget, options.most, options.jobs, widths
    )
    views = [
        view
        for narrow in widths
        for path in sorted(studies(options.keep, narrow).glob("*.pkl"))
        for view in views_of(path, secret["cases"][path.stem])
    ]
    document = learn(views) | {
        "provenance": {
            "command": "python benchmarks/calibrate.py",
            "plant": "pianobot_ros.emulator.plant",
            "laws": manifest.get("laws", [0]),
            "seed": secret["seed"],
            "cells": len({v.cell for v in views}),
            "date": date.today().isoformat(),
            **code_version(),
        }
    }
    text = yaml_text(document)
    print(text)
    if not is_better(document["reached"]):
        print("not better on cells that are left out than what is set: nothing is written")
        return 0
    out = options.out or config_dir() / CALIBRATION
    out.write_text(f"# Written by benchmarks/calibrate.py; not by hand.\n{text}", encoding="utf-8")
    return 0


def refuse_held_back(laws: Iterable[int]) -> None:
    """Nothing may be learned from the law that blind checks are kept for."""
    if HELD_BACK in laws:
        raise SystemExit(f"law {HELD_BACK} of the plant is held back: nothing is developed with it")


def studies(keep: Path, narrow: bool) -> Path:
    """Where the studies of the cells are kept."""
    return keep / ("studies-narrow" if narrow else "studies")


def investigate_cells(
    keep: Path,
    names: Iterable[str],
    budget: int,
    most: int | None,
    jobs: int,
    widths: Sequence[bool],
) -> None:
    """Put on the table what may explain each cell, and keep it."""
    for narrow in widths:
        studies(keep, narrow).mkdir(exist_ok=True)
    todo = [
        (narrow, name)
        for narrow in widths
        for name in names
        if not (studies(keep, narrow) / f"{name}.pkl").is_file()
    ][:most]
    Parallel(n_jobs=jobs)(
        delayed(investigate_cell)(keep, name, budget, narrow) for narrow, name in todo
    )


def investigate_cell(keep: Path, name: str, budget: int, narrow: bool) -> None:
    twin = PianoTwin([read_bag(keep / "cases" / name)])
    if narrow:
        twin.effects = tuple(map(narrowed, twin.effects))
    study = investigate(twin, twin.blocks, Budget(budget), options=prior_options())
    new = studies(keep, narrow) / f"{name}.new"
    new.write_bytes(pickle.dumps(study))
    new.rename(new.with_suffix(".pkl"))
    print(name, "narrow" if narrow else "", file=sys.stderr, flush=True)


def narrowed(effect: Effect) -> Effect:
    """An effect that has nothing but its size to fit; the rest stays as it is set."""
    sizes = dict.fromkeys(s[effect.magnitude] for s in effect.starts if effect.magnitude in s)
    own = tuple(p for p in effect.parameters if p.name == effect.magnitude)
    starts = [{effect.magnitude: size} for size in sizes] or [{}]
    return replace(effect, parameters=own, starts=starts)


def views_of(path: Path, secret: Mapping[str, Any]) -> list[View]:
    """A cell as it is, and without its cause if that is one effect of the library."""
    study: Study = pickle.loads(path.read_bytes())
    remember(study)
    effects, kind = tuple(secret["effects"]), secret["kind"]
    names = effects if kind in ("effect", "two") else (kind,)
    views = [View(path.stem, names, False, study)]
    if kind == "effect":
        names = ("unknown", *sorted(relatives_of(effects[0])))
        views.append(View(path.stem, names, True, without(study, effects[0])))
    return views


def remember(study: Study) -> None:
    """Let a study remember what no constant changes: it is asked hundreds of times."""
    squares, cost = study.gauge.squares, study.fitter.likelihood.cost
    vars(study.gauge)["squares"] = remembered(squares)
    vars(study.fitter.likelihood)["cost"] = remembered(cost)


def remembered(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` of arrays that nobody changes, which remembers its values."""
    known: dict[tuple[int, ...], tuple[Any, Any]] = {}

    def found(*arrays: Any) -> Any:
        key = tuple(map(id, arrays))
        if key not in known:
            known[key] = (arrays, function(*arrays))  # held, so that no other takes the identity
        return known[key][1]

    return found


def without(study: Study, effect: str) -> Study:
    """The study as if the library had lacked an effect."""
    problem = copy.copy(study.problem)
    problem.effects = {n: e for n, e in problem.effects.items() if n != effect}
    left = [e for e in study.entries if effect not in e.effects]
    screened = [s for s in study.screened if s.effect != effect]
    return replace(study, problem=problem, entries=left, screened=screened)


def answer(view: View, point: Point) -> Answer:
    """What is said of a view by the constants of `point`."""
    study = view.study
    c = replace(study.options.calibration, **dict[str, Any](point))
    masses = posterior(replace(study, options=replace(study.options, calibration=c))).masses
    return answer_by(masses, view.names, view.any_of)


def answer_by(masses: Mapping[str, float], names: Sequence[str], any_of: bool) -> Answer:
    """The same from the probabilities of all names."""
    ranked = sorted(masses.items(), key=lambda kv: -kv[1])
    first, probability = ranked[0]
    before = dict(
        zip((n for n, _ in ranked), np.cumsum([0.0, *(p for _, p in ranked)]), strict=False)
    )
    each = [float(before.get(n, 1.0)) for n in names]
    truth = sum(masses.get(n, 0.0) for n in names)
    return Answer(first, probability, first in names, truth, min(each) if any_of else max(each))


def learn(views: Sequence[View], ask: Callable[[View, Point], Answer] = answer) -> dict[str, Any]:
    """Constants and levels, with what they reach on these cells and on cells left out."""
    known: dict[tuple[float, ...], list[Answer]] = {}

    def answers(point: Point) -> list[Answer]:
        key = tuple(point[n] for n in TRIED)
        if key not in known:
            known[key] = [ask(v, point) for v in views]
            print(f"{np.mean(losses_of(known[key])):.4f} {dict(point)}", file=sys.stderr)
        return known[key]

    def losses(point: Point) -> Array:
        return losses_of(answers(point))

    cells = np.array([v.cell for v in views])
    start = {n: getattr(prior_options().calibration, n) for n in TRIED}
    at = descend(losses, start, cells, np.ones(cells.size, dtype=bool))
    part = np.unique(cells, return_inverse=True)[1] % PARTS
    outside = [answers(descend(losses, start, cells, part != k)) for k in range(PARTS)]
    left_out = [outside[k][i] for i, k in enumerate(part)]
    levels = levels_of(answers(at))
    return {
        "constants": {n: x for n, x in at.items() if x != start[n]},
        "levels": levels,
        "reached": {
            "views": len(views),
            "before": figures(answers(start), {}),
            "on these cells": figures(answers(at), levels),
            "each cell left out": figures(left_out, levels),
            "gain in log loss, each cell left out": rounded(
                *gain_of(losses(start) - losses_of(left_out), cells)
            ),
        },
    }


def losses_of(given: Iterable[Answer]) -> Array:
    """Log loss of every view (views,)."""
    return np.array([-math.log(max(t.truth, LEAST)) for t in given])


def descend(losses: Losses, start: Point, cells: Array, use: Array) -> Point:
    """Change one constant at a time to a neighbouring value: the change that lowers the mean loss
    of the views in `use` most, while one does by more than its standard error over cells (Breiman,
    Friedman, Olshen and Stone 1984).
    """
    at = start
    while True:
        now = losses(at)
        found: list[tuple[float, int, Point]] = []
        for other in neighbours(at):
            gain, error = gain_of((now - losses(other))[use], cells[use])
            if gain > error:
                found.append((gain, len(found), other))
        if not found:
            return at
        at = max(found)[2]


def neighbours(at: Point) -> list[dict[str, float]]:
    """`at` with one constant at the next value below or above."""
    out = []
    for name, values in TRIED.items():
        below = [x for x in values if x < at[name]][-1:]
        above = [x for x in values if x > at[name]][:1]
        out += [{**at, name: x} for x in (*below, *above)]
    return out


def gain_of(gain: Array, cells: Array) -> tuple[float, float]:
    """Mean gain of the views, and its standard error: views of one cell go together."""
    each = np.array([gain[cells == c].sum() for c in np.unique(cells)])
    error = each.std(ddof=1) * math.sqrt(each.size) if each.size > 1 else math.inf
    return float(gain.mean()), float(error / gain.size)


def levels_of(given: Sequence[Answer]) -> dict[str, float]:
    """Mass that a credible set must hold, by group of first answers."""
    groups = {
        g: [t.before for t in given if group_of(t.first) == g]
        for g in ("effect", "unknown", "quiet")
    }
    everyone = [t.before for t in given]
    return {g: conformal(own if len(own) >= ENOUGH else everyone) for g, own in groups.items()}


def figures(given: Sequence[Answer], levels: Mapping[str, float]) -> dict[str, float]:
    """How good the answers are."""
    covered = [t.before < levels.get(group_of(t.first), LEVEL) for t in given]
    error = calibration_error([t.probability for t in given], [t.right for t in given])
    return {
        "mean log loss": round(float(losses_of(given).mean()), 3),
        "right first": round(float(np.mean([t.right for t in given])), 3),
        "expected calibration error": round(error, 3),
        "covered": round(float(np.mean(covered)), 3),
    }


def rounded(value: float, error: float) -> dict[str, float]:
    return {"mean": round(value, 3), "standard error": round(error, 3)}


def is_better(reached: Mapping[str, Any]) -> bool:
    """Whether what was learned predicts cells that are left out better than what is set, by more
    than a standard error.
    """
    gain = reached["gain in log loss, each cell left out"]
    return bool(gain["mean"] > gain["standard error"])


def conformal(needed: Iterable[float]) -> float:
    """Mass that a set must hold so that a further cell is covered with probability 0.95, were it
    drawn like these (split conformal prediction).
    """
    x = np.sort(np.asarray(list(needed), float))
    rank = math.ceil((x.size + 1) * LEVEL)
    return round(min(float(x[rank - 1]) + 1e-3, 0.999), 3) if rank <= x.size else 0.999


assert set(TRIED) <= {f.name for f in fields(Calibration)}

if __name__ == "__main__":
    sys.exit(main())
