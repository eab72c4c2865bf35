"""The blind check on four small robots, twins and plants of which were written by somebody who had
not read the engine: draws a set by its fixed seeds, diagnoses every case and scores it.

python benchmarks/blind_foreign_robots.py --set dev --robots arm,cart --jobs 2
python benchmarks/blind_foreign_robots.py --set held --jobs 2 --out FILE.md
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from foreign_robots.case_table import CASES, ROBOTS, SETS, Kind
from foreign_robots.drawing import HiddenRobot, draw_case
from joblib import Parallel, delayed
from tables import table_head, table_row

from pianobot_ros.gap import Diagnosis, diagnose
from pianobot_ros.piano.blind.reliability import calibration_error, chance_error

BAND = 3.0  # floors; what is below is small
CALIBRATED = 20  # cases, below which a calibration error says nothing
FAILED = "error"
COLUMNS = (
    "case",
    "kind",
    "truth: floors (what refitted parameters leave)",
    "law of the plant",
    "verdict",
    "named",
    "first: probability",
    "credible set",
    "gap before, refitted, after",
    "s",
    "right",
)


@dataclass(frozen=True)
class CaseRow:
    """A diagnosed case. ``strength`` is the largest size in floors, 0 without a law; ``first`` has
    the probability that it is at work.
    """

    name: str
    kind: Kind
    truth: frozenset[str]
    told: str
    law: str
    strength: float
    verdict: str
    named: tuple[str, ...]
    first: str
    probability: float
    credible: tuple[str, ...]
    gap: tuple[float, float, float]
    seconds: float
    held: tuple[bool, ...] = ()
    """Of each parameter whether its 95 % interval holds the truth."""

    @property
    def right(self) -> bool:
        """Exactly the truth is named; of what has no name in the library, the verdict says so."""
        if self.kind in ("effect", "pair"):
            return self.verdict == "effect" and set(self.named) == self.truth
        return self.verdict == self.kind

    @property
    def first_right(self) -> bool:
        """The first name is (one of) the truth."""
        return self.first in self.truth

    @property
    def covered(self) -> bool:
        """All of the truth is in the credible set."""
        return self.truth <= set(self.credible)

    @property
    def mark(self) -> str:
        """How right it is, in a word."""
        if self.right:
            return "yes"
        return "first" if self.first_right else "no"

    def cells(self) -> tuple[str, ...]:
        """What its line of the table holds."""
        return (
            self.name,
            self.kind,
            self.told or "-",
            self.law or "-",
            self.verdict,
            ", ".join(self.named) or "-",
            f"{self.first}: {self.probability:.2f}",
            ", ".join(self.credible),
            ", ".join(f"{x:.2f}" for x in self.gap),
            f"{self.seconds:.1f}",
            self.mark,
        )


def diagnose_case(which: str, robot: str, index: int) -> CaseRow:
    """Draw and diagnose a case. An engine that fails has given an answer that is wrong."""
    case = draw_case(which, robot, index)
    begun = time.perf_counter()
    try:
        found = diagnose(case.twin, case.blocks, seed=0)
    except Exception as error:
        print(f"{robot} {index}: {error!r}", file=sys.stderr, flush=True)
        found = None
    return row_of(case, found, time.perf_counter() - begun)


def row_of(case: HiddenRobot, found: Diagnosis | None, seconds: float) -> CaseRow:
    """What is true beside what was found."""
    verdict, first, probability = FAILED, FAILED, 0.0
    named: tuple[str, ...] = ()
    credible: tuple[str, ...] = ()
    gap = (float("nan"), float("nan"), float("nan"))
    held: tuple[bool, ...] = ()
    if found:
        # Of two effects each is at work with the probability that the headline gives it.
        at_work = {e.name: e.probability for e in found.effects}
        verdict, named, first = found.verdict, tuple(at_work), found.candidates[0].name
        probability = at_work.get(first, found.candidates[0].probability)
        credible = tuple(found.credible_set)
        gap = (found.gap.before, found.gap.refit, found.gap.after)
        told = ((e, case.parameters[n]) for n, e in found.parameters.items())
        held = tuple(e.low <= true <= e.high for e, true in told)
    return CaseRow(
        name=f"{case.robot} {case.index}",
        kind=case.kind,
        truth=case.truth,
        told="; ".join(
            f"{law.family} {law.raw.floors:.1f} ({law.beyond_refit.floors:.1f})"
            for law in case.laws
        ),
        law="; ".join(f"{law.text} ({law.size:.3g})" for law in case.laws),
        strength=max((law.raw.floors for law in case.laws), default=0.0),
        verdict=verdict,
        named=named,
        first=first,
        probability=probability,
        credible=credible,
        gap=gap,
        seconds=seconds,
        held=held,
    )


def summary(rows: Sequence[CaseRow]) -> Iterator[tuple[str, str]]:
    """What was asked for, and how it came out."""

    def share(of: Sequence[Any], test: Callable[[Any], bool]) -> str:
        return f"{sum(map(test, of))} of {len(of)}"

    def of_kind(*kinds: Kind) -> list[CaseRow]:
        return [r for r in rows if r.kind in kinds]

    single = of_kind("effect")
    for name, band in (
        (f"one effect of {BAND:g} floors and more", [r for r in single if r.strength >= BAND]),
        (f"one effect below {BAND:g} floors", [r for r in single if r.strength < BAND]),
    ):
        yield f"{name}: named, and no other", share(band, lambda r: r.right)
        yield f"{name}: first", share(band, lambda r: r.first_right)
    nothing = of_kind("none", "parameters")
    yield "none: called none", share(of_kind("none"), lambda r: r.right)
    yield (
        "wrong parameters only: called parameters",
        share(of_kind("parameters"), lambda r: r.right),
    )
    yield "none or parameters: called an effect", share(nothing, lambda r: r.verdict == "effect")
    yield "outside of the library: called unknown", share(of_kind("unknown"), lambda r: r.right)
    yield "two effects: both named, and no other", share(of_kind("pair"), lambda r: r.right)
    yield "two effects: one of them first", share(of_kind("pair"), lambda r: r.first_right)
    yield "truth in the credible set", share(rows, lambda r: r.covered)
    yield "mean size of the credible set", f"{np.mean([len(r.credible) for r in rows]):.1f}"
    if len(rows) >= CALIBRATED:
        told = [r.probability for r in rows]
        error = calibration_error(told, [r.first_right for r in rows])
        by_chance = f"{error:.2f} ({chance_error(told):.2f} by chance alone)"
        yield "expected calibration error of the first answer", by_chance
    held = [x for r in rows if r.right and r.kind != "unknown" for x in r.held]
    yield "95 % intervals that hold the parameter, where the answer is right", share(held, bool)
    yield "median time of a diagnosis", f"{np.median([r.seconds for r in rows]):.1f} s"


def page(options: argparse.Namespace, rows: Sequence[CaseRow]) -> str:
    """The results as a page of Markdown."""
    command = "python benchmarks/blind_foreign_robots.py " + " ".join(sys.argv[1:])
    lines = [
        "# Robots by another author, blind",
        "",
        f"`{command}`: {len(rows)} cases of the set `{options.set}`, seeds of the set, `seed=0` and"
        " default options of `diagnose`.",
        "",
        *table_head(("what", "result")),
        *map(table_row, summary(rows)),
        "",
        *table_head(COLUMNS),
        *(table_row(r.cells()) for r in rows),
    ]
    return "\n".join(lines) + "\n"


def main() -> int:
    options = _options()
    cases = [
        (options.set, robot, index)
        for robot in options.robots
        for index in options.cases or range(len(CASES[options.set][robot]))
    ]
    rows = []
    work = (delayed(diagnose_case)(*case) for case in cases)
    for row in Parallel(n_jobs=options.jobs, return_as="generator")(work):
        rows.append(row)
        print(" | ".join(row.cells()), flush=True)
    print()
    for name, result in summary(rows):
        print(f"{name}: {result}")
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(page(options, rows), encoding="utf-8")
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--set", choices=SETS, default=SETS[0], help="held: scored rarely, never looked into"
    )
    parser.add_argument(
        "--robots", type=_robots, default=list(ROBOTS), help=f"of {','.join(ROBOTS)}; all"
    )
    parser.add_argument(
        "--cases", type=_numbers, help="only these of each robot, as in 0,6,11; all"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes, each with a case")
    parser.add_argument("--out", type=Path, help="write the page here")
    return parser.parse_args()


def _robots(text: str) -> list[str]:
    names = text.split(",")
    if strange := set(names) - set(ROBOTS):
        raise argparse.ArgumentTypeError(f"no robot {', '.join(sorted(strange))}")
    return names


def _numbers(text: str) -> list[int]:
    return [int(x) for x in text.split(",")]


if __name__ == "__main__":
    sys.exit(main())
