"""Scores of blind diagnoses against the answers, after checking that the answers are those that
were committed to.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.piano.blind.figures import BAND, Figure, figures
from pianobot_ros.piano.blind.folder import RESULTS, read_manifest
from pianobot_ros.piano.blind.make import commitment
from pianobot_ros.piano.blind.reliability import Bin, bins_of
from pianobot_ros.piano.gap.diagnosis.relatives import relatives_of

__all__ = ["Scorecard", "case_rows", "score_cases"]


@dataclass(frozen=True)
class Scorecard:
    """All figures; ``confusion`` truth to answer to count; ``reliability`` of the first answer
    by group of cases.
    """

    figures: tuple[Figure, ...]
    confusion: Mapping[str, Mapping[str, int]]
    reliability: Mapping[str, tuple[Bin, ...]]
    wrong: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """As plain JSON; NaN as null."""
        rows = [asdict(f) | {"value": None if np.isnan(f.value) else f.value} for f in self.figures]
        return {
            "figures": rows,
            "confusion": {k: dict(v) for k, v in self.confusion.items()},
            "reliability": {k: [b._asdict() for b in v] for k, v in self.reliability.items()},
            "wrong": list(self.wrong),
        }

    def to_text(self) -> str:
        """As Markdown."""
        lines = ["| figure | value | cases | at least | goal |", "|---|---|---|---|---|"]
        for f in self.figures:
            lines.append(f"| {f.name} | {f.text()} | {f.cases} | {f.least} | {f.goal} |")
        lines += ["", "Truth → answer (count), wrong ones only:", ""]
        for truth in sorted(self.confusion):
            off = {a: n for a, n in self.confusion[truth].items() if a != truth}
            if off:
                lines.append(
                    f"- {truth} → "
                    + ", ".join(f"{a} ({n})" for a, n in sorted(off.items(), key=lambda x: -x[1]))
                )
        lines += [
            "",
            "| cases | probability of the first answer | mean | right | number |",
            "|---|---|---|---|---|",
        ]
        lines += [
            f"| {group} | {b.low:.2f} to {b.high:.2f} | {b.mean:.2f} | {b.right:.2f} | {b.cases} |"
            for group, bins in self.reliability.items()
            for b in bins
        ]
        return "\n".join(lines) + "\n"


def score_cases(folder: str | Path, answers: str | Path) -> Scorecard:
    """Score the results in ``folder``. Raises :class:`ConfigError` if ``answers`` is not the file
    that was committed to.
    """
    rows = case_rows(folder, answers)
    confusion: dict[str, Counter[str]] = defaultdict(Counter)
    for r in rows:
        confusion[r["truth"]][r["answer"]] += 1
    wrong = tuple(
        f"{r['name']}: {r['truth']} ({r['told']}) called {r['answer']} ({r['p']:.2f})"
        for r in rows
        if r["answer"] != r["truth"]
    )
    return Scorecard(tuple(figures(rows)), confusion, _reliability(rows), wrong)


def case_rows(folder: str | Path, answers: str | Path) -> list[dict[str, Any]]:
    """Truth and answer of every case of ``folder`` that has a result, from which the figures are
    made. Raises :class:`ConfigError` as :func:`score_cases` does.
    """
    folder, answers = Path(folder), Path(answers)
    manifest = read_manifest(folder)
    if not answers.is_file():
        raise ConfigError(
            f"there is no file {answers}: give the answers that `pianobot blind make` wrote"
        )
    if commitment(answers) != manifest["commitment"]:
        raise ConfigError(
            f"{answers} is not the file that {folder} is committed to: its SHA-256 differs"
        )
    truth = json.loads(answers.read_text(encoding="utf-8"))["cases"]
    rows = []
    for name in manifest["cases"]:
        path = folder / RESULTS / f"{name}.json"
        if path.is_file():
            found = json.loads(path.read_text(encoding="utf-8"))
            without = manifest.get("without", {}).get(name, "")  # older folders withhold nothing
            rows.append(_row(name, truth[name], found, without))
    if not rows:
        raise ConfigError(f"{folder} has no results yet: run `pianobot blind diagnose {folder}`")
    return rows


def _row(
    name: str, hidden: Mapping[str, Any], found: Mapping[str, Any], without: str
) -> dict[str, Any]:
    """One case. Where its own family was withheld the truth is unknown to the library, and so the
    kind is ``withheld``; a relative that was declared beforehand is right too.
    """
    kind = "withheld" if without in hidden["effects"] else hidden["kind"]
    relatives = relatives_of(without) if kind == "withheld" else frozenset()
    truth = "+".join(sorted(hidden["effects"])) if kind in ("effect", "two") else kind
    truth = "unknown" if kind == "withheld" else truth
    named = [e["name"] for e in found.get("effects", [])]
    answer = "+".join(sorted(named)) if found["verdict"] == "effect" else found["verdict"]
    candidates = found.get("candidates") or [{"name": "error", "stage": "", "probability": 0.0}]
    stages = [e["stage"] for e in found.get("effects", [])]
    if not stages and found.get("unknown"):
        stages = [found["unknown"]["stage"]]
    if not stages and found.get(
        "stages"
    ):  # nothing is named: where most of the gap is said to come from
        stages = [max(found["stages"], key=lambda s: s["share"])["name"]]
    wanted = set(hidden["effects"]) if kind in ("effect", "two") else {kind}
    wanted = {"unknown"} if kind == "withheld" else wanted
    credible = set(found.get("credible_set", []))
    inseparable = {n for g in found.get("inseparable", []) if set(named) & set(g) for n in g} | set(
        named
    )
    # of two effects each is at work with the probability that the headline gives it
    works = {e["name"]: e["probability"] for e in found.get("effects", [])}
    first = candidates[0]["name"]
    criteria = found.get("criteria", {})
    return {
        "leads": named[0] if named else "",
        "name": name,
        "kind": kind,
        "truth": truth,
        "answer": answer,
        "named": set(named),
        "verdict": found["verdict"],
        "told": ", ".join(f"{k} {v:.1f}" for k, v in hidden["effects"].items()),
        "p": works.get(first, candidates[0]["probability"]),
        "first": first,
        "wanted": wanted,
        "strength": max(hidden["effects"].values(), default=0.0),
        "weaker": min(hidden["effects"].values(), default=0.0),
        "covered": wanted <= credible or bool(relatives & credible),
        "credible": credible,
        "size": len(credible),
        "relative": bool(named) and set(named) <= relatives,
        "first_right": first in wanted | relatives or set(first.split("+")) == wanted,
        "law": max(hidden.get("laws", {}).values(), default=0),
        "stage": bool(set(stages) & set(hidden["stages"])),
        "inseparable": wanted <= inseparable,
        "gap": found.get("gap", {}),
        "held": _held(hidden["parameters"], found.get("parameters", {})),
        "runtime": found.get("runtime_s") or float("nan"),
        "aic": criteria.get("aic", ""),
        "bic": criteria.get("bic", ""),
    }


def _held(true: Mapping[str, float], found: Mapping[str, Any]) -> list[bool]:
    """Of each parameter that is off whether its 95 % interval holds the true multiple of what the
    twin believes.
    """
    return [
        found[n]["low"] <= x * found[n]["nominal"] <= found[n]["high"]
        for n, x in true.items()
        if n in found
    ]


def _reliability(rows: list[dict[str, Any]]) -> dict[str, tuple[Bin, ...]]:
    """Bins of all cases, by the size of the effect and by the plant's law."""
    strong = [r for r in rows if r["strength"]]
    groups = {
        "all": rows,
        "effect ≥ 3 × floor": [r for r in rows if r["strength"] >= BAND],
        "effect 1 to 3 × floor": [r for r in rows if 0 < r["strength"] < BAND],
    } | {
        f"law {law}": [r for r in strong if r["law"] == law]
        for law in sorted({r["law"] for r in strong})
    }
    return {
        name: tuple(bins_of([r["p"] for r in some], [r["first_right"] for r in some]))
        for name, some in groups.items()
        if some
    }
