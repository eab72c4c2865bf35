"""The blind check on a plant by another author: draws and records a set, has it diagnosed, scores
it and writes the tables.

python benchmarks/blind_foreign_cell.py --set dev --jobs 2 --out FILE.md
python benchmarks/blind_foreign_cell.py --set held --jobs 2 --out FILE.md

The plant is `benchmarks/foreign_cell/`, written by somebody who had not read the library of laws.
Each set is always the same 42 cells. The first is for development; the second is held back.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from foreign_cell.draw_cases import BAND, SETS, draw_set, make_set
from tables import table_head, table_row

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.piano.blind import diagnose_cases, score_cases
from pianobot_ros.piano.blind.folder import MANIFEST, read_manifest
from pianobot_ros.piano.blind.reliability import calibration_error, chance_error
from pianobot_ros.piano.blind.scorecard import case_rows

CASES = "cases"  # of the folder that is kept
Row = Mapping[str, Any]
Test = Callable[[Row], bool]


def main() -> int:
    options = _options()
    drawn = draw_set(SETS[options.set])[: options.cases]
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        cases, answers = folder / CASES, folder / "answers.json"
        begun = time.perf_counter()
        if not (cases / MANIFEST).is_file():
            make_set(cases, answers, drawn, jobs=options.jobs, progress=_say)
        truths = json.loads(answers.read_text(encoding="utf-8"))["cases"]
        if {n: t["seed"] for n, t in truths.items()} != {c.name: c.seed for c in drawn}:
            raise ConfigError(f"{folder} holds other cases: give --keep another folder")
        made = time.perf_counter()
        diagnose_cases(cases, jobs=options.jobs, budget=options.budget, progress=_say)
        done = time.perf_counter()
        rows = case_rows(cases, answers)
        score = score_cases(cases, answers)
        strikes = read_manifest(cases)["strikes"]
    command = "python benchmarks/blind_foreign_cell.py " + " ".join(sys.argv[1:])
    lines = [
        f"# Blind check on a plant by another author: set `{options.set}`",
        "",
        f"`{command}`: {len(rows)} cases of {strikes} strikes, seed {SETS[options.set].seed}; made"
        f" in {made - begun:.0f} s, diagnosed in {done - made:.0f} s.",
        "",
        *summary(rows),
        "",
        *case_table(rows, truths),
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(text, encoding="utf-8")
        options.out.with_suffix(".json").write_text(
            json.dumps(score.to_json(), indent=1) + "\n", encoding="utf-8"
        )
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--set", choices=SETS, default="dev")
    parser.add_argument("--cases", type=int, help="only so many of the set, from the first on")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--budget", type=int, default=DIAGNOSIS_BUDGET, help="simulated strikes for each case"
    )
    parser.add_argument("--keep", type=Path, help="keep cases and answers in this folder")
    parser.add_argument("--out", type=Path, help="write the tables here (and beside it as JSON)")
    given = parser.parse_args()
    if given.cases is not None and given.cases < 1:
        parser.error(f"--cases is {given.cases}: give at least 1")
    kept = given.keep and (given.keep / CASES / MANIFEST).is_file()
    if given.keep and not kept and given.keep.exists() and any(given.keep.iterdir()):
        parser.error(f"--keep: {given.keep} holds something else: give a new folder")
    return given


def summary(rows: Sequence[Row]) -> list[str]:
    """The table of what was right, line by line."""

    def of(*kinds: str) -> list[Row]:
        return [r for r in rows if r["kind"] in kinds]

    def right(r: Row) -> bool:
        return bool(r["answer"] == r["truth"])

    single = of("effect")
    asked: list[tuple[str, list[Row], Test]] = [
        ("one effect of 3 floors and more: it and nothing else named", _band(single, True), right),
        ("one effect of 1 to 3 floors: it and nothing else named", _band(single, False), right),
        ("no effect: called none", of("none"), right),
        ("wrong parameters only: called parameters", of("parameters"), right),
        ("effect outside of the library: called unknown", of("unknown"), right),
        ("both of two effects named", of("two"), lambda r: bool(r["wanted"] <= r["named"])),
        ("truth in the 95 % set", list(rows), lambda r: bool(r["covered"])),
    ]
    lines = table_head(["figure", "value"])
    lines += [
        table_row([name, f"{sum(map(test, chosen))} of {len(chosen)}"])
        for name, chosen, test in asked
    ]
    given = [r["p"] for r in rows]
    error = calibration_error(given, [r["first_right"] for r in rows])
    runtimes = [r["runtime"] for r in rows if np.isfinite(r["runtime"])]
    median = f"{np.median(runtimes):.1f} s" if runtimes else "–"
    return [
        *lines,
        table_row(["mean size of that set", f"{np.mean([r['size'] for r in rows]):.2f}"]),
        table_row(["expected calibration error of the first answer", f"{error:.3f}"]),
        table_row(["the same by chance, were they right", f"{chance_error(given):.3f}"]),
        table_row(["median time of a diagnosis", median]),
    ]


def _band(rows: Sequence[Row], strong: bool) -> list[Row]:
    return [r for r in rows if (r["strength"] >= BAND) is strong]


def case_table(rows: Sequence[Row], truths: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """One line a case; sizes of effects in floors."""
    lines = table_head(
        ["case", "truth", "law", "answer", "first, its probability", "95 % set", "right", "time"]
    )
    for r in rows:
        truth = truths[r["name"]]
        sizes = ", ".join(f"{name} {size:.2f}" for name, size in truth["effects"].items())
        told = {"effect": sizes, "two": sizes, "unknown": f"unknown: {sizes}"}
        phrases = "; ".join(p.partition(": ")[2] for p in truth["law"].split("; ") if p)
        right = "yes" if r["answer"] == r["truth"] else "**no**"
        inside = ", ".join(sorted(r["credible"])) + ("" if r["covered"] else " (**without**)")
        lines.append(
            table_row(
                [
                    r["name"],
                    told.get(r["kind"], r["kind"]),
                    phrases or "–",
                    r["answer"],
                    f"{r['first']} {r['p']:.2f}",
                    inside,
                    right,
                    f"{r['runtime']:.0f} s",
                ]
            )
        )
    return lines


def _say(text: str, share: float) -> None:
    print(f"{100 * share:3.0f} % {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
