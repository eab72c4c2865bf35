"""Calibrate the diagnosis of the piano cell: cells with known causes are diagnosed, and what turns
scores into probabilities and credible sets is learned from them and written to one file.

python benchmarks/calibrate.py --cases 40 --seed 611 --laws 0,1 --keep DIR --out FILE

Learned are η = 1 / temperature, one for series and one for events, of
p(h) ∝ prior · exp(η · held-out score) (Grünwald and van Ommen 2017), by the mean log probability of
the truth; and the mass that a credible set must hold, by group of first answers, so that 95 % of
the cells are covered (adaptive prediction sets: Romano, Sesia and Candès 2020). The file is written
only if cells that are left out are predicted clearly better than by what is set now. Every cell
counts twice where it has one effect of the library: as it is, and without the hypotheses that hold
the true effect, where *unknown* or a declared relative is the truth. Cells that are in `--keep`
already are not diagnosed again; those that `pianobot blind make` made are taken as well (DIR/cases
and DIR/answers.json).
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.blind import Design, make_cases
from pianobot_ros.blind.run import read_manifest
from pianobot_ros.cell.numbers.config import config_dir
from pianobot_ros.cell.version import code_version
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.posterior.probabilities import posterior
from pianobot_ros.gap.posterior.verdict import LEVEL, group_of
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.search.study import Study
from pianobot_ros.piano_twin.diagnosis.relatives import relatives_of
from pianobot_ros.piano_twin.diagnosis.settings import CALIBRATION, prior_options
from pianobot_ros.piano_twin.simulation.piano_twin import PianoTwin

SERIES = (4.0, 8.0, 15.0, 30.0, 60.0)
EVENTS = (2.0, 4.0, 8.0, 16.0)
"""Temperatures that are tried."""
LEAST = 1e-3
"""Probability of the truth below which it costs no more: no cell may decide alone."""
ENOUGH = 20
"""Views of a group that a threshold of its own needs (95 % of fewer is all of them)."""


@dataclass(frozen=True)
class View:
    """One cell, seen with the whole library or without its cause. `names`: what is true, all of
    which a credible set must hold (of relatives any); `masses` by (series, events) temperatures.
    """

    cell: str
    any_of: bool
    names: tuple[str, ...]
    masses: Mapping[str, Mapping[str, float]]

    def truth(self, point: str) -> float:
        """Probability of the truth."""
        return sum(self.masses[point].get(n, 0.0) for n in self.names)

    def needed(self, point: str) -> tuple[str, float]:
        """First answer, and the mass that comes before the truth: a set that holds more holds the
        truth.
        """
        ranked = sorted(self.masses[point].items(), key=lambda kv: -kv[1])
        before = dict(
            zip((n for n, _ in ranked), np.cumsum([0.0, *(p for _, p in ranked)]), strict=False)
        )
        each = [float(before.get(n, 1.0)) for n in self.names]
        return ranked[0][0], min(each) if self.any_of else max(each)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=611, help="a development seed: 1 to 999")
    parser.add_argument("--laws", default="0,1", help="laws of the plant; the others stay unseen")
    parser.add_argument("--budget", type=int, default=40_000, help="simulated strikes for a cell")
    parser.add_argument("--most", type=int, help="diagnose at most so many cells now (0: none)")
    parser.add_argument("--keep", type=Path, required=True, help="folder of cells and tables")
    parser.add_argument("--out", type=Path, help=f"default: {CALIBRATION} of config/")
    options = parser.parse_args()
    laws = tuple(int(x) for x in options.laws.split(","))
    cells, answers = options.keep / "cases", options.keep / "answers.json"
    if not (cells / "manifest.json").is_file():
        make_cases(cells, answers, Design(cases=options.cases, seed=options.seed, laws=laws))
    manifest, told = read_manifest(cells), json.loads(answers.read_text(encoding="utf-8"))
    names, truth = manifest["cases"], told["cases"]
    tables = options.keep / "tables"
    tables.mkdir(exist_ok=True)
    todo = [n for n in names if not (tables / f"{n}.json").is_file()]
    for name in todo[: options.most]:
        rows = tabulate(cells / name, truth[name], options.budget)
        (tables / f"{name}.json").write_text(json.dumps(rows) + "\n", encoding="utf-8")
        print(f"{name} {truth[name]['effects']}", file=sys.stderr, flush=True)
    views = [
        View(p.stem, row["any_of"], tuple(row["names"]), row["masses"])
        for p in sorted(tables.glob("*.json"))
        for row in json.loads(p.read_text(encoding="utf-8"))
    ]
    document = learn(views) | {
        "provenance": {
            "command": "python benchmarks/calibrate.py",
            "plant": "pianobot_ros.emulator.plant",
            "laws": manifest.get("laws", [0]),
            "seed": told["seed"],
            "cells": len({v.cell for v in views}),
            "date": date.today().isoformat(),
            **code_version(),
        }
    }
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True)
    print(text)
    if not is_better(document["reached"]):
        print("not clearly better on cells that are left out than what is set: nothing is written")
        return 0
    out = options.out or config_dir() / CALIBRATION
    out.write_text(f"# Written by benchmarks/calibrate.py; not by hand.\n{text}", encoding="utf-8")
    return 0


def tabulate(bag: Path, told: Mapping[str, Any], budget: int) -> list[dict[str, Any]]:
    """Diagnose one bag and evaluate the posterior at all temperatures, with the whole library and
    without the cause.
    """
    twin = PianoTwin([read_bag(bag)])
    study = investigate(twin, twin.blocks, Budget(budget), options=prior_options())
    effects = tuple(told["effects"])
    kind = told["kind"]
    names = effects if kind in ("effect", "two") else (kind,)
    rows = [{"any_of": False, "names": names, "masses": masses(study)}]
    if kind == "effect":
        names = ("unknown", *sorted(relatives_of(effects[0])))
        rows.append({"any_of": True, "names": names, "masses": masses(without(study, effects[0]))})
    return rows


def without(study: Study, effect: str) -> Study:
    """The study as if the library had lacked an effect."""
    left = [e for e in study.entries if effect not in e.effects]
    screened = [s for s in study.screened if s.effect != effect]
    study.problem.effects = {n: e for n, e in study.problem.effects.items() if n != effect}
    return replace(study, entries=left, screened=screened)


def masses(study: Study) -> dict[str, dict[str, float]]:
    """Probabilities by name, of those above 1e-4, at every pair of temperatures."""
    out = {}
    for series, events in product(SERIES, EVENTS):
        c = replace(study.options.calibration, temperature=series, event_temperature=events)
        found = posterior(replace(study, options=replace(study.options, calibration=c)))
        out[_key(series, events)] = {n: round(p, 5) for n, p in found.masses.items() if p > 1e-4}
    return out


def _key(series: float, events: float) -> str:
    return f"{series:g} {events:g}"


def learn(views: Sequence[View]) -> dict[str, Any]:
    """Temperatures and levels, with what they reach on these cells."""
    points = list(product(SERIES, EVENTS))
    loss = np.array(
        [[-math.log(max(v.truth(_key(*k)), LEAST)) for k in points] for v in views]
    )  # (views, points)
    best = int(np.argmin(loss.mean(0)))
    series, events = points[best]
    needed = [v.needed(_key(series, events)) for v in views]
    groups = {
        g: [x for first, x in needed if group_of(first) == g]
        for g in ("effect", "unknown", "quiet")
    }
    everyone = [x for _, x in needed]
    levels = {g: conformal(own if len(own) >= ENOUGH else everyone) for g, own in groups.items()}
    covered = np.mean([x < levels[group_of(first)] for first, x in needed])
    set_now = prior_options().calibration
    before = points.index((set_now.temperature, set_now.event_temperature))
    plain = np.mean([x < LEVEL for _, x in (v.needed(_key(*points[before])) for v in views)])
    gain = loss[:, before] - left_out(loss, [v.cell for v in views])
    return {
        "temperature": series,
        "event_temperature": events,
        "levels": levels,
        "reached": {
            "views": len(views),
            "views by group of the first answer": {g: len(own) for g, own in groups.items()},
            "mean log loss": round(float(loss[:, best].mean()), 3),
            "mean log loss, each cell left out": round(float(np.mean(loss[:, before] - gain)), 3),
            "mean log loss before": round(float(loss[:, before].mean()), 3),
            "standard error of the last two's difference": round(
                float(gain.std(ddof=1) / math.sqrt(gain.size)), 3
            ),
            "covered on these views": round(float(covered), 3),
            "covered on these views before": round(float(plain), 3),
        },
    }


def is_better(reached: Mapping[str, Any]) -> bool:
    """Whether what was learned predicts cells that are left out better than what is set, by more
    than a standard error (Breiman, Friedman, Olshen and Stone 1984).
    """
    gain = reached["mean log loss before"] - reached["mean log loss, each cell left out"]
    return bool(gain > reached["standard error of the last two's difference"])


def left_out(loss: np.ndarray, cells: Sequence[str]) -> np.ndarray:
    """Log loss (views,) by the point that is best for all other cells; `loss` (views, points)."""
    of = np.array(cells)
    chosen = [int(np.argmin(loss[of != cell].mean(0))) for cell in cells]
    return np.asarray(loss[np.arange(of.size), chosen])


def conformal(needed: Iterable[float]) -> float:
    """Mass that a set must hold so that a further cell is covered with probability 0.95, were it
    drawn like these (split conformal prediction).
    """
    x = np.sort(np.asarray(list(needed), float))
    rank = math.ceil((x.size + 1) * LEVEL)
    return round(min(float(x[rank - 1]) + 1e-3, 0.999), 3) if rank <= x.size else 0.999


if __name__ == "__main__":
    sys.exit(main())
