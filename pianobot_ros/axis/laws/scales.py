"""The sizes of a log, from which the axis's effects take their bounds, priors and starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

PHASE = 100.0
"""rad; bound of phases at angle 0. A fit that corrects the spatial frequency turns them on, by that
correction times the angle at which the joint is: a turn or more, and none is an end.
"""


@dataclass(frozen=True)
class Scales:
    """Typical sizes in a log, so that priors and starts suit a finger servo as well as an
    industrial joint.
    """

    effort: float
    """RMS effort, in the log's effort unit (or rad/s² where no effort was measured)."""
    speed: float
    """RMS speed, rad/s."""
    travel: float
    """Position range, rad."""
    error: float
    """RMS of command minus position, rad."""
    dt: float
    """Sample interval, s."""
    duration: float
    """Length of the whole session, s."""
    effort_unit: str
    waves: Sequence[float]
    """Spatial frequencies (per rad) at which the effort's residual has the most power."""
    top_speed: float = 1.0
    """Highest speed but for a thousandth of the samples, rad/s."""
    inertia: float = 1.0
    """Believed inertia, effort per rad/s²."""
    unit: str = "rad"
    """rad, or m for a linear axis; the laws' rad are then m."""
    stiffness: float = 1.0
    """Of the position loop, effort per rad."""
    rest: float = 0.0
    """Speed that cannot be told from rest, rad/s."""
    middle: float = 0.0
    """Middle of the travel, rad."""
    carried: Mapping[str, float] = field(default_factory=dict)
    """First values of a load that seems to be carried for a part of the log."""
    stop: Mapping[str, float] = field(default_factory=dict)
    """First values of a stop that the joint seems to press on, and the side that it is on."""
    finest: float = 2000.0
    """Highest spatial frequency (per rad) that the log shows to repeat."""
