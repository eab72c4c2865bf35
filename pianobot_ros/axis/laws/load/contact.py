"""Contact with surroundings: beyond a limit that other joints shift, the joint is pushed back.

Part of the twin where the logs show such a limit (see `axis/commissioning/contact_limit.py`).
"""

from __future__ import annotations

from pianobot_ros.axis.commissioning.contact_limit import Contact
from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales, found: Contact) -> Effect:
    """Stiffness (effort per rad), limit (rad) where the other joints are at 0, and its slopes."""
    k = s.stiffness
    (_, first), (_, second) = found.slopes
    unit = f"{s.effort_unit}/{s.unit}"
    return effect(
        "contact",
        "load",
        [
            Parameter("contact", 0.0, 0.0, 20 * k, unit, "load", sd=3 * k),
            Parameter(
                "contact_limit", found.limit, found.limit - 1, found.limit + 1, "rad", "load", 0.1
            ),
            Parameter("contact_slope", first, first - 2, first + 2, "1", "load", sd=0.2),
            Parameter("contact_slope_2", second, second - 2, second + 2, "1", "load", sd=0.2),
        ],
        [[4.0 * k, found.limit, first, second]],
        "contact with surroundings, at an angle that other joints shift",
    )
