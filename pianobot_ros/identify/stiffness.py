"""Joint stiffness by Bayesian optimisation against reference keystrokes (III-B of soft-hand-piano-simulator.txt).

The search is the paper's: a Gaussian process over log k, expected improvement, 30 iterations by default. Around it stands what
the paper lacks: a profile that says how well k is known at all, because above about 1 N·m/deg a keystroke hardly depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.identify.bayes import Dimension, Optimizer
from pianobot_ros.identify.objective import Objective
from pianobot_ros.identify.takes import Take

__all__ = ["PAPER_RANGE", "Profile", "StiffnessFit", "optimize_stiffness", "profile_stiffness"]

Array = NDArray[np.float64]
Progress = Callable[[int, int, float, float, float, float], None]
"""iteration, total, stiffness tried, its objective, best stiffness, best objective"""

PAPER_RANGE = (2.865, 114.6)  # N m/rad: 0.05 to 2 N m/deg, the design space of the paper's Fig. 8(a)
TIME_SD = 2e-3  # s: reproducibility of MIDI times (devices: 0.5 to 2 ms over USB and JACK)
VELOCITY_SD = 0.02  # relative: repeats of one key; the rounding to a MIDI velocity is added
CHI2_95 = 3.84


@dataclass(frozen=True)
class Profile:
    """Misfit over stiffness: ``stiffness`` (n,) N m/rad, ``misfit`` (n,) chi-square; 95 % interval ``low``..``high``.

    ``identifiable`` is False where the interval spans more than a factor of two, reaches the end of the range searched or
    falls apart into several (aliases: fast strikes make V_pre non-monotonic in k).
    """

    stiffness: list[float]
    misfit: list[float]
    best: float
    low: float
    high: float
    pieces: int
    identifiable: bool


@dataclass(frozen=True)
class StiffnessFit:
    """Result of :func:`optimize_stiffness`. ``err`` is Eq. 5 as a fraction; ``t_hold_error`` and ``t_idle_error`` are shown
    apart because the paper admits its deviation there. ``keystrokes`` lists reference and twin side by side.
    """

    stiffness: float
    objective: float
    err: float
    v_error: float
    t_hold_error: float
    t_idle_error: float
    profile: Profile
    history: list[dict[str, float]]
    keystrokes: list[dict[str, Any]]
    state: dict[str, Any]
    cancelled: bool
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return asdict(self)


def optimize_stiffness(
    takes: Sequence[Take], objective: Objective | None = None, *, iterations: int = 30, seed: int = 0,
    bounds: tuple[float, float] = PAPER_RANGE, resume: dict[str, Any] | None = None, progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> StiffnessFit:  # fmt: skip
    """Find the joint stiffness with which the twin plays ``takes`` as their references sound.

    The same seed gives the same result; ``resume`` is the ``state`` of an earlier result and goes on from there; ``cancelled``
    is asked between iterations. Raises :class:`PianobotError` if there is no reference to compare with.
    """
    objective = objective or Objective()
    if not any(take.reference for take in takes):
        raise PianobotError("no take has a reference keystroke: there is nothing to optimise for")
    search = Optimizer.resume(resume) if resume else Optimizer([Dimension("stiffness", *bounds)], seed=seed)
    stop = cancelled or (lambda: False)
    ended = False
    while len(search.history) < iterations:
        if stop():
            ended = True
            break
        asked = search.ask()
        value = _evaluate(takes, objective, asked["stiffness"])[0]
        search.tell(asked, value)
        if progress:
            best, lowest = search.best()
            progress(len(search.history), iterations, asked["stiffness"], value, best["stiffness"], lowest)
    best, lowest = (
        search.best() if search.history else ({"stiffness": float(np.sqrt(bounds[0] * bounds[1]))}, float("nan"))
    )
    stiffness = best["stiffness"]
    _, found = _evaluate(takes, objective, stiffness)
    profile = profile_stiffness(takes, bounds, around=stiffness)
    warnings = _warnings(stiffness, bounds, profile)
    errors = _errors(takes, found)
    return StiffnessFit(
        stiffness, lowest, objective.err(takes, found), *errors, profile,
        [{**asked, "objective": value} for asked, value in search.history],
        [_side_by_side(t, k) for t, k in zip(takes, found, strict=True)], search.state(), ended, warnings,
    )  # fmt: skip


def profile_stiffness(takes: Sequence[Take], bounds: tuple[float, float] = PAPER_RANGE, points: int = 41,
                      around: float | None = None) -> Profile:  # fmt: skip
    """Chi-square misfit over a log grid of stiffness and the 95 % interval around its minimum.

    Every keystroke counts with its four parameters' own uncertainty (T_idle is T_hold again and does not count). The
    threshold is widened by the misfit that the best stiffness leaves, so that a wrong model gives a wider interval.
    """
    grid = np.geomspace(*bounds, points)
    if around is not None:
        fine = around * np.geomspace(0.85, 1 / 0.85, 13)
        grid = np.unique(np.concatenate([grid, fine[(fine >= bounds[0]) & (fine <= bounds[1])]]))
    misfit = np.array([_chi_square(takes, k) for k in grid])
    at = int(np.argmin(misfit))
    freedom = max(3 * sum(t.reference is not None for t in takes) - 1, 1)
    inside = misfit - misfit[at] < CHI2_95 * max(misfit[at] / freedom, 1.0)
    pieces = int(np.sum(np.diff(np.concatenate([[0], inside.astype(int)])) > 0))
    members = np.flatnonzero(inside)
    low, high = float(grid[max(members[0] - 1, 0)]), float(grid[min(members[-1] + 1, grid.size - 1)])
    identifiable = pieces == 1 and high / low < 2.0 and bool(members[0] > 0 and members[-1] < grid.size - 1)
    return Profile(grid.tolist(), misfit.tolist(), float(grid[at]), low, high, pieces, identifiable)


def _evaluate(takes: Sequence[Take], objective: Objective, stiffness: float) -> tuple[float, list[Any]]:
    strokes = [take.stroke(stiffness) for take in takes]
    found = [take.keystroke(stroke) for take, stroke in zip(takes, strokes, strict=True)]
    return objective(takes, strokes, found), found


def _chi_square(takes: Sequence[Take], stiffness: float) -> float:
    total = 0.0
    for take in takes:
        if take.reference is None:
            continue
        found = take.keystroke(take.stroke(stiffness))
        if found is None:
            total += 1e4
            continue
        step = 1 / take.midi.velocity_gain / np.sqrt(12)
        for name in ("v_pre", "v_rel"):
            wanted = getattr(take.reference, name)
            total += (getattr(found, name) - wanted) ** 2 / ((VELOCITY_SD * wanted) ** 2 + step**2)
        total += (found.t_hold - take.reference.t_hold) ** 2 / (2 * TIME_SD**2)
    return total


def _errors(takes: Sequence[Take], found: Sequence[Any]) -> tuple[float, float, float]:
    """Mean relative errors of the velocities, of T_hold and of T_idle."""
    rows = []
    for take, k in zip(takes, found, strict=True):
        if k is not None and (r := take.reference) is not None:
            velocity = 0.5 * (abs(k.v_pre / r.v_pre - 1) + abs(k.v_rel / r.v_rel - 1))
            rows.append((velocity, abs(k.t_hold / r.t_hold - 1), abs(k.t_idle / r.t_idle - 1)))
    mean = np.mean(rows, axis=0) if rows else np.full(3, np.nan)
    return float(mean[0]), float(mean[1]), float(mean[2])


def _side_by_side(take: Take, found: Any) -> dict[str, Any]:
    names = ("v_pre", "v_rel", "t_hold", "t_idle")
    pick = lambda k: {n: float(getattr(k, n)) for n in names} if k is not None else None  # noqa: E731
    return {
        "note": take.strike.note,
        "finger": take.strike.finger,
        "reference": pick(take.reference),
        "twin": pick(found),
    }


def _warnings(stiffness: float, bounds: tuple[float, float], profile: Profile) -> tuple[str, ...]:
    warnings = []
    if stiffness < 1.03 * bounds[0] or stiffness > bounds[1] / 1.03:
        warnings.append(f"stiffness {stiffness:.3g} N*m/rad is on the bound of the range searched")
    if not profile.identifiable:
        pieces = f", in {profile.pieces} separate pieces" if profile.pieces > 1 else ""
        warnings.append(
            f"stiffness cannot be identified from these strikes: anything from {profile.low:.3g} to {profile.high:.3g} N*m/rad "
            f"fits{pieces}; use softer fingers, or strikes with a shallow depth"
        )
    return tuple(warnings)
