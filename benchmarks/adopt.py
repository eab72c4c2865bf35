"""Adopting on hidden cells, computed: does a verdict help on a phrase that was not used?

Every cell of the emulated plant plays a first set, which is diagnosed, and the phrase `unheard`, on
which Err of Eq. 5 (the whole chain) and the gap are taken with the twin as it was and with what
would be adopted. The kinds take turns: an effect of the library by any of the plant's laws, one
that the library lacks, wrong parameters, nothing. A false cure is a cell in which either measure
grows for certain (lower end of the 95 % interval of the change above zero).

Run: python benchmarks/adopt.py [--cells 12] [--seed 1] [--strikes 24] [--jobs 1] [--lines FILE]
     [--markdown FILE]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from tables import cells_parser, table_head, table_row

from pianobot_ros.cell.recordings.before_after import UNHEARD
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import load_score, plan_score
from pianobot_ros.emulator.plant.cases.draw import draw_case
from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes
from pianobot_ros.gap import Measure, Offer, Options
from pianobot_ros.gap.diagnosis import Fold
from pianobot_ros.gap.explain.offer import change_of_gap
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.piano.blind.kept_lines import add_line, kept_lines, write_table
from pianobot_ros.piano.gap.adoption.adopt import adoption
from pianobot_ros.piano.gap.diagnosis.diagnose import diagnose_recordings
from pianobot_ros.piano.gap.diagnosis.err_held_out import err_held_out
from pianobot_ros.piano.gap.simulation.corrections import Corrections
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

KINDS = ("effect", "unknown", "parameters", "none")


def measures(recording: Recording, found: Corrections) -> dict[str, Measure | None]:
    """Err and gap of a phrase before and after adopting."""
    twin = PianoTwin([recording])
    values, effects = found.values(), tuple(found.effects)
    everything = tuple(b.name for b in twin.blocks)
    problem = Problem(twin, twin.blocks)
    nominal = problem.predict(problem.nominal(), ())
    gauge = Gauge(problem, NoiseModel.by(problem, problem.y - nominal, Options()))
    after = problem.predict({**problem.nominal(), **values}, effects)
    return {
        "err": err_held_out(Offer(effects, (Fold(everything, values),)), twin),
        "gap": change_of_gap(gauge, nominal, after, 0),
    }


def cell(kind: str, drawn: int, seed: int, strikes: int, budget: int) -> dict[str, Any]:
    """What adopting does to one hidden cell."""
    case = draw_case(drawn, kind, magnitude=(1.0, 10.0), laws=(0, 1, 2))
    first = simulate_commands(standard_strikes(seed, strikes), case, encoder=True)
    found = diagnose_recordings([first], budget=budget)
    offered = adoption(found.to_json())
    unheard = plan_score(load_score(UNHEARD))
    phrase = simulate_commands(unheard, case.in_session(1), encoder=True)
    measured = measures(phrase, offered.corrections)
    return {
        "kind": kind,
        "effect": dict(case.effects),
        "verdict": found.verdict,
        "named": found.candidates[0].name,
        "adopted": bool(offered.corrections),
        "why": offered.sentence,
        **{n: vars(m) for n, m in measured.items() if m is not None},
    }


def table(lines: Sequence[dict[str, Any]]) -> list[str]:
    """A row a cell, then the false cures and the share of the gap above the floor that is gone."""
    names = "cell", "hidden", "named first (verdict)", "adopted", "Err before, after %", "gap"
    rows = table_head(names)
    false, shares = 0, []
    for i, x in enumerate(lines):
        hidden = ", ".join(f"{n} {m:.1f}" for n, m in x["effect"].items()) or x["kind"]
        err, gap = x.get("err"), x["gap"]
        shown = "-" if err is None else f"{100 * err['before']:.1f}, {100 * err['after']:.1f}"
        false += x["adopted"] and any(m and m["low"] > 0.0 for m in (err, gap))
        if gap["before"] > 1.1:
            shares.append((gap["before"] - gap["after"]) / (gap["before"] - 1.0))
        found, taken = f"{x['named']} ({x['verdict']})", "yes" if x["adopted"] else "no"
        gaps = f"{gap['before']:.2f}, {gap['after']:.2f}"
        rows.append(table_row((i, hidden, found, taken, shown, gaps)))
    adopted = sum(x["adopted"] for x in lines)
    rows += ["", f"{adopted} of {len(lines)} adopt something; false cures: {false}."]
    if shares:
        rows.append(
            f"Of the gap above the floor {100 * float(np.median(shares)):.0f} % are gone, median of"
            f" {len(shares)} cells with one (nothing adopted counts as 0)."
        )
    return rows


def main() -> None:
    """Print one line a cell, then the table."""
    options = cells_parser(__doc__, cells=12, strikes=24).parse_args()
    random = np.random.default_rng([options.seed, 0xAD0])
    lines = kept_lines(options.lines)
    cells = [
        (KINDS[i % len(KINDS)], int(random.integers(2**31)), int(random.integers(2**31)))
        for i in range(options.cells)
    ]
    work = (delayed(cell)(*c, options.strikes, options.budget) for c in cells[len(lines) :])
    for found in Parallel(n_jobs=options.jobs, return_as="generator")(work):
        add_line(lines, found, options.lines)
    write_table(table(lines), options.markdown)


if __name__ == "__main__":
    main()
