"""How the engine is set for the piano cell."""

from __future__ import annotations

import math
from functools import cache

from pianobot_ros.cell.numbers.learned import PIANO_CELL, load_learned
from pianobot_ros.gap import Calibration, Options

__all__ = ["options", "prior_options"]


def prior_options() -> Options:
    """The settings before anything is learned.

    The cell's twin is right to a few thousandths of a signal, so what an effect leaves open says
    more than elsewhere: on development cells of laws 0 to 2 (seed 621) the right one leaves up to
    0.13 of a gap, another one 0.12 and more (docs/diagnosis-method.md, *How unknown was set*).
    Refitted parameters hide more weak effects than elsewhere (the same, *Calibration*), and what
    they fit better below the floor counts in full: of 34 development cells with wrong parameters
    alone none was called an effect by it, of ten with a weak effect three were named. Its force has
    ten thousand samples, and in a cell without any effect hypotheses still differ by dozens of
    nats.
    """
    calibration = Calibration(
        temperature=15.0, unknown_near=0.3, imprecision=0.2, hidden=8.0, below_floor=math.inf
    )
    return Options(calibration=calibration)


@cache
def options() -> Options:
    """The settings, with what was learned where there is any. Raises :class:`ConfigError` for
    a file that does not hold them.
    """
    return prior_options().taught(load_learned(PIANO_CELL))
