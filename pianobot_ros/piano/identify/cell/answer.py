"""What a joint fit says: values with intervals, which combination is known where one is not, and
which recording would decide it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.recordings.keystroke import Keystroke, keystroke_error
from pianobot_ros.piano.identify.cell.cell_fit import CellProblem
from pianobot_ros.piano.identify.cell.joint import Joint, fit_joint
from pianobot_ros.piano.identify.estimated import Estimated
from pianobot_ros.piano.identify.priors import CHANNELS, priors
from pianobot_ros.piano.identify.takes.objective import comparable
from pianobot_ros.piano.identify.takes.take import Take
from pianobot_ros.piano.twin.reduced.strike_geometry import stiffness_of

__all__ = ["CellAnswer", "Known", "answer", "err_of", "identify_cell", "interval_of"]


FACTOR = 2.0  # a value whose 90 % interval spans more is not identified
OWN = 0.7  # share of the prior's standard deviation from which an interval is mostly the prior's
BETTER = 0.6  # a combination is named where it is known so much better than the value alone
COARSE = (
    0.25,
    0.45,
    0.8,
    1.3,
    2.2,
    4.0,
)  # factors on the stiffness from which the search may start
ALIAS = 2.0  # of the negative log posterior: another optimum within it cannot be ruled out
FEW = 6  # strikes up to which a second optimum is looked for in any case
SIGNALS = (("key angle", (0,)), ("force", (1,)), ("key angle and force", (0, 1)))


@dataclass(frozen=True)
class Known(Estimated):
    """One value with its 90 % interval; ``combination`` says in words what is known where it is
    not ``identifiable``.
    """

    identifiable: bool
    combination: str = ""


@dataclass(frozen=True)
class CellAnswer:
    """Result of :func:`identify_cell`: ``levels`` stiffness (N m/rad) at each vacuum level,
    ``pressures`` (Pa) of them, ``known`` all parameters; ``decides`` which recording would close
    what is open ("" if nothing is); ``err`` Eq. 5 before (nominal twin) and after, fractions.
    """

    pressures: tuple[float, ...]
    levels: tuple[Known, ...]
    known: tuple[Known, ...]
    decides: str
    err_before: float
    err_after: float
    noise: dict[str, float]
    problem: CellProblem
    joint: Joint

    def as_dict(self) -> dict[str, Any]:
        """The answer as plain data for JSON."""
        return {
            "pressures": list(self.pressures),
            "levels": [asdict(k) for k in self.levels],
            "known": [asdict(k) for k in self.known],
            "decides": self.decides,
            "err_before": self.err_before,
            "err_after": self.err_after,
            "noise": self.noise,
        }


def identify_cell(takes: Sequence[Take], fixed: Sequence[str] = ()) -> CellAnswer:
    """Estimate everything that is not known from all signals of ``takes``; ``fixed`` names what is
    known after all.
    """
    problem = CellProblem(takes, fixed)
    fits = _fits(problem)
    return answer(problem, fits)


def _fits(problem: CellProblem) -> list[Joint]:
    """The best fit first, then others that cannot be ruled out."""
    few = len(problem.takes) <= FEW or not any(t.angle.size for t in problem.takes)
    costs = [_coarse(problem, factor) for factor in COARSE]
    order = sorted(range(len(COARSE)), key=lambda i: costs[i])
    starts = [COARSE[order[0]]]
    if few:  # the ends of the range, where another optimum may hide
        starts += [f for f in (COARSE[0], COARSE[-1]) if f != starts[0]]
    fits = sorted((fit_joint(problem, problem.start(f)) for f in starts), key=lambda j: j.cost)
    return [fits[0], *(j for j in fits[1:] if j.cost < fits[0].cost + ALIAS)]


def _coarse(problem: CellProblem, factor: float) -> float:
    """Misfit of the nominal cell with all stiffnesses times ``factor``, signals scaled each by its
    own size.
    """
    data = problem.data
    examples = [problem.layouts[i] for i in problem.examples]
    predicted = problem.predict(problem.start(factor))
    rows = np.concatenate([np.arange(s.first, s.first + s.size) for s in examples])
    residual = (data.value - predicted)[rows]
    channel = data.channel[rows]
    total = 0.0
    for c in range(len(data.floor)):
        own = residual[(channel == c) & np.isfinite(data.value[rows])]
        if own.size:
            spread = max(float(np.std(data.value[rows][channel == c])), 10 * data.floor[c])
            lost = np.where(np.isfinite(own), own / spread, 1.0)
            total += float(np.mean(np.minimum(lost**2, 1.0)))
    return total


def answer(problem: CellProblem, fits: Sequence[Joint]) -> CellAnswer:
    """Put fits into words; the first is the best, the others are aliases of it."""
    best = fits[0]
    known = tuple(_known(problem, fits, i) for i in range(len(problem.names)))
    pressures = tuple(problem.levels.pressures)
    levels = tuple(
        _scaled(k, float(stiffness_of(p)))
        for k, p in zip(known[: len(pressures)], pressures, strict=True)
    )
    floor = problem.data.floor
    return CellAnswer(
        pressures,
        levels,
        known,
        "" if all(k.identifiable for k in levels) else _decides(problem, best),
        err_of(problem, np.zeros(len(problem.names))),
        err_of(problem, best.x, best.effects),
        {c: float(n / f) for c, n, f in zip(CHANNELS, best.noise, floor, strict=True)},
        problem,
        best,
    )


def interval_of(problem: CellProblem, joint: Joint, i: int) -> tuple[float, float, float]:
    """Value and 90 % interval of parameter i."""
    prior, direction = problem.parameters[i], np.eye(len(problem.names))[i]
    half = joint.half(direction)
    u = float(joint.x[i])
    return prior.value(u), prior.value(u - half), prior.value(u + half)


def _known(problem: CellProblem, fits: Sequence[Joint], i: int) -> Known:
    joint, prior = fits[0], problem.parameters[i]
    value, low, high = interval_of(problem, joint, i)
    for other in fits[1:]:
        _, further_low, further_high = interval_of(problem, other, i)
        low, high = min(low, further_low), max(high, further_high)
    sure = high / low < FACTOR if prior.log else True
    if not prior.name.startswith("joint_stiffness"):
        sure = sure and (high - low) < 2 * 1.645 * OWN * _spread(prior.value, value)
    words = "" if sure else _combination(problem, joint, i)
    return Known(prior.name, value, low, high, prior.unit, bool(sure), words)


def _spread(value_at: Any, value: float) -> float:
    """What one standard deviation of the prior is worth at its mean."""
    del value
    return float(value_at(0.5) - value_at(-0.5))


def _combination(problem: CellProblem, joint: Joint, i: int) -> str:
    """In words, which product of powers with one other parameter is known better than the value."""
    covariance, prior = joint.covariance, problem.parameters[i]
    sd = np.sqrt(np.diag(covariance))
    share = covariance[i] / (sd[i] * sd)
    share[i] = 0.0
    other = int(np.argmax(np.abs(share)))
    left = float(np.sqrt(max(1.0 - share[other] ** 2, 0.0)))
    if left > BETTER:
        return ""
    second = problem.parameters[other]
    slope = covariance[i, other] / covariance[other, other] * prior.sd / second.sd
    half = 100 * (np.exp(prior.sd * joint.width * sd[i] * left) - 1)
    if second.log:
        what = f"{prior.name} / ({second.name})^{slope:.2g}"
    else:
        what = f"ln {prior.name} - {slope:.3g} * {second.name}"
    return f"known to {half:.0f} % is {what}"


def _scaled(known: Known, factor: float) -> Known:
    return Known(
        known.name,
        factor * known.value,
        factor * known.low,
        factor * known.high,
        "N*m/rad",
        known.identifiable,
        known.combination,
    )


def _decides(problem: CellProblem, joint: Joint) -> str:
    """Which recording would close what is open, by what the model says that its signals hold; or,
    where only what the fit leaves keeps it open, that an effect is missing.
    """
    levels = range(len(problem.levels.pressures))
    along = np.eye(len(problem.names))
    widest = max(joint.half(along[i]) for i in levels) / joint.birge
    if joint.birge > 1.0 and 2 * widest * problem.parameters[0].sd < np.log(FACTOR):
        return (
            "what `pianobot diagnose` finds in these strikes: of the key angle the fit leaves"
            f" {joint.birge:.1f} times as much as where the model lacks nothing"
        )
    notes = sorted({t.strike.note for t in problem.takes if not (t.angle.size and t.force.size)})
    keys = "note " + " and ".join(map(str, notes)) if notes else ""
    if notes:
        for words, channels in SIGNALS:
            if _closed(problem, joint, channels):
                return f"these strikes again with the {words} of {keys}"
    fewer = min(len(problem.takes), 10)
    softer = "with softer fingers (0 to -30 kPa), and " if min(problem.levels.at) < -30e3 else ""
    place = f"with key angle and force of {keys}, " if notes else ""
    return (
        f"{place}{2 * fewer} or more strikes {softer}of different speeds (0.05 to 0.3 m/s), depths"
        " (8 to 20 mm) and holds"
    )


def _closed(problem: CellProblem, joint: Joint, channels: tuple[int, ...]) -> bool:
    """Whether every stiffness would be identified with ``channels`` of every key recorded too."""
    whole = CellProblem(problem.takes, _not_free(problem), whole=True)
    x = np.zeros(len(whole.names))
    for name, u in zip(problem.names, joint.x, strict=True):
        x[whole.names.index(name)] = u
    data = whole.data
    rows = np.isin(data.channel, channels) & ~np.isfinite(data.value)
    jacobian = np.hstack([whole.slopes(x), whole.signatures(x)])[rows]
    weight = data.weight[rows] / (2.0 * data.floor[data.channel[rows]]) ** 2
    added = (np.nan_to_num(jacobian) * weight[:, None]).T @ np.nan_to_num(jacobian)
    information = np.eye(len(added))
    p, q = len(problem.names), len(whole.names)
    at = [whole.names.index(n) for n in problem.names]
    at += [q + k for k in range(len(problem.missing))]
    information[np.ix_(at, at)] = joint.information
    sd = np.sqrt(np.diag(np.linalg.inv(information + added)))
    levels = len(problem.levels.pressures)
    half = joint.width * np.hypot(sd[:levels], problem.tolerance[:levels])
    return bool(np.all(2 * half * problem.parameters[0].sd < np.log(FACTOR))) and p > 0


def _not_free(problem: CellProblem) -> list[str]:
    fitted = {n.split(" ")[0] for n in problem.names}
    return [
        p.name
        for p in priors()
        if not p.missing and p.name not in fitted and p.name not in ("fsr_gain", "stamp_fsr")
    ]


def err_of(problem: CellProblem, x: Array, effects: Array | None = None) -> float:
    """Err of Eq. 5 (fraction), mean over the notes; velocities on the instrument's own scale.

    With ``effects`` (q,) of a fit what it found missing belongs to the prediction: a few notes do
    not tell a wrong gain from a bent curve, but what both say of the next note.
    """
    predicted = problem.predict(x)
    if effects is not None:
        predicted = predicted + problem.signatures(x) @ effects
    errors = []
    for take, layout in zip(problem.takes, problem.layouts, strict=True):
        reference = take.reference
        row = predicted[layout.first + layout.size - 4 : layout.first + layout.size]
        if reference is None or not np.all(np.isfinite(row)):
            continue
        gain = take.midi.velocity_gain
        found = Keystroke(take.strike.note, 0.0, row[2] / gain, row[3] / gain, row[1])
        errors.append(
            keystroke_error(*comparable(found.with_note_length(take.note_length), reference))
        )
    return float(np.mean(errors)) if errors else float("nan")
