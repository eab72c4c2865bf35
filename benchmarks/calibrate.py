"""Calibrate the diagnosis of the piano cell: cells with known causes are diagnosed, and how sure to
be, and what a credible set must hold, is learned from them and written to one file.

python benchmarks/calibrate.py --cases 130 --seed 617 --laws 0,1,2 --keep DIR --out FILE

Learned is, by group of first answers (an effect; unknown; none or parameters), the scaling of the
log odds: a power, which is the η of p(h) ∝ prior · exp(η · held-out score) (Grünwald and van Ommen
2017) as far as these answers tell it, and shifts towards *unknown*, what has no effect, and what
may hide (vector scaling: Guo, Pleiss, Sun and Weinberger 2017). It is the maximum of the log
probability of the truth with a normal prior about "as the scores say", so that what the cells do
not determine stays. Learned, too, is the mass that a credible set must hold, by group, so that 95 %
of the cells are covered (adaptive prediction sets: Romano, Sesia and Candès 2020). Every cell
counts twice where it has one effect of the library: as it is, and without the hypotheses that hold
the true effect, where *unknown* or a declared relative is the truth. With `--narrow` every cell is
diagnosed once more, by a library whose laws have nothing but their size to fit: its laws are as far
from the plant's as they may be from a robot's, and what a law of the right kind leaves is learned
from it. A group is scaled only if that predicts cells that were left out of the learning, in turn,
better than what the scores say, by more than a standard error; where no group is, nothing is
written.

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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import minimize

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.config import config_dir
from pianobot_ros.cell.version import code_version
from pianobot_ros.emulator.plant.laws.table import HELD_BACK
from pianobot_ros.gap import Calibration, Effect, Scaling
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.posterior.probabilities import posterior
from pianobot_ros.gap.posterior.table import Table, first_of, inclusion, masses_of, recalibrated
from pianobot_ros.gap.posterior.verdict import group_of
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.constants import LEVEL
from pianobot_ros.gap.search.study import Study
from pianobot_ros.piano.blind import Design, make_cases
from pianobot_ros.piano.blind.folder import read_manifest
from pianobot_ros.piano.blind.reliability import calibration_error
from pianobot_ros.piano.gap.diagnosis.relatives import relatives_of
from pianobot_ros.piano.gap.diagnosis.settings import (
    CALIBRATION,
    Figures,
    Group,
    Learned,
    Origin,
    Reached,
    Scale,
    Sureness,
    prior_options,
)
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

WIDTHS = (0.5, 1.0, 1.0, 1.0)
"""Prior standard deviations of ln power and of the three shifts (nats): as sure as the scores say,
within a factor of 1.6 in the power and 2.7 in the odds.
"""
LEAST = 1e-3
"""Probability of the truth below which it costs no more: no cell may decide alone."""
ENOUGH = 20
"""Views of a group that a threshold of its own needs (95 % of fewer is all of them)."""
GROUPS: tuple[Group, ...] = ("effect", "unknown", "quiet")
PARTS = 5
"""Parts of the cells that are left out in turn."""

Scalings = Mapping[Any, Scaling]


@dataclass(frozen=True)
class View:
    """One cell, seen with the whole library or without its cause: what the scores say. `names`:
    what is true, all of which a credible set must hold (of relatives `any_of` them).
    """

    cell: str
    names: tuple[str, ...]
    any_of: bool
    table: Table

    @property
    def group(self) -> str:
        """Group of the first answer."""
        return group_of(first_of(masses_of(self.table)))


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
        design = Design(cases=options.cases, seed=options.seed, laws=laws)
        make_cases(cells, answers, design, jobs=options.jobs)
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
    origin = Origin(
        command="python benchmarks/calibrate.py",
        plant="pianobot_ros.emulator.plant",
        laws=manifest.get("laws", [0]),
        seed=secret["seed"],
        cells=len({v.cell for v in views}),
        date=date.today().isoformat(),
        **code_version(),
    )
    learned = learn(views).model_copy(update={"provenance": origin})
    text = yaml_text(learned.model_dump())
    print(text)
    if not learned.scaling:
        print("no group's scaling pays on cells that are left out: nothing is written")
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
    study: Study = replace(pickle.loads(path.read_bytes()), options=prior_options())
    effects, kind = tuple(secret["effects"]), secret["kind"]
    names = effects if kind in ("effect", "two") else (kind,)
    views = [View(path.stem, names, False, posterior(study).table)]
    if kind == "effect":
        names = ("unknown", *sorted(relatives_of(effects[0])))
        table = posterior(without(study, effects[0])).table
        views.append(View(path.stem, names, True, table))
    return views


def without(study: Study, effect: str) -> Study:
    """The study as if the library had lacked an effect."""
    problem = copy.copy(study.problem)
    problem.effects = {n: e for n, e in problem.effects.items() if n != effect}
    left = [e for e in study.entries if effect not in e.effects]
    screened = [s for s in study.screened if s.effect != effect]
    return replace(study, problem=problem, entries=left, screened=screened)


def answer(view: View, scalings: Scalings) -> Answer:
    """What is said of a view by these scalings."""
    table = recalibrated(view.table, Calibration(scaling=scalings))
    given = answer_by(masses_of(table), view.names, view.any_of)
    return replace(given, probability=inclusion(table, given.first))


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


def learn(views: Sequence[View]) -> Learned:
    """Scalings of the groups where one pays, and levels, with what they reach on these cells and on
    cells left out.
    """
    cells = np.array([v.cell for v in views])
    group = np.array([v.group for v in views])
    start = [answer(v, {}) for v in views]
    left_out = predicted(views)
    gains = losses_of(start) - losses_of(left_out)
    # one cell has no standard error
    there: list[Group] = [g for g in GROUPS if len(set(cells[group == g])) > 1]
    paid = {g: gain_of(gains[group == g], cells[group == g]) for g in there}
    pays = [g for g, (gain, error) in paid.items() if gain > error]
    scalings = {g: scaling for g, scaling in fit(views).items() if g in pays}
    left_out = [x if v.group in pays else y for v, x, y in zip(views, left_out, start, strict=True)]
    here = [answer(v, scalings) for v in views]
    levels = levels_of(here)
    said = {g: [t for t, own in zip(start, group, strict=True) if own == g] for g in there}
    return Learned(
        scaling={g: scale_of(scaling) for g, scaling in scalings.items()},
        levels=levels,
        reached=Reached(
            views=len(views),
            groups={g: sureness(said[g], *paid[g]) for g in there},
            before=figures(start, {}),
            on_these_cells=figures(here, levels),
            each_cell_left_out=figures(left_out, {}),
        ),
    )


def scale_of(scaling: Scaling) -> Scale:
    """As it is written."""
    return Scale(**{n: round(x, 3) for n, x in asdict(scaling).items()})


def predicted(views: Sequence[View]) -> list[Answer]:
    """Answers by what the other parts of the cells tell, part by part."""
    part = np.unique([v.cell for v in views], return_inverse=True)[1] % PARTS
    known = [fit([v for v, p in zip(views, part, strict=True) if p != k]) for k in range(PARTS)]
    return [answer(v, known[p]) for v, p in zip(views, part, strict=True)]


def fit(views: Sequence[View]) -> dict[Group, Scaling]:
    """The likeliest scaling of each group that has enough views."""
    found: dict[Group, Scaling] = {}
    for group in GROUPS:
        own = [v for v in views if v.group == group]
        if len(own) >= ENOUGH:
            start = np.zeros(len(WIDTHS))
            found[group] = scaling_of(minimize(cost, start, (group, own), "L-BFGS-B").x)
    return found


def scaling_of(x: Array) -> Scaling:
    """Of ln power and three shifts (4,)."""
    return Scaling(float(np.exp(x[0])), *map(float, x[1:]))


def cost(x: Array, group: str, views: Sequence[View]) -> float:
    """Minus the log of prior and likelihood of a scaling."""
    given = [answer(v, {group: scaling_of(x)}) for v in views]
    return float(losses_of(given).sum() + 0.5 * np.sum((x / WIDTHS) ** 2))


def losses_of(given: Iterable[Answer]) -> Array:
    """Log loss of every view (views,)."""
    return np.array([-math.log(max(t.truth, LEAST)) for t in given])


def gain_of(gain: Array, cells: Array) -> tuple[float, float]:
    """Mean gain of the views, and its standard error: views of one cell go together."""
    each = np.array([gain[cells == c].sum() for c in np.unique(cells)])
    error = each.std(ddof=1) * math.sqrt(each.size) if each.size > 1 else math.inf
    return float(gain.mean()), float(error / gain.size)


def levels_of(given: Iterable[Answer]) -> dict[Group, float]:
    """Mass that a credible set must hold, by group of first answers."""
    given = list(given)
    groups = {g: [t.before for t in given if group_of(t.first) == g] for g in GROUPS}
    everyone = [t.before for t in given]
    return {g: conformal(own if len(own) >= ENOUGH else everyone) for g, own in groups.items()}


def sureness(given: Sequence[Answer], gain: float, error: float) -> Sureness:
    """How sure answers are, how often right, and what scaling them gains."""
    return Sureness(
        views=len(given),
        mean_probability=round(float(np.mean([t.probability for t in given])), 3),
        right=round(float(np.mean([t.right for t in given])), 3),
        gain=round(gain, 3),
        gain_error=round(error, 3),
    )


def figures(given: Sequence[Answer], levels: Mapping[Any, float]) -> Figures:
    """How good the answers are; `covered` by credible sets of these levels, else of 0.95."""
    held = [t.before < levels.get(group_of(t.first), LEVEL) for t in given]
    error = calibration_error([t.probability for t in given], [t.right for t in given])
    return Figures(
        mean_log_loss=round(float(losses_of(given).mean()), 3),
        right_first=round(float(np.mean([t.right for t in given])), 3),
        expected_calibration_error=round(error, 3),
        covered=round(float(np.mean(held)), 3),
    )


def conformal(needed: Iterable[float]) -> float:
    """Mass that a set must hold so that a further cell is covered with probability 0.95, were it
    drawn like these (split conformal prediction).
    """
    x = np.sort(np.asarray(list(needed), float))
    rank = math.ceil((x.size + 1) * LEVEL)
    return round(min(float(x[rank - 1]) + 1e-3, 0.999), 3) if rank <= x.size else 0.999


if __name__ == "__main__":
    sys.exit(main())
