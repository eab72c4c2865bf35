"""Joint stiffness by Bayesian optimisation against reference keystrokes (III-B of
"Data-driven Simulation Framework").

The search is the paper's: a Gaussian process over log k, expected improvement, 30 iterations by
default. Around it stands what
the paper lacks: a profile that says how well k is known at all, because above about 1 N·m/deg a
keystroke hardly depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.recordings.keystroke import Keystroke, absolute_error
from pianobot_ros.piano.identify.bayes import Dimension, Optimizer
from pianobot_ros.piano.identify.takes.objective import Objective, comparable
from pianobot_ros.piano.identify.takes.take import Take

__all__ = [
    "PAPER_RANGE",
    "Misfit",
    "Profile",
    "StiffnessFit",
    "optimize_stiffness",
    "profile_stiffness",
]

Progress = Callable[[Mapping[str, Any], Sequence[float]], None]
"""State of the search so far; and iteration, total, stiffness tried, its objective, best stiffness,
best objective.
"""

PAPER_RANGE = (
    2.865,
    114.6,
)  # N m/rad: 0.05 to 2 N m/deg, the design space of the paper's Fig. 8(a)
TIME_SD = 2e-3  # s: reproducibility of MIDI times (devices: 0.5 to 2 ms over USB and JACK)
# relative: repeats of one key, and what a one-finger model leaves; rounding to MIDI is added
VELOCITY_SD = 0.03
CHI2_95 = 3.84
SAME_VACUUM = 5e3  # Pa
SILENT = 1e4  # chi-square of a key that should sound and does not


@dataclass(frozen=True)
class Profile:
    """Misfit over stiffness: ``stiffness`` (n,) N m/rad, ``misfit`` (n,) chi-square; 95 % interval
    ``low``..``high``.

    ``identifiable`` is False where the interval spans more than a factor of two, reaches the end of
    the range searched or falls apart into several (aliases: fast strikes make V_pre non-monotonic
    in k).
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
    """Result of :func:`optimize_stiffness`. ``err`` is Eq. 5 as a fraction; ``f_d`` (m/s, at the
    contact point) and ``f_a`` (s) are Eq. 4 as printed, means over keystrokes; ``t_hold_error`` and
    ``t_idle_error`` are shown apart because the paper admits its deviation there. ``keystrokes``
    lists reference and twin side by side.
    """

    stiffness: float
    objective: float
    err: float
    v_error: float
    t_hold_error: float
    t_idle_error: float
    f_d: float
    f_a: float
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
    takes: Sequence[Take],
    objective: Objective | None = None,
    *,
    iterations: int = 30,
    seed: int = 0,
    bounds: tuple[float, float] = PAPER_RANGE,
    resume: dict[str, Any] | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> StiffnessFit:
    """Find the joint stiffness with which the twin plays ``takes`` as their references sound.

    The same seed gives the same result; ``resume`` is the ``state`` of an earlier result and goes
    on from there; ``cancelled`` is asked between iterations. Raises :class:`PianobotError` if there
    is no reference to compare with.
    """
    objective = objective or Objective()
    if not any(take.reference for take in takes):
        raise PianobotError("no take has a reference keystroke: there is nothing to optimise for")
    search = _search(resume, bounds, seed)
    evaluate = partial(_evaluate, takes, objective)
    ended = not _searched(search, evaluate, iterations, progress, cancelled)
    best, lowest = (
        search.best()
        if search.history
        else ({"stiffness": float(np.sqrt(bounds[0] * bounds[1]))}, float("nan"))
    )
    stiffness = best["stiffness"]
    _, found = _evaluate(takes, objective, stiffness)
    profile = profile_stiffness(takes, bounds)
    warnings = _warnings(takes, stiffness, bounds, profile)
    errors = (*_errors(takes, found), *_absolute(takes, found))
    return StiffnessFit(
        stiffness,
        lowest,
        objective.err(takes, found),
        *errors,
        profile,
        [{**asked, "objective": value} for asked, value in search.history],
        [_side_by_side(t, k) for t, k in zip(takes, found, strict=True)],
        search.state(),
        ended,
        warnings,
    )


def _search(resume: dict[str, Any] | None, bounds: tuple[float, float], seed: int) -> Optimizer:
    """A search for the stiffness, anew or from where it was."""
    if not resume:
        return Optimizer([Dimension("stiffness", *bounds)], seed=seed)
    search = Optimizer.resume(resume)
    if [d.name for d in search.dimensions] != ["stiffness"]:
        raise PianobotError("the state to resume from is not that of a search for stiffness")
    return search


