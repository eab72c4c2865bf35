"""Whether a disturbance on its own clock is behind a gap that an effect seems to explain.

A loop that answers a steady disturbance looks, at that one frequency, like a loop with another
delay or inertia. What gives it
away is the line itself: it still stands in another observable, where the twin has no reason to move
at that frequency.
"""

from __future__ import annotations

from pianobot_ros.gap.floor.session.lines import line_share, own_clock, rows_of
from pianobot_ros.gap.problem.constants import MOST
from pianobot_ros.gap.search.study import Entry, Study, gaps


def disturbance(study: Study, best: Entry) -> float | None:
    """Frequency (Hz) of a line that a hypothesis leaves in one observable and claims to explain in
    another; None without one.
    """
    refit, problem = study.entry("parameters"), study.problem
    if not (best.effects and problem.on_session_clock):
        return None
    before, after = gaps(study, refit), gaps(study, best)
    series = [o for o in problem.present if problem.observables[o].kind == "series"]
    for o in series:
        predicted = best.fit.prediction
        residual, moved = (rows_of(problem, o, x) for x in (problem.y - predicted, predicted))
        hertz = own_clock(residual, moved)
        if hertz is not None:
            claimed = max(series, key=lambda o: float(before[o] ** 2 - after[o] ** 2))
            unexplained = rows_of(problem, claimed, problem.y - refit.fit.prediction)
            if line_share(unexplained, hertz) > MOST:
                return hertz
    return None
