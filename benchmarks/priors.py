"""What robots of other authors say of three numbers that the engine believes before the data speak
(`gap.Calibration`, docs/diagnosis-method.md).

python benchmarks/priors.py --set dev --jobs 2
python benchmarks/priors.py --plant axis --cases 90 --jobs 2

Small robots by another author (benchmarks/foreign_robots) are diagnosed: with one effect of the
library, once as they are and once without it, with wrong parameters only, and with causes from
outside of the library.

- `imprecision`, `unknown_slope`: what laws of the right kind leave of a gap, and what is left where
  the cause is not in the library. Where the best hypothesis leaves anything, the probability that
  the cause is unknown goes by the share that it leaves (`unknown_probability`).
- `hidden` (of the robots only): where refitting leaves nothing, how much likelier than their priors
  say are effects that hide in the parameters.

With `--plant axis` the same is asked of joints of the emulated servo axis' development set, each
with dry friction beside its cause, as real joints have: it explains a part of the gap whether or
not the cause is in the library, so that less is left than where nothing is known of it. Joints of
which friction is the cause are not asked.

Each is that under which what is true is likeliest, with a normal prior of its logarithm: the slope
about 2, the odds of the even share and `hidden` about 1.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from calibration import views
from calibration.axis_joints import AxisJoints
from foreign_robots.case_table import CASES, ROBOTS, SETS
from foreign_robots.drawing import draw_case
from joblib import Parallel, delayed
from real_logs import FAMILIES
from scipy.optimize import minimize, minimize_scalar
from tables import table_head, table_row

from pianobot_ros.gap import Options
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.posterior.probabilities import Left, Posterior, posterior
from pianobot_ros.gap.problem.budget import BLOCKS, Budget
from pianobot_ros.gap.problem.options import Calibration

FRICTION = frozenset(FAMILIES["friction"])
WIDTHS = (1.5, 0.5)
"""Prior standard deviations: of the log odds of the even share, and of the slope's logarithm."""
SLOPE = 2.0
"""Prior median of the slope."""
SELDOM = 1e-3
"""Odds of a true effect that was not screened."""
HIDDEN_WIDTH = 1.5
"""Prior standard deviation of the logarithm of `hidden`."""


@dataclass(frozen=True)
class Finding:
    """A case, and what was found: what is `left` by the `best` hypothesis, if anything is; and the
    odds of the effects that may be `hidden`, and of the true one, where refitting leaves nothing.
    """

    case: str
    unknown: bool
    left: Left | None
    best: str
    hidden: float
    true: float | None


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plant", choices=("robots", "axis"), default="robots")
    parser.add_argument("--set", choices=SETS, default="dev", help="held: scored rarely")
    parser.add_argument("--cases", type=int, default=90, help="joints of the axis")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    if options.plant == "axis":
        joints = AxisJoints(Path(), dry=True)
        joints.make(options.cases, 0, (0,), options.jobs)
        each = Parallel(n_jobs=options.jobs)(delayed(of_joint)(joints, n) for n in joints.names)
        say_imprecision([x for own in each for x in own])
        return 0
    todo = [
        (robot, index, without)
        for robot in ROBOTS
        for index, plan in enumerate(CASES[options.set][robot])
        for without in ((False, True) if plan.kind == "effect" else (False,))
        if plan.kind in ("effect", "unknown", "parameters")
    ]
    found = Parallel(n_jobs=options.jobs)(delayed(finding)(options.set, *one) for one in todo)
    say_imprecision(found)
    closed = [x for x in found if x.hidden > 0.0 and not x.unknown]
    hiding = sum(x.true is not None for x in closed)
    print(
        f"refitting closes {len(closed)}, {hiding} of them with an effect that hides:"
        f" hidden {hidden_of(closed):.1f}"
    )
    return 0


def say_imprecision(found: Sequence[Finding]) -> None:
    """Print what is left of each case that leaves anything, the even share and the slope."""
    leaving = sorted(
        ((x, x.left) for x in found if x.left is not None), key=lambda one: one[1].share
    )
    print("\n".join(table_head(("case", "cause", "share left", "best"))))
    for x, left in leaving:
        kind = "unknown" if x.unknown else "of the library"
        print(table_row((x.case, kind, f"{left.share:.2f}", x.best)))
    even, slope = imprecision_of([(x.unknown, left) for x, left in leaving])
    print(f"\n{len(leaving)} of {len(found)} leave anything; even at {even:.2f}, slope {slope:.1f}")


def of_joint(joints: AxisJoints, name: str) -> list[Finding]:
    """Of one joint of the axis, with its cause in the library and, where it is, without; what has
    a relative in its place, which may be named, says nothing.
    """
    truth = joints.truth(name)
    if truth.kind not in ("effect", "unknown") or FRICTION & set(truth.effects):
        return []
    study = joints.investigate(name, BLOCKS, narrow=False)
    said = f"axis {name} {truth.effects[0]}"
    seen = [(said, truth.kind == "unknown", study)]
    if truth.kind == "effect":
        seen.append((f"{said}, without it", True, views.without(study, truth.effects[0])))
    out = []
    for case, unknown, one in seen:
        found = posterior(one)
        best = best_of(found)
        if not (unknown and (truth.relatives - FRICTION) & set(best.split("+"))):
            out.append(Finding(case, unknown, found.left, best, 0.0, None))
    return out


def best_of(found: Posterior) -> str:
    """The name of the foremost effect; of the foremost hypothesis where none may be named."""
    return (found.named or found.best).name


def finding(which: str, robot: str, index: int, without: bool) -> Finding:
    """Of one case, `without` its effect in the library or with it."""
    case = draw_case(which, robot, index)
    names = [e.name for e in case.twin.effects if not (without and e.name in case.truth)]
    study = investigate(case.twin, case.blocks, Budget(BLOCKS), options=Options(only=tuple(names)))
    found = posterior(study)
    name = f"{robot} {index}{' without ' + ', '.join(case.truth) if without else ''}"
    odds = found.table.hidden
    true = max(odds.get(n, SELDOM) for n in case.truth)
    return Finding(
        name,
        without or case.kind == "unknown",
        found.left,
        best_of(found),
        sum(odds.values()),
        true if case.kind == "effect" else None,
    )


def imprecision_of(shares: Sequence[tuple[bool, Left]]) -> tuple[float, float]:
    """The even share and the slope, from whether each cause is unknown, and what is left."""

    def numbers(x: np.ndarray) -> tuple[float, float]:
        return float(1.0 / (1.0 + np.exp(-x[0]))), float(SLOPE * np.exp(x[1]))

    def cost(x: np.ndarray) -> float:
        even, slope = numbers(x)
        c = Calibration(imprecision=even, unknown_slope=slope)
        said = [(unknown, x.unknown(c)) for unknown, x in shares]
        loss = -sum(np.log(p if unknown else 1.0 - p) for unknown, p in said)
        return float(loss + 0.5 * np.sum((x / WIDTHS) ** 2))

    return numbers(minimize(cost, np.zeros(2), method="Nelder-Mead").x)


def hidden_of(closed: Sequence[Finding]) -> float:
    """The factor on the odds of hidden effects, relative to the one that they were found with."""

    def cost(log: float) -> float:
        factor = float(np.exp(log))
        said = [
            (1.0 if x.true is None else factor * x.true) / (1.0 + factor * x.hidden) for x in closed
        ]
        return float(-np.sum(np.log(said)) + 0.5 * (log / HIDDEN_WIDTH) ** 2)

    return float(np.exp(minimize_scalar(cost).x)) * Calibration().hidden


if __name__ == "__main__":
    sys.exit(main())
