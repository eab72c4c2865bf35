"""What a diagnosis and an investigation may cost where nothing else is asked for."""

from __future__ import annotations

__all__ = [
    "DIAGNOSIS_BUDGET",
    "INVESTIGATION_GOAL",
    "INVESTIGATION_GOALS",
    "INVESTIGATION_STRIKES",
    "USUAL_STRIKES",
]

DIAGNOSIS_BUDGET = 40_000
"""Simulated strikes: a thousand predictions of 40 strikes, about half a minute of a core. Work and
not time is counted, so that the answer does not depend on how busy the machine is."""
USUAL_STRIKES = 40
"""Strikes that the budget of a diagnosis is meant for."""
INVESTIGATION_GOAL = 0.95
"""Probability of one cause that has a name, from which an investigation plays no more."""
INVESTIGATION_GOALS = (0.5, 0.999)
"""Least and largest goal: below, another cause may be the likelier; no cause is ever certain, and
who waits for that plays until the budget is spent."""
INVESTIGATION_STRIKES = 60
"""Most strikes of an investigation: one and a half times the usual first set, which settles four
cells of five."""
