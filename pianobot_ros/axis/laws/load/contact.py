"""Contact with surroundings: beyond a limit that other joints shift, the joint is pushed back.

Part of the twin where the logs show such a limit (`axis/commissioning/around/contact_limit.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.gap.problem.types import Array


@dataclass(frozen=True)
class Contact:
    """The joint cannot go beyond `limit + Σ slope · other joint's angle` (rad) towards `side`."""

    side: float
    limit: float
    slopes: tuple[tuple[str, float], ...]

    def said(self) -> str:
        """The note on it."""
        turned = "".join(f" {k:+.2f}·{n}" for n, k in self.slopes)
        way = "up" if self.side > 0 else "down"
        return (
            f"the joint is held back, as if it touched something: it goes {way} to"
            f" {self.limit:.2f}{turned} rad; that contact is part of the twin"
        )

    def at(self, others: Sequence[Array]) -> Array:
        """The limit (n,) for the other joints' angles, (n,) each in the order of `slopes`."""
        out = np.full(others[0].size, self.limit)
        for (_, slope), angle in zip(self.slopes, others, strict=True):
            out = out + slope * angle
        return np.asarray(out)


def effect(s: Scales, found: Contact) -> Effect:
    """Stiffness (effort per rad), limit (rad) where the other joints are at 0, and its slopes."""
    k = s.stiffness
    (_, first), (_, second) = found.slopes
    unit = f"{s.effort_unit}/{s.unit}"
    return Effect(
        "contact",
        "load",
        [
            Parameter("contact", 0.0, 0.0, 20 * k, unit, sd=3 * k),
            Parameter(
                "contact_limit", found.limit, found.limit - 1, found.limit + 1, "rad", sd=0.1
            ),
            Parameter("contact_slope", first, first - 2, first + 2, "1", sd=0.2),
            Parameter("contact_slope_2", second, second - 2, second + 2, "1", sd=0.2),
        ],
        [
            {
                "contact": 4.0 * k,
                "contact_limit": found.limit,
                "contact_slope": first,
                "contact_slope_2": second,
            }
        ],
        description="contact with surroundings, at an angle that other joints shift",
    )