def _searched(
    search: Optimizer,
    evaluate: Callable[[float], tuple[float, Any]],
    iterations: int,
    progress: Progress | None,
    cancelled: Callable[[], bool] | None,
) -> bool:
    """Ask and tell until ``iterations`` are known; False if it was cancelled before."""
    while len(search.history) < iterations:
        if cancelled is not None and cancelled():
            return False
        asked = search.ask()
        stiffness = asked["stiffness"]
        value = evaluate(stiffness)[0]
        search.tell(asked, value)
        if progress:
            best, lowest = search.best()
            done = len(search.history)
            numbers = (done, iterations, stiffness, value, best["stiffness"], lowest)
            progress(search.state(), numbers)
    return True


class Misfit:
    """Chi-square of keystrokes against stiffness, remembered by take, so that groups of takes share
    their rollouts.

    Every keystroke counts with its parameters' own uncertainty. T_idle is T_hold again (Eq. 2) and
    does not count.
    """

    def __init__(self, takes: Sequence[Take]) -> None:
        self.takes = tuple(t for t in takes if t.reference is not None)
        self._known: dict[tuple[int, float], float] = {}
        names = [
            (t.strike.condition or i, t.strike.finger, t.strike.note)
            for i, t in enumerate(self.takes)
        ]
        # Repeats of a condition are rounded to the same MIDI velocity: that error does not average
        # out over them.
        self._repeats = [names.count(name) for name in names]

    def __call__(self, stiffness: float, members: Sequence[int] | None = None) -> float:
        """Chi-square of all takes, or of those at the positions ``members``."""
        return sum(
            self._one(i, stiffness)
            for i in (range(len(self.takes)) if members is None else members)
        )

    def _one(self, i: int, stiffness: float) -> float:
        key = (i, stiffness)
        if key not in self._known:
            self._known[key] = _chi_square(self.takes[i], stiffness, self._repeats[i])
        return self._known[key]


def profile_stiffness(
    takes: Sequence[Take],
    bounds: tuple[float, float] = PAPER_RANGE,
    *,
    points: int = 21,
    misfit: Misfit | None = None,
    members: Sequence[int] | None = None,
) -> Profile:
    """Chi-square misfit over stiffness and the 95 % interval around its minimum.

    A log grid finds the valleys, a bounded search the bottom of the deepest, and root finding where
    it is left. The threshold is widened by the misfit that the best stiffness leaves, so that a
    wrong model gives a wider interval. ``misfit`` and ``members`` let several groups of takes share
    their rollouts.
    """
    misfit = misfit or Misfit(takes)
    count = len(misfit.takes) if members is None else len(members)
    known: dict[float, float] = {}

    def chi(log_k: float) -> float:
        k = float(np.exp(log_k))
        return known.setdefault(k, misfit(k, members))

    grid = np.log(np.geomspace(*bounds, points))
    coarse = np.array([chi(u) for u in grid])
    at = int(np.argmin(coarse))
    left, right = grid[max(at - 1, 0)], grid[min(at + 1, points - 1)]
    minimize_scalar(chi, bounds=(left, right), method="bounded", options={"xatol": 3e-3})
    best = min(known, key=lambda k: known[k])
    threshold = known[best] + CHI2_95 * max(known[best] / max(3 * count - 1, 1), 1.0)
    u = float(np.log(best))
    low, closed_below = _leave(chi, u, grid[grid < u][::-1], threshold)
    high, closed_above = _leave(chi, u, grid[grid > u], threshold)
    tried = sorted(known)
    inside = np.array([known[k] < threshold for k in tried])
    pieces = int(np.sum(np.diff(np.concatenate([[0], inside.astype(int)])) > 0))
    identifiable = closed_below and closed_above and pieces == 1 and bool(high - low < np.log(2.0))
    outer_low, outer_high = np.log([k for k, i in zip(tried, inside, strict=True) if i])[[0, -1]]
    return Profile(
        tried,
        [known[k] for k in tried],
        best,
        float(np.exp(min(low, outer_low))),
        float(np.exp(max(high, outer_high))),
        pieces,
        identifiable,
    )


