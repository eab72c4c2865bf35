"""Scores of blind diagnoses against the answers, after checking that the answers are those that were committed to."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.blind.make import commitment
from pianobot_ros.blind.run import RESULTS, read_manifest
from pianobot_ros.cell.errors import ConfigError

__all__ = ["Figure", "Score", "score_cases"]

BAND = 3.0
"""Magnitude (in floors) that separates the two bands."""


@dataclass(frozen=True)
class Figure:
    """One figure: ``value`` (a share, or NaN without cases) over ``cases``, with what was asked for."""

    name: str
    value: float
    cases: int
    least: str = ""
    goal: str = ""


@dataclass(frozen=True)
class Score:
    """All figures; ``confusion`` truth to answer to count; ``reliability`` rows (probability from, to, mean, right, cases)."""

    figures: tuple[Figure, ...]
    confusion: Mapping[str, Mapping[str, int]]
    reliability: tuple[tuple[float, float, float, float, int], ...]
    wrong: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """As plain JSON; NaN as null."""
        rows = [asdict(f) | {"value": None if np.isnan(f.value) else f.value} for f in self.figures]
        return {"figures": rows, "confusion": {k: dict(v) for k, v in self.confusion.items()},
                "reliability": [list(r) for r in self.reliability], "wrong": list(self.wrong)}  # fmt: skip

    def to_text(self) -> str:
        """As Markdown."""
        lines = ["| figure | value | cases | at least | goal |", "|---|---|---|---|---|"]
        for f in self.figures:
            value = (
                "–" if np.isnan(f.value) else (f"{100 * f.value:.0f} %" if "time" not in f.name else f"{f.value:.1f} s")
            )
            lines.append(f"| {f.name} | {value} | {f.cases} | {f.least} | {f.goal} |")
        lines += ["", "Truth → answer (count), wrong ones only:", ""]
        for truth in sorted(self.confusion):
            off = {a: n for a, n in self.confusion[truth].items() if a != truth}
            if off:
                lines.append(
                    f"- {truth} → " + ", ".join(f"{a} ({n})" for a, n in sorted(off.items(), key=lambda x: -x[1]))
                )
        lines += ["", "| probability of the first answer | mean | right | cases |", "|---|---|---|---|"]
        lines += [f"| {a:.2f} to {b:.2f} | {m:.2f} | {r:.2f} | {n} |" for a, b, m, r, n in self.reliability]
        return "\n".join(lines) + "\n"


def score_cases(folder: str | Path, answers: str | Path) -> Score:
    """Score the results in ``folder``. Raises :class:`ConfigError` if ``answers`` is not the file that was committed to."""
    folder, answers = Path(folder), Path(answers)
    manifest = read_manifest(folder)
    if not answers.is_file():
        raise ConfigError(f"there is no file {answers}: give the answers that `pianobot blind make` wrote")
    if commitment(answers) != manifest["commitment"]:
        raise ConfigError(f"{answers} is not the file that {folder} is committed to: its SHA-256 differs")
    truth = json.loads(answers.read_text(encoding="utf-8"))["cases"]
    rows = []
    for name in manifest["cases"]:
        path = folder / RESULTS / f"{name}.json"
        if path.is_file():
            rows.append(_row(name, truth[name], json.loads(path.read_text(encoding="utf-8"))))
    if not rows:
        raise ConfigError(f"{folder} has no results yet: run `pianobot blind diagnose {folder}`")
    confusion: dict[str, Counter[str]] = defaultdict(Counter)
    for r in rows:
        confusion[r["truth"]][r["answer"]] += 1
    wrong = tuple(
        f"{r['name']}: {r['truth']} ({r['told']}) called {r['answer']} ({r['p']:.2f})"
        for r in rows
        if r["answer"] != r["truth"]
    )
    return Score(tuple(_figures(rows)), confusion, tuple(_reliability(rows)), wrong)


def _row(name: str, told: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, Any]:
    kind = told["kind"]
    truth = "+".join(sorted(told["effects"])) if kind in ("effect", "two") else kind
    named = [e["name"] for e in found.get("effects", [])]
    answer = "+".join(sorted(named)) if found["verdict"] == "effect" else found["verdict"]
    candidates = found.get("candidates") or [{"name": "error", "stage": "", "probability": 0.0}]
    stages = [e["stage"] for e in found.get("effects", [])]
    if not stages and found.get("unknown"):
        stages = [found["unknown"]["stage"]]
    if not stages and found.get("stages"):  # nothing is named: where most of the gap is said to come from
        stages = [max(found["stages"], key=lambda s: s["share"])["name"]]
    wanted = set(told["effects"]) if kind in ("effect", "two") else {kind}
    alike = {n for g in found.get("inseparable", []) if set(named) & set(g) for n in g} | set(named)
    criteria = found.get("criteria", {})
    return {
        "leads": named[0] if named else "",
        "name": name, "kind": kind, "truth": truth, "answer": answer, "named": set(named), "verdict": found["verdict"],
        "told": ", ".join(f"{k} {v:.1f}" for k, v in told["effects"].items()), "p": candidates[0]["probability"],
        "first": candidates[0]["name"], "wanted": wanted, "strength": max(told["effects"].values(), default=0.0),
        "covered": wanted <= set(found.get("credible_set", [])), "stage": bool(set(stages) & set(told["stages"])),
        "alike": wanted <= alike, "gap": found.get("gap", {}), "runtime": found.get("runtime_s") or float("nan"),
        "aic": criteria.get("aic", ""), "bic": criteria.get("bic", ""),
    }  # fmt: skip


def _figures(rows: list[dict[str, Any]]) -> list[Figure]:
    def of(*kinds: str) -> list[dict[str, Any]]:
        return [r for r in rows if r["kind"] in kinds]

    def share(name: str, chosen: list[dict[str, Any]], test: Any, least: str = "", goal: str = "") -> Figure:
        value = float(np.mean([bool(test(r)) for r in chosen])) if chosen else float("nan")
        return Figure(name, value, len(chosen), least, goal)

    effect = of("effect")
    strong, weak = [r for r in effect if r["strength"] >= BAND], [r for r in effect if r["strength"] < BAND]

    def right(r: dict[str, Any]) -> bool:
        return bool(r["answer"] == r["truth"])

    closed = [r for r in effect if r["gap"].get("closed") is not None and r["gap"]["before"] - r["gap"]["floor"] > 0.1]
    refit = [(r["gap"]["before"] - r["gap"]["refit"]) / (r["gap"]["before"] - r["gap"]["floor"]) for r in closed]
    runtimes = [r["runtime"] for r in rows if np.isfinite(r["runtime"])]
    return [
        share("right effect first, gap ≥ 3 × floor", strong, right, "85 %", "95 %"),
        share("right effect first, gap 1 to 3 × floor", weak, right, "60 %", "80 %"),
        share("right effect first, whatever else is named", effect, lambda r: r["leads"] == r["truth"]),
        share("right, or declared inseparable from it", effect, lambda r: right(r) or r["alike"]),
        share("truth inside the 95 % credible set", rows, lambda r: r["covered"], "93 %", "97 %"),
        share("right stage", effect, lambda r: r["stage"], "95 %", "98 %"),
        share("none-cases called something", of("none"), lambda r: r["verdict"] != "none", "≤ 5 %", "≤ 2 %"),
        share("parameter-error-only cases called an effect", of("parameters"), lambda r: r["verdict"] == "effect",
              "≤ 7 %", "≤ 3 %"),
        share("left-out effects called unknown", of("unknown"), lambda r: r["verdict"] == "unknown", "75 %", "90 %"),
        share("both of two effects named", of("two"), lambda r: r["wanted"] <= r["named"], "65 %", "85 %"),
        share("at least one of two effects named", of("two"), lambda r: bool(r["wanted"] & r["named"])),
        Figure("gap above the floor closed, held out, effect in library",
               float(np.median([r["gap"]["closed"] for r in closed])) if closed else float("nan"), len(closed), "80 %", "90 %"),
        Figure("the same by parameter fitting alone", float(np.median(refit)) if refit else float("nan"), len(closed)),
        share("right effect first by AIC on the same fits", effect, lambda r: r["aic"] == r["truth"]),
        share("right effect first by BIC on the same fits", effect, lambda r: r["bic"] == r["truth"]),
        share("none- and parameter-cases called an effect by BIC", of("none", "parameters"),
              lambda r: r["bic"] not in ("none", "parameters")),
        Figure("median time of a diagnosis", float(np.median(runtimes)) if runtimes else float("nan"), len(runtimes),
               "120 s", "60 s"),
    ]  # fmt: skip


def _reliability(rows: list[dict[str, Any]]) -> list[tuple[float, float, float, float, int]]:
    edges = [0.0, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0001]
    out = []
    for low, high in pairwise(edges):
        inside = [r for r in rows if low <= r["p"] < high]
        if inside:
            right = float(np.mean([r["first"] in r["wanted"] for r in inside]))
            out.append((low, min(high, 1.0), float(np.mean([r["p"] for r in inside])), right, len(inside)))
    return out
