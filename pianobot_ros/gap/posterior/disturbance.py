"""Whether a disturbance on its own clock is behind a gap that an effect seems to explain.

A loop that answers a steady disturbance looks, at that one frequency, like a loop with another
delay or inertia. What gives it
away is the line itself: it still stands in another observable, where the twin has no reason to move
at that frequency.
"""

from __future__ import annotations

from pianobot_ros.gap.fitting.evidence import Evidence
from pianobot_ros.gap.floor.session.lines import Rows, line_share, own_clock
from pianobot_ros.gap.problem.constants import MOST
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.study import Entry, Study, gaps


def disturbance(study: Study, best: Entry) -> float | None:
    """Frequency (Hz) of a line that a hypothesis leaves in one observable and claims to explain in
    another; None without one.
    """
    refit, problem = study.entry("parameters"), study.problem
    if best.fit is None or refit.fit is None or not (best.effects and problem.on_session_clock):
        return None
    before, after = gaps(study, refit), gaps(study, best)
    series = [o for o in problem.present if problem.observables[o].kind == "series"]
    for o in series:
        residual, prediction = _by_block(study, o, best.fit.prediction)
        hertz = own_clock(residual, prediction)
        if hertz is not None:
            claimed = max(series, key=lambda o: float(before[o] ** 2 - after[o] ** 2))
            unexplained, _ = _by_block(study, claimed, refit.fit.prediction)
            if line_share(unexplained, hertz) > MOST:
                return hertz
    return None


def _by_block(evidence: Evidence, o: int, flat: Array) -> tuple[Rows, Rows]:
    """Residuals and predictions of an observable with their times, by block."""
    problem = evidence.problem
    cells = [(c, problem.mask[c.start : c.stop]) for c in problem.cells if c.observable == o]
    cells = [(c, keep) for c, keep in cells if keep.any()]
    return (
        [(c.t[keep], (problem.y - flat)[c.start : c.stop][keep]) for c, keep in cells],
        [(c.t[keep], flat[c.start : c.stop][keep]) for c, keep in cells],
    )