def _leave(
    chi: Callable[[float], float], start: float, outwards: Array, threshold: float
) -> tuple[float, bool]:
    """Where the misfit first passes the threshold on the way from ``start`` over the grid
    ``outwards``, and whether it does.
    """
    inner = start
    for outer in map(float, outwards):
        if chi(outer) > threshold:
            return float(brentq(lambda u: chi(u) - threshold, inner, outer, xtol=5e-3)), True
        inner = outer
    return inner, False


def _evaluate(
    takes: Sequence[Take], objective: Objective, stiffness: float
) -> tuple[float, list[Any]]:
    strokes = [take.stroke(stiffness) for take in takes]
    found = [take.keystroke(stroke) for take, stroke in zip(takes, strokes, strict=True)]
    return objective(takes, strokes, found), found


def _chi_square(take: Take, stiffness: float, repeats: int) -> float:
    reference = take.reference
    assert reference is not None
    found = take.keystroke(take.stroke(stiffness))
    if found is None:
        return SILENT
    step = 1 / take.midi.velocity_gain / np.sqrt(12)
    total = ((found.t_hold - reference.t_hold) / TIME_SD) ** 2 / 2
    for name in ("v_pre", "v_rel"):
        wanted = getattr(reference, name)
        if np.isfinite(wanted):  # a MIDI file need not say how fast a key is let go
            total += (getattr(found, name) - wanted) ** 2 / (
                (VELOCITY_SD * wanted) ** 2 + repeats * step**2
            )
    return float(total)


def _errors(takes: Sequence[Take], found: Sequence[Any]) -> tuple[float, float, float]:
    """Mean relative errors of the velocities, of T_hold and of T_idle."""
    rows = []
    for take, k in zip(takes, found, strict=True):
        if k is not None and take.reference is not None:
            s, r = comparable(k, take.reference)
            velocity = 0.5 * (abs(s.v_pre / r.v_pre - 1) + abs(s.v_rel / r.v_rel - 1))
            rows.append((velocity, abs(s.t_hold / r.t_hold - 1), abs(s.t_idle / r.t_idle - 1)))
    mean = np.mean(rows, axis=0) if rows else np.full(3, np.nan)
    return float(mean[0]), float(mean[1]), float(mean[2])


def _absolute(takes: Sequence[Take], found: Sequence[Any]) -> tuple[float, float]:
    """f_d (m/s) and f_a (s) of Eq. 4, means over what sounded in both."""
    rows = []
    for take, k in zip(takes, found, strict=True):
        if k is not None and take.reference is not None:
            sim, reference = comparable(k, take.reference)
            if np.isfinite(take.radius):
                sim, reference = take.at_contact(sim), take.at_contact(reference)
            rows.append(absolute_error(sim, reference))
    mean = np.mean(rows, axis=0) if rows else np.full(2, np.nan)
    return float(mean[0]), float(mean[1])


def _side_by_side(take: Take, found: Any) -> dict[str, Any]:
    names = ("v_pre", "v_rel", "t_hold", "t_idle")

    def pick(k: Keystroke | None) -> dict[str, float] | None:
        if k is None:
            return None
        here = take.at_contact(k) if np.isfinite(take.radius) else k
        return {n: float(getattr(here, n)) for n in names}

    return {
        "note": take.strike.note,
        "finger": take.strike.finger,
        "radius": take.radius,
        "reference": pick(take.reference),
        "twin": pick(found),
    }


def _warnings(
    takes: Sequence[Take], stiffness: float, bounds: tuple[float, float], profile: Profile
) -> tuple[str, ...]:
    warnings = []
    vacuum = [t.strike.pressure for t in takes]
    if np.ptp(vacuum) > SAME_VACUUM:
        warnings.append(
            f"these strikes have vacuum from {max(vacuum) / 1e3:.0f} to {min(vacuum) / 1e3:.0f}"
            " kPa, and one stiffness cannot suit all: use `identify vacuum`, or choose one level"
            " (--pressure)"
        )
    if stiffness < 1.03 * bounds[0] or stiffness > bounds[1] / 1.03:
        warnings.append(f"stiffness {stiffness:.3g} N*m/rad is on the bound of the range searched")
    if not profile.identifiable:
        pieces = f", in {profile.pieces} separate pieces" if profile.pieces > 1 else ""
        warnings.append(
            f"stiffness cannot be identified from these strikes: anything from {profile.low:.3g} to"
            f" {profile.high:.3g} N*m/rad fits{pieces}; use softer fingers, or strikes with a"
            " shallow depth"
        )
    return tuple(warnings)
