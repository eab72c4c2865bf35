"""Effects that the data cannot tell apart: their scores tie."""

from __future__ import annotations

from pianobot_ros.gap.fitting.score import difference
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


def groups(problem: Problem, scores: dict[str, Array]) -> tuple[tuple[str, ...], ...]:
    """Groups of names that predict the held-out data equally well: within one standard error, or a
    nat. `scores` (u,) are in nats that count (tempered).
    """
    names = sorted(scores, key=lambda n: -float(scores[n].sum()))
    out: list[tuple[str, ...]] = []
    taken: set[str] = set()
    for i, name in enumerate(names):
        if name in taken:
            continue
        group = [name]
        for other in names[i + 1 :]:
            gain, se = difference(problem, scores[name], scores[other])
            if gain < max(se, 1.0):
                group.append(other)
        if len(group) > 1:
            out.append(tuple(group))
            taken |= set(group)
    return tuple(out)
