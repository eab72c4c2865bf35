"""Calibrate the diagnosis of the piano cell or of the servo axis: cells with known causes are
diagnosed, and how sure to be, and what a credible set must hold, is learned from them and written
to one file.

python benchmarks/calibrate.py --cases 130 --seed 617 --laws 0,1,2 --keep DIR --out FILE
python benchmarks/calibrate.py --plant axis --cases 120 --keep DIR --out FILE

Learned is the temperature of series and of events (one η per kind of observable: Grünwald and van
Ommen 2017); by group of first answers (an effect; unknown; none or parameters) the scaling of the
log odds: a power, and shifts towards *unknown*, what has no effect, and what may hide (vector
scaling: Guo, Pleiss, Sun and Weinberger 2017). Each is the maximum of the log probability of the
truth with a normal prior about "as the scores say", so that what the cells do not determine stays.
Learned, too, is the mass that a credible set must hold, by group, so that 95 % of the cells are
covered, and never less than 0.95 (adaptive prediction sets: Romano, Sesia and Candès 2020). Every
cell counts twice where it has one effect of the library: as it is, and without the hypotheses that
hold the true effect, where *unknown* or a declared relative is the truth. With `--narrow` every
piano cell is diagnosed once more, by a library whose laws have nothing but their size to fit: its
laws are as far from the plant's as they may be from a robot's, and what a law of the right kind
leaves is learned from it.
Temperatures and a group's scaling stay as they are set unless what was learned predicts cells that
were left out of the learning, in turn, better by more than a standard error.

The studies are kept in DIR (some 140 MB a piano cell), and a cell that is there is not diagnosed
again; cells that `pianobot blind make` made are taken as well (DIR/cases and DIR/answers.json).
"""

from __future__ import annotations

import argparse
import pickle
import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

from calibration.axis_joints import AxisJoints
from calibration.learning import learn
from calibration.piano_cells import PianoCells
from calibration.views import AS_SET, FACTORS, seen
from joblib import Parallel, delayed

from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.config import config_dir
from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.cell.numbers.learned import Origin
from pianobot_ros.cell.version import code_version

Cells = PianoCells | AxisJoints
PLANTS: dict[str, type[PianoCells] | type[AxisJoints]] = {"piano": PianoCells, "axis": AxisJoints}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plant", choices=PLANTS, default="piano")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=611, help="a development seed: 1 to 999")
    parser.add_argument("--laws", default="0,1", help="laws of the plant; the others stay unseen")
    parser.add_argument("--budget", type=int, default=DIAGNOSIS_BUDGET, help="simulated blocks")
    parser.add_argument("--most", type=int, help="diagnose at most so many cells now (0: none)")
    parser.add_argument("--narrow", action="store_true", help="with narrow laws, too (piano)")
    parser.add_argument("--jobs", type=int, default=1, help="processes that diagnose")
    parser.add_argument("--keep", type=Path, required=True, help="folder of cells and studies")
    parser.add_argument("--out", type=Path, help="default: the plant's own file of config/")
    options = parser.parse_args()
    cells = PLANTS[options.plant](options.keep)
    laws = tuple(int(x) for x in options.laws.split(","))
    cells.make(options.cases, options.seed, laws, options.jobs)
    widths = (False, True) if options.narrow else (False,)
    investigate_cells(cells, options.budget, options.most, options.jobs, widths)
    kept = [path for narrow in widths for path in sorted(studies(cells, narrow).glob("*.pkl"))]
    if len(kept) < 2:
        print(f"{len(kept)} cells are diagnosed: nothing to learn from yet")
        return 0
    each = Parallel(n_jobs=options.jobs)(
        delayed(seen)(path, cells.truth(path.stem), cells.options) for path in kept
    )
    views = {f: [v for one in each for v in one[f]] for f in FACTORS}
    version: dict[str, Any] = dict(code_version())
    origin = Origin(
        command="python benchmarks/calibrate.py",
        plant=cells.plant,
        cells=len({v.cell for v in views[AS_SET]}),
        date=date.today().isoformat(),
        **cells.origin,
        **version,
    )
    learned = learn(views, cells.options.calibration).model_copy(update={"provenance": origin})
    text = yaml_text(learned.model_dump())
    print(text)
    out = options.out or config_dir() / cells.file
    out.write_text(f"# Written by benchmarks/calibrate.py; not by hand.\n{text}", encoding="utf-8")
    return 0


def studies(cells: Cells, narrow: bool) -> Path:
    """Where the studies of the cells are kept."""
    return cells.keep / ("studies-narrow" if narrow else "studies")


def investigate_cells(
    cells: Cells, budget: int, most: int | None, jobs: int, widths: Sequence[bool]
) -> None:
    """Put on the table what may explain each cell, and keep it."""
    for narrow in widths:
        studies(cells, narrow).mkdir(parents=True, exist_ok=True)
    todo = [
        (name, narrow)
        for narrow in widths
        for name in cells.names
        if not (studies(cells, narrow) / f"{name}.pkl").is_file()
    ][:most]
    Parallel(n_jobs=jobs)(delayed(keep_study)(cells, name, budget, narrow) for name, narrow in todo)


def keep_study(cells: Cells, name: str, budget: int, narrow: bool) -> None:
    study = cells.investigate(name, budget, narrow)
    new = studies(cells, narrow) / f"{name}.new"
    new.write_bytes(pickle.dumps(study))
    new.rename(new.with_suffix(".pkl"))
    print(name, "narrow" if narrow else "", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
