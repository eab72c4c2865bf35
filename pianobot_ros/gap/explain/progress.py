"""What a diagnosis under way tells: what it does, how far it is, and who leads."""

from __future__ import annotations

from collections import defaultdict

from pianobot_ros.gap.posterior.judge import weigh
from pianobot_ros.gap.search.study import Progress, Study

SHOWN = 4  # leading effects that are told


def say(progress: Progress | None, doing: str, share: float, study: Study | None = None) -> None:
    """Tell who asked what is ``doing``, the ``share`` of the work that is done (0 to 1), and the
    leading effects with the weight that they have on the table so far.
    """
    if progress is None:
        return
    mass: dict[str, float] = defaultdict(float)
    if study is not None:
        for entry, weight in zip(study.entries, weigh(study).tolist(), strict=True):
            for name in entry.effects or (entry.name,):
                mass[name] += weight
    leaders = sorted(mass.items(), key=lambda item: -item[1])[:SHOWN]
    progress(doing, share, tuple(leaders))
