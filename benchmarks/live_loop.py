"""Closing the loop live: hidden cells through the real graph, and a phrase that was not used before
adopting, with the parameters that alone explain most, and with the verdict.

For each seed three steps, each of which keeps what it made: ``record`` plays the demo's phrase on
the emulated cell with its hidden effect, ``diagnose`` looks at the bag, ``compare`` plays the
unheard phrase three times. The table: Err of Eq. 5, the gap in floors, and the share of the gap
above the floor that is closed.

Run: python benchmarks/live_loop.py --seeds 12 --first 1 --folder DIR
     [--step record|diagnose|compare] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from tables import table_head, table_row

from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.cell.recordings.before_after import UNHEARD, Heard, heard, share_closed
from pianobot_ros.cli.demo.closing_loop import play_and_compare
from pianobot_ros.cli.demo.demonstration import ANSWER, PHRASE, hidden_effect
from pianobot_ros.cli.demo.requests import adopt, forget
from pianobot_ros.cli.graph.running_cell import isolated_emulation, running_cell

STEPS = ("record", "diagnose", "compare")
TWINS = ("as it was", "parameters", "verdict")


def record(folder: Path, seed: int, domain: int) -> None:
    """Play the demo's phrase into ``folder/bag``."""
    if (folder / "bag").exists():
        return
    hidden = isolated_emulation(*hidden_effect(seed, folder))
    with running_cell(emulated=hidden, jobs=False, screen=False, run=folder, domain=domain) as cell:
        played, _ = play_and_compare(cell, PHRASE)
    if not played.success:
        raise SystemExit(f"seed {seed}: {played.message}")


def diagnose(folder: Path) -> None:
    """Write the verdict's overlay and that of the parameters alone; an empty file: nothing to
    adopt.
    """
    from pianobot_ros.piano.gap import diagnose_bag
    from pianobot_ros.piano.gap.adoption.adopt import adoption
    from pianobot_ros.piano.gap.simulation.corrections import Correction, Corrections, cell_id
    from pianobot_ros.piano.gap.simulation.description import nuisances

    if (folder / "verdict.yaml").exists():
        return
    found = diagnose_bag(folder / "bag", output=folder / "diagnosis", budget=DIAGNOSIS_BUDGET)
    fits = {h.name: h.values for h in found.hypotheses}
    own = {p.name: p.unit for p in nuisances()}
    alone = {n: Correction(x, unit=own[n]) for n, x in fits["parameters"].items() if n in own}
    overlays = {
        "parameters": Corrections(alone, {}, cell_id()),
        "verdict": adoption(found.to_json()).corrections,
    }
    for name, overlay in overlays.items():
        text = overlay.to_yaml() if overlay else ""
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")


def compare(folder: Path, seed: int, domain: int) -> None:
    """Play the unheard phrase with each twin; what was heard goes to ``heard.json``."""
    if (folder / "heard.json").exists():
        return
    hidden = isolated_emulation(*hidden_effect(seed, folder))
    reports: dict[str, list[Any]] = {}
    with running_cell(
        emulated=hidden, jobs=False, screen=False, run=folder / UNHEARD, domain=domain
    ) as cell:
        for name in TWINS:
            overlay = "" if name == TWINS[0] else (folder / f"{name}.yaml").read_text("utf-8")
            if overlay:
                adopt(cell, overlay)
            if overlay or name == TWINS[0]:
                _, reports[name] = play_and_compare(cell, UNHEARD)
            if overlay:
                forget(cell)
    everything = [r for own in reports.values() for r in own]
    found = {n: heard(own, everything).to_json() for n, own in reports.items()}
    (folder / "heard.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _heard(document: dict[str, Any]) -> Heard:
    values: dict[str, Any] = {n: math.nan if x is None else x for n, x in document.items()}
    return Heard(**values)


def row(folder: Path, seed: int) -> tuple[str, float]:
    """A line of the table, and the share that the verdict closed."""
    kept = json.loads((folder / "heard.json").read_text("utf-8"))
    found = {n: _heard(kept[n]) if n in kept else None for n in TWINS}
    answer = json.loads((folder / ANSWER).read_text("utf-8"))["effects"]
    verdict = json.loads((folder / "diagnosis" / "diagnosis.json").read_text("utf-8"))
    first = verdict["candidates"][0]["name"]
    hidden = ", ".join(f"{n} {m:.1f}" for n, m in answer.items())
    cells = [str(seed), hidden, f"{first} ({verdict['verdict']})"]
    before = found[TWINS[0]]
    assert before is not None
    for name in TWINS:
        own = found[name] or before  # nothing to adopt: it stays as it was
        cells.append(
            f"{100 * own.err:.1f} % ({100 * own.err_low:.1f} to {100 * own.err_high:.1f}),"
            f" {own.gap:.2f} ({own.low:.2f} to {own.high:.2f})"
        )
    closed = share_closed(before, found["verdict"] or before)
    cells.append("nothing to close" if math.isnan(closed) else f"{100 * closed:.0f} %")
    return table_row(cells), closed


def main() -> None:
    """Do the steps that are asked for, and print the table of what is whole."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=1, help="seed of the first hidden cell")
    parser.add_argument("--seeds", type=int, default=12, help="number of cells")
    parser.add_argument("--folder", type=Path, required=True, help="where everything is kept")
    parser.add_argument("--step", choices=STEPS, help="one step only")
    parser.add_argument("--domain", type=int, default=44, help="ROS_DOMAIN_ID")
    parser.add_argument("--out", type=Path, help="the table is written here too")
    options = parser.parse_args()
    lines = table_head(["seed", "hidden, × floor", "named first", *TWINS, "closed"])
    shares = []
    for seed in range(options.first, options.first + options.seeds):
        folder = options.folder.absolute() / f"seed-{seed}"
        folder.mkdir(parents=True, exist_ok=True)
        if options.step in (None, "record"):
            record(folder, seed, options.domain)
        if options.step in (None, "diagnose"):
            diagnose(folder)
        if options.step in (None, "compare"):
            compare(folder, seed, options.domain)
        if (folder / "heard.json").exists():
            line, closed = row(folder, seed)
            lines.append(line)
            shares.append(closed)
    known = [s for s in shares if not math.isnan(s)]
    if known:
        lines += [
            "",
            f"Median share closed: {100 * float(np.median(known)):.0f} % of {len(known)}.",
        ]
    print("\n".join(lines))
    if options.out:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
