"""Contact with surroundings: beyond a limit that other joints shift, the joint is pushed back.

Part of the twin where the logs show such a limit (see `axis/commissioning/contact_limit.py`).
"""

from __future__ import annotations

from pianobot_ros.axis.commissioning.contact_limit import Contact
from pianobot_ros.axis.laws.base import Scales
from pianobot_ros.gap import Effect, Parameter


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
