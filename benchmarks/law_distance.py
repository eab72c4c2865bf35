"""How far the laws of the library are from those of the plant: of each family and each of its laws
in the plant, what the library's own law leaves of the gap, refitted with all parameters.

Run: python benchmarks/law_distance.py [--laws 0,1,2] [--floors 6] [--families NAME,…]

A family whose law has the right form leaves nothing above the floor, whatever its values. What is
left is the form's own error: beyond `imprecision` (config, `gap.options.Calibration`) the diagnosis
must call such a cell *unknown*. Held-out strikes, all parameters of the cell off by up to 20 %.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from calibration.piano_cells import refuse_held_back
from tables import table_head, table_row

from pianobot_ros.emulator.plant.cases.draw import draw_case
from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.posterior.leftover import excess
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.search.study import Study, gaps, simulated
from pianobot_ros.piano.gap.diagnosis.settings import prior_options
from pianobot_ros.piano.gap.effects import NAMES
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

BUDGET = 40_000


def studied(name: str, law: int, floors: float, seed: int) -> Study:
    """A cell with this effect by this law, studied with a library of the family alone."""
    case = draw_case(seed, "effect", magnitude=(floors, floors), names=[name], laws=(law,))
    recording = simulate_commands(standard_strikes(seed), case)
    twin = PianoTwin([recording])
    options = replace(prior_options(), only=(name,), max_effects=1)
    return investigate(twin, twin.blocks, Budget(BUDGET), options=options)


def row(name: str, law: int, floors: float, seed: int) -> list[object]:
    """Law, gap before and after, share left, where most of it is left, and the fitted values."""
    begun = time.process_time()
    study = studied(name, law, floors, seed)
    for e in study.entries:
        study = simulated(study, e)
    refit = study.entry("parameters")
    own = [e for e in study.entries if e.effects == (name,)]
    best = min(own, key=lambda e: e.gap, default=refit)
    material = study.options.calibration.material**2
    left, whole = (np.maximum(excess(study, e) - material, 0.0) for e in (best, refit))
    share = left.sum() / whole.sum() if whole.sum() > 0 else np.nan
    worst = int(np.argmax(left))
    where = study.problem.observables[worst].name.replace("|", "\\|") if left[worst] > 0 else ""
    values = dict(best.fit.space.decode(best.fit.v)) if best.fit else {}
    own_names = [p.name for p in study.problem.effects[name].parameters]
    return [
        name,
        law,
        f"{gaps(study, refit).max():.1f}",
        f"{gaps(study, best).max():.1f}",
        f"{100 * share:.0f} %",
        where,
        " ".join(f"{values[n]:.3g}" for n in own_names if n in values),
        f"{time.process_time() - begun:.0f}",
    ]


def main() -> None:
    """Print the table, a line as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laws", default="0,1,2")
    parser.add_argument("--floors", type=float, default=6.0)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--families", default=",".join(NAMES))
    options = parser.parse_args()
    laws = [int(x) for x in options.laws.split(",")]
    refuse_held_back(laws)
    print(
        "\n".join(
            table_head(("family", "law", "refitted", "with it", "left", "where", "values", "CPU s"))
        )
    )
    for name in options.families.split(","):
        for law in laws:
            print(table_row(row(name, law, options.floors, options.seed)), flush=True)


if __name__ == "__main__":
    main()
