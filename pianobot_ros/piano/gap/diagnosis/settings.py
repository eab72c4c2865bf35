"""How the engine is set for the piano cell."""

from __future__ import annotations

from functools import cache

from pianobot_ros.cell.numbers.learned import PIANO_CELL, load_learned
from pianobot_ros.gap import Calibration, Options

__all__ = ["options", "prior_options"]


def prior_options() -> Options:
    """The settings before anything is learned.

    The cell's twin is right to a few thousandths of a signal, so what an effect leaves open says
    more than elsewhere. Its force has ten thousand samples, and in a cell without any effect
    hypotheses still differ by a hundred nats.
    """
    return Options(calibration=Calibration(temperature=15.0, unknown_near=0.3))


@cache
def options() -> Options:
    """The settings, with what was learned where there is any. Raises :class:`ConfigError` for
    a file that does not hold them.
    """
    return prior_options().taught(load_learned(PIANO_CELL))
