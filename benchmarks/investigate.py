"""Investigation against fixed plans on hidden cells of the emulated plant, computed.

For each cell: the first set alone, `investigate`, as many strikes chosen at random from the same
offer, and a fixed plan of as many strikes. Prints a line a cell, then how often the right name
leads, by the drawn size of the effect as in the blind check, and the strikes that were played.

Run: python benchmarks/investigate.py [--cells 80] [--seed 1] [--strikes 40] [--budget-strikes N]
     [--jobs 2] [--lines FILE] [--minutes M] [--markdown FILE]
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from tables import cells_parser, table_head, table_row

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.default_budgets import INVESTIGATION_STRIKES
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import parse_phrase, plan_score
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.cases.draw import draw_case
from pianobot_ros.emulator.plant.cases.effects import EFFECTS
from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes
from pianobot_ros.gap import Proposal
from pianobot_ros.piano.blind.investigated import investigate_case
from pianobot_ros.piano.blind.kept_lines import add_line, kept_lines, write_table
from pianobot_ros.piano.gap.diagnosis.diagnose import diagnose_recordings
from pianobot_ros.piano.gap.diagnosis.investigate import Goal, playable
from pianobot_ros.piano.gap.diagnosis.proposals import candidate_strikes, phrase_of
from pianobot_ros.piano.gap.effects import NAMES
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

PLANS = ("first set", "investigate", "at random", "fixed plan")
SIZES = {"1 to 3 floors": 3.0, "3 floors and more": np.inf}


def plans(folder: Path, case: Case, seed: int, goal: Goal, strikes: int) -> dict[str, Any]:
    """Leading name and strikes by plan, and the gap that the first set sees."""
    bag = folder / "case"
    write_bag(simulate_commands(standard_strikes(seed, strikes), case, encoder=True), bag)
    first = read_bag(bag)
    found = investigate_case(bag, case, goal, rig=True)
    if "investigation" not in found:
        raise SystemExit(f"{case.effects}: {found['sentence']}")
    investigation = found["investigation"]
    start, played = investigation["steps"][0], investigation["strikes"]
    leaders = dict.fromkeys(PLANS, next(iter(start["leading"])))
    leaders["investigate"] = found["candidates"][0]["name"]
    if played > strikes:  # else all plans are the first set

        def leader(*recordings: Recording) -> str:
            budget = goal.budget_for(played)
            done = diagnose_recordings(recordings, seed=goal.seed, budget=budget)
            return done.candidates[0].name

        drawn = at_random(first, played - strikes, goal)
        leaders["at random"] = leader(
            first, simulate_commands(drawn, case.in_session(1), encoder=True)
        )
        more = simulate_commands(standard_strikes(seed, played), case, encoder=True)
        leaders["fixed plan"] = leader(more)
    counts = dict.fromkeys(PLANS, played) | {"first set": strikes}
    return {
        "gap": round(start["gap"], 2),
        "ended": investigation["ended"],
        "leaders": leaders,
        "strikes": counts,
    }


def at_random(first: Recording, strikes: int, goal: Goal) -> Any:
    """A plan of so many strikes from the offer of the investigation, without a look at what they
    tell.
    """
    twin = PianoTwin([first])
    offered = candidate_strikes(twin, goal.seed + len(twin.blocks))
    order = np.random.default_rng([goal.seed, len(twin.blocks)]).permutation(len(offered))
    drawn = [Proposal(offered[i], 1.0, ("chance", "chance"), {}) for i in order]
    chosen = [p.to_json(1.0) for p in drawn if playable(p)][: max(strikes // goal.repeats, 1)]
    text = yaml_text(phrase_of(chosen, goal.repeats, "at random"))
    return plan_score(parse_phrase(text))


def line(
    cell: int, case: Case, seed: int, goal: Goal, strikes: int, end: float
) -> dict[str, Any] | None:
    """What :func:`plans` finds in one cell; None if the monotonic time ``end`` has passed."""
    if time.monotonic() > end:
        return None
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as place:
        found = plans(Path(place), case, seed, goal, strikes)
    seconds = round(time.process_time() - begun)
    return {"cell": cell, "effect": dict(case.effects), **found, "cpu_s": seconds}


def table(lines: Sequence[dict[str, Any]]) -> list[str]:
    """How often each plan names the hidden effect first, by the effect's size."""
    rows = table_head(["size of the effect", "cells", *PLANS, "mean strikes"])
    least = 0.0
    for size, most in SIZES.items():
        own = [x for x in lines if least <= max(x["effect"].values()) < most]
        least = most
        if own:
            rows.append(table_row((size, len(own), *_hits(own))))
    rows.append(table_row(("all", len(lines), *_hits(lines))))
    rows += ["", *table_head(["cell", "hidden", "gap", *PLANS, "strikes", "ended"])]
    for x in lines:
        named = ", ".join(f"{n} {m:.1f}" for n, m in x["effect"].items())
        leaders, strikes = [x["leaders"][p] for p in PLANS], x["strikes"]["investigate"]
        rows.append(table_row((x["cell"], named, x["gap"], *leaders, strikes, x["ended"])))
    return rows


def _hits(lines: Sequence[dict[str, Any]]) -> list[str]:
    """By plan, in how many cells the hidden effect leads; and the mean of the strikes played."""
    hits = [sum(x["leaders"][p] in x["effect"] for x in lines) for p in PLANS]
    mean = np.mean([x["strikes"]["investigate"] for x in lines])
    return [*(f"{h} of {len(lines)}" for h in hits), f"{mean:.1f}"]


def main() -> None:
    """Print one line a cell, then the table."""
    parser = cells_parser(__doc__, cells=80, strikes=40)
    parser.add_argument("--budget-strikes", type=int, default=INVESTIGATION_STRIKES)
    parser.add_argument(
        "--minutes", type=float, default=np.inf, help="after which no cell is begun"
    )
    options = parser.parse_args()
    random = np.random.default_rng([options.seed, 0x1A7E])
    known = [n for n in NAMES if n in EFFECTS]
    goal = Goal(strikes=options.budget_strikes, budget=options.budget)
    lines = kept_lines(options.lines)
    end = time.monotonic() + 60.0 * options.minutes
    cells = []
    for _ in range(options.cells):
        names = [known[int(random.integers(len(known)))]]
        drawn, seed = int(random.integers(2**31)), int(random.integers(2**31))
        case = draw_case(drawn, "effect", magnitude=(1.0, 10.0), names=names, laws=(0, 1, 2))
        cells.append((case, seed))
    begun = len(lines)
    work = (
        delayed(line)(begun + i, *cell, goal, options.strikes, end)
        for i, cell in enumerate(cells[begun:])
    )
    for found in Parallel(n_jobs=options.jobs, return_as="generator")(work):
        if found is None:
            break
        add_line(lines, found, options.lines)
    write_table(table(lines), options.markdown)


if __name__ == "__main__":
    main()
