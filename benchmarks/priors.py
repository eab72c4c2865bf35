"""What laws of the right kind leave of a gap, and what is left where the cause is not in the
library: from which share on *unknown* is the likelier answer (`Calibration.imprecision` and
`unknown_slope`, docs/diagnosis.md).

python benchmarks/imprecision.py --set dev --jobs 2

Small robots by another author (benchmarks/foreign_robots) are diagnosed: with one effect of the
library, once as they are and once without it, and with causes from outside of it. Where the best
hypothesis leaves anything, the probability that the cause is unknown goes by the share that it
leaves (`unknown_probability`). Its two numbers are those under which what is true is likeliest,
with a normal prior of each logarithm: the slope about 2, the odds of the even share about 1.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from foreign_robots.case_table import CASES, ROBOTS, SETS
from foreign_robots.drawing import draw_case
from joblib import Parallel, delayed
from scipy.optimize import minimize
from tables import table_head, table_row

from pianobot_ros.gap import Options
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.posterior.probabilities import Left, posterior
from pianobot_ros.gap.posterior.verdict import unknown_probability
from pianobot_ros.gap.problem.budget import BLOCKS, Budget
from pianobot_ros.gap.problem.options import Calibration

WIDTHS = (1.5, 0.5)
"""Prior standard deviations: of the log odds of the even share, and of the slope's logarithm."""
SLOPE = 2.0
"""Prior median of the slope."""


@dataclass(frozen=True)
class LeftShare:
    """What is left of a case's gap by its best hypothesis, and whether its cause is unknown."""

    case: str
    unknown: bool
    left: Left
    best: str


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--set", choices=SETS, default="dev", help="held: scored rarely")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    todo = [
        (robot, index, without)
        for robot in ROBOTS
        for index, plan in enumerate(CASES[options.set][robot])
        for without in ((False, True) if plan.kind == "effect" else (False,))
        if plan.kind in ("effect", "unknown")
    ]
    found = Parallel(n_jobs=options.jobs)(delayed(left_share)(options.set, *one) for one in todo)
    shares = sorted((x for x in found if x is not None), key=lambda x: x.left.share)
    print("\n".join(table_head(("case", "cause", "share left", "best"))))
    for x in shares:
        kind = "unknown" if x.unknown else "of the library"
        print(table_row((x.case, kind, f"{x.left.share:.2f}", x.best)))
    even, slope = learned(shares)
    print(f"\n{len(shares)} of {len(todo)} leave anything; even at {even:.2f}, slope {slope:.1f}")
    return 0


def left_share(which: str, robot: str, index: int, without: bool) -> LeftShare | None:
    """Of one case, `without` its effect in the library or with it; None where nothing is left."""
    case = draw_case(which, robot, index)
    names = [e.name for e in case.twin.effects if not (without and e.name in case.truth)]
    study = investigate(case.twin, case.blocks, Budget(BLOCKS), options=Options(only=tuple(names)))
    found = posterior(study)
    if found.left is None:
        return None
    name = f"{robot} {index}{' without ' + ', '.join(case.truth) if without else ''}"
    best = found.named.name if found.named else found.best.name
    return LeftShare(name, without or case.kind == "unknown", found.left, best)


def learned(shares: Sequence[LeftShare]) -> tuple[float, float]:
    """The even share and the slope."""

    def numbers(x: np.ndarray) -> tuple[float, float]:
        return float(1.0 / (1.0 + np.exp(-x[0]))), float(SLOPE * np.exp(x[1]))

    def cost(x: np.ndarray) -> float:
        even, slope = numbers(x)
        c = Calibration(imprecision=even, unknown_slope=slope)
        said = [(s.unknown, unknown_probability(c, s.left.share, s.left.worst)) for s in shares]
        loss = -sum(np.log(p if unknown else 1.0 - p) for unknown, p in said)
        return float(loss + 0.5 * np.sum((x / WIDTHS) ** 2))

    return numbers(minimize(cost, np.zeros(2), method="Nelder-Mead").x)


if __name__ == "__main__":
    sys.exit(main())
