"""Diagnoses of hurt recordings: what is refused, what is diagnosed, and whether damage that leaves
most strikes whole changes the verdict.

python benchmarks/hurt_bags.py [--each 2] [--strikes 16] [--budget 6000] [--minutes M] [--prepare]
    [--out FILE]

Every recording goes through a bag on disk, as a user's would. ``--prepare`` only cuts and simulates
once, which finds most crashes in a tenth of the time. Every kind of damage comes once before one
comes twice; with ``--minutes`` no diagnosis begins after so much computing, and what was left out
is said.
"""

from __future__ import annotations

import argparse
import math
import platform
import resource
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
from pianobot_ros.gap import Diagnosis
from pianobot_ros.piano.gap import diagnose_recordings
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin
from pianobot_ros.testing.damage import DAMAGES, whole_strikes

WHOLE = 0.8  # share of strikes left whole from which a verdict should stand
EFFECTS: tuple[dict[str, float], ...] = (
    {"key_friction": 5.0},
    {"joint_creep": 5.0},
    {"midi_latency": 5.0},
    {},
)


class Result(NamedTuple):
    """What became of one hurt recording: ``fate`` refused, diagnosed or crashed."""

    fate: str
    text: str
    verdict: str = ""
    named: frozenset[str] = frozenset()
    credible: frozenset[str] = frozenset()


def diagnose(recording: Recording, budget: int, only_prepare: bool) -> Result:
    try:
        if only_prepare:
            twin = PianoTwin([recording])
            nominal = {p.name: p.nominal for p in twin.parameters}
            twin.simulate(twin.blocks, nominal, ())
            return Result("diagnosed", f"{len(twin.blocks)} strikes", "prepared")
        found: Diagnosis = diagnose_recordings([recording], budget=budget)
    except PianobotError as error:
        return Result("refused", str(error))
    except Exception as error:  # what this program looks for
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).parent.name}/{Path(last.filename).name}:{last.lineno}"
        return Result("crashed", f"{type(error).__name__}: {error} ({place})")
    named = frozenset(e.name for e in found.effects)
    return Result("diagnosed", found.sentence, found.verdict, named, frozenset(found.credible_set))


def on_disk(recording: Recording, folder: Path) -> Recording:
    """``recording`` after a bag; what a bag cannot hold stays in memory."""
    try:
        return read_bag(write_bag(recording, folder))
    except (PianobotError, ValueError, IndexError):
        return recording


@dataclass
class Tally:
    """What became of the recordings, and how often the verdict changed."""

    fates: Counter[str] = field(default_factory=Counter)
    stood: int = 0
    changed: int = 0
    wrong: int = 0

    def count(self, result: Result, left: float, reference: Result) -> None:
        """One hurt recording, ``left`` (0 to 1) of its strikes whole, beside the whole one."""
        self.fates[result.fate] += 1
        if left >= WHOLE and result.fate == "diagnosed":
            self.stood += 1
            same = (result.verdict, result.named) == (reference.verdict, reference.named)
            self.changed += not same
            self.wrong += bool(result.named - reference.credible)

    def __str__(self) -> str:
        return (
            f"{sum(self.fates.values())} inputs: {self.fates['diagnosed']} diagnosed,"
            f" {self.fates['refused']} refused, {self.fates['crashed']} crashed. Of {self.stood}"
            f" with at least {100 * WHOLE:.0f} % of the strikes whole, {self.changed} have another"
            f" verdict than the whole recording, {self.wrong} name a cause that the whole recording"
            " excludes."
        )


def computed() -> float:
    """Processor time of this process and those that it started, s."""
    return sum(
        sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )


def rows(options: argparse.Namespace, tally: Tally) -> Iterator[str]:
    """A line of the table for each hurt recording."""
    kinds = [n for n in options.only.split(",") if n] or list(DAMAGES)
    cells: dict[int, tuple[Recording, Result]] = {}
    inputs = [(k, kind, i) for i in range(options.each) for k, kind in enumerate(kinds)]
    limit = 60.0 * options.minutes if options.minutes else math.inf
    with tempfile.TemporaryDirectory() as scratch:
        for number, (k, kind, i) in enumerate(inputs):
            if computed() > limit:
                yield f"| {len(inputs) - number} more | | left out | the time was up |"
                return
            cell = (k + i) % len(EFFECTS)
            if cell not in cells:
                whole = simulate_cell(
                    standard_strikes(7 + cell, options.strikes),
                    effects=EFFECTS[cell],
                    seed=7 + cell,
                )
                cells[cell] = whole, diagnose(whole, options.budget, options.prepare)
            whole, reference = cells[cell]
            hurt = DAMAGES[kind](whole, np.random.default_rng([options.seed, k, i]))
            left = whole_strikes(whole, hurt)
            result = diagnose(
                on_disk(hurt, Path(scratch) / f"{kind}{i}"), options.budget, options.prepare
            )
            tally.count(result, left, reference)
            text = result.text.replace("|", "/")[:110]
            yield f"| {kind} | {100 * left:.0f} % | {result.fate} | {text} |"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--each", type=int, default=2, help="recordings of each kind of damage")
    parser.add_argument("--strikes", type=int, default=16)
    parser.add_argument("--budget", type=int, default=6000, help="simulated strikes, each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="only these kinds of damage, comma separated")
    parser.add_argument("--minutes", type=float, help="of computing, for all together")
    parser.add_argument("--prepare", action="store_true", help="cut and simulate, do not diagnose")
    parser.add_argument("--out", type=Path, help="also write the table there")
    options = parser.parse_args()
    given = {"each": 2, "strikes": 16, "budget": 6000, "seed": 0, "minutes": None}
    words = [
        f"--{name} {getattr(options, name):g}"
        for name, usual in given.items()
        if getattr(options, name) != usual
    ]
    command = " ".join(["python benchmarks/hurt_bags.py", *words])
    lines = ["# Hurt recordings", "", f"`{command}`, Python {platform.python_version()}.", ""]
    lines += ["| damage | strikes whole | fate | what it says |", "|---|---|---|---|"]
    tally = Tally()
    print("\n".join(lines), flush=True)
    for line in rows(options, tally):
        lines.append(line)
        print(line, flush=True)
        if options.out:
            options.out.write_text("\n".join([*lines, "", str(tally)]) + "\n", encoding="utf-8")
    print(f"\n{tally}")
    return 1 if tally.fates["crashed"] else 0


if __name__ == "__main__":
    raise SystemExit(main())
