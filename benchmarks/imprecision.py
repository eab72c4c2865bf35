"""What laws of the right kind leave of a gap, and what is left where the cause is not in the
library: from which share on *unknown* is the likelier answer (`Calibration.imprecision` and
`unknown_slope`, docs/diagnosis.md).

python benchmarks/imprecision.py --set dev --jobs 2

Small robots by another author (benchmarks/foreign_robots) are diagnosed: with one effect of the
library, once as they are and once without it, and with causes from outside of it. Where the best
hypothesis leaves anything, the probability that the cause is unknown is taken for a logistic
function of the log odds of the share that it leaves: maximum of the likelihood and of normal priors
(the slope about 2, the even share anywhere).
"""

from __future__ import annotations

import argparse
import sys
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
from pianobot_ros.gap.posterior.probabilities import posterior
from pianobot_ros.gap.problem.budget import BLOCKS, Budget
from pianobot_ros.gap.problem.options import Calibration

STEEP = Calibration().unknown_slope
"""Prior mean of the slope."""
WIDTHS = (1.0, 3.0)
"""Prior standard deviations: of the slope, and of the log odds of the even share about 0."""


@dataclass(frozen=True)
class LeftShare:
    """What is left of a case's gap by its best hypothesis, and whether its cause is unknown."""

    case: str
    unknown: bool
    share: float
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
    shares = sorted((x for x in found if x is not None), key=lambda x: x.share)
    print("\n".join(table_head(("case", "cause", "share left", "best"))))
    for x in shares:
        kind = "unknown" if x.unknown else "of the library"
        print(table_row((x.case, kind, f"{x.share:.2f}", x.best)))
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
    return LeftShare(name, without or case.kind == "unknown", found.left.share, best)


def learned(shares: list[LeftShare]) -> tuple[float, float]:
    """The share that is even and the slope."""
    share = np.clip([x.share for x in shares], 1e-3, 1.0 - 1e-3)
    odds, unknown = np.log(share / (1.0 - share)), np.array([x.unknown for x in shares])

    def cost(x: np.ndarray) -> float:
        logit = x[0] * (odds - x[1])
        prior = 0.5 * (((x[0] - STEEP) / WIDTHS[0]) ** 2 + (x[1] / WIDTHS[1]) ** 2)
        return float(np.logaddexp(0.0, np.where(unknown, -logit, logit)).sum() + prior)

    slope, even = minimize(cost, np.array([STEEP, 0.0])).x
    return float(1.0 / (1.0 + np.exp(-even))), float(slope)


if __name__ == "__main__":
    sys.exit(main())
