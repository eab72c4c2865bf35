"""One joint's log: columns on one time base, in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.gap.problem.types import Array

ROLES = ("time", "command", "position", "motor", "velocity", "effort")


@dataclass(frozen=True)
class Log:
    """Columns of one log, each (n,): t in s from 0, positions in `unit`, effort in `effort_unit`;
    None where not recorded, NaN where missing.
    """

    name: str
    t: Array
    command: Array | None
    position: Array
    velocity: Array | None
    effort: Array | None
    effort_unit: str = ""
    notes: tuple[str, ...] = field(default=())
    joint: str = ""
    unit: str = "rad"
    """rad, or m for a linear axis."""
    start: float = 0.0
    """Time of the first sample in the session, s."""
    signed: bool = False
    """Whether the user named the effort column, so that it is not doubted to have a sign."""
    others: Mapping[str, Array] = field(default_factory=dict)
    """Positions (n,) of the robot's other joints at the same times."""
    joints: tuple[str, ...] = ()
    """All joints of the robot in its order, this one among them."""
    model: Array | None = None
    """What a model of the robot says (n, 3): sine and cosine of gravity, inertia relative to its
    mean (see `robot_model.py`)."""
    coupling: Array | None = None
    """What the other joints' motion draws of the effort by that model (n,): inertia shared with
    them, Coriolis and centrifugal."""
    inertia: float = 0.0
    """Mean inertia by that model, in its unit; 0 without one."""
    link: Array | None = None
    """Position (n,) behind gear and spring, where that was recorded beside the motor's, which is
    then `position`; in `unit`."""

    @property
    def interval(self) -> float:
        """Time between two samples, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def joint_position(self) -> Array:
        """Where the link is (n,), which is what other joints feel."""
        return self.position if self.link is None else self.link
