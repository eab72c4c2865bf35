"""First values of what lies between motor and link, where both were recorded."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.commissioning.regression import design, effort_of, of_twist, robust
from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.axis.signals.filtering import derivative
from pianobot_ros.gap.problem.types import Array

__all__ = ["twisting"]

DAMPED = 0.05
"""Damping ratio of a spring at first."""
SHARES = (0.1, 0.9)
"""Of the inertia behind the spring, at first."""
BEHIND = (0.0, 0.3)
"""Shares of the dry friction behind the gap at first: a load that its inertia and weight alone lay
on a flank, and one that its own friction holds back until the other flank drives it. There is no
way from one to the other: whatever the share between, the link changes sides at the same times."""
FLANK = 0.02
"""s; period of a load on a flank at first."""


def twisting(
    logs: Sequence[Clean], there: Collection[str]
) -> Iterator[Mapping[str, Mapping[str, float]]]:
    """A spring and a gap that the twist between motor and link would come from, {effect:
    {parameter: value}}, of those that are `there`.

    A spring's twist goes with the link's acceleration, by the inertia over the stiffness: the
    period squared over 4 π². Of a gap the link lies on one flank or the other.
    """
    use = [(c, c.twist) for c in logs if c.twist is not None]
    if not use:
        return
    valid = [c.valid[:: c.step] for c, _ in use]
    twist = np.concatenate([y[:: c.step][k] for (c, y), k in zip(use, valid, strict=True)])
    rows = [_of_the_link(c, y)[k] for (c, y), k in zip(use, valid, strict=True)]
    beta = robust(np.concatenate(rows), twist, np.zeros(6))
    share, own = _behind([c for c, _ in use])
    if "elasticity" in there and beta[0] > 0.0:
        period = 2.0 * math.pi * math.sqrt(float(beta[0]))
        spring = {"elastic_period": period, "elastic_share": share, "elastic_damping": DAMPED}
        yield {"elasticity": {**own, **spring}}
    if "backlash" in there:
        low, high = np.quantile(twist, [0.1, 0.9])
        gap = {"backlash": float(high - low), "backlash_share": share, "backlash_flank": FLANK}
        for dragged in BEHIND:
            yield {"backlash": {**own, **gap, "backlash_friction": dragged}}


def _behind(logs: Sequence[Clean]) -> tuple[float, dict[str, float]]:
    """The share of the inertia that moves with the link, and the joint's own values with it, by
    regression of the effort on the accelerations of both sides; a half where there is none.
    """
    use = [c for c in logs if c.effort is not None]
    if not use:
        return 0.5, {}
    x, y, kept = effort_of(use)
    lost = np.concatenate([of_twist(c)[:: c.step][k] for c, k in zip(use, kept, strict=True)])
    beta = robust(np.hstack([x, -lost]), y, np.zeros(7))
    if min(float(beta[0]), float(beta[6])) <= 0.0:
        return 0.5, {}
    own = {"inertia": float(beta[0]), "viscous": max(float(beta[1]), 0.0)}
    return float(np.clip(beta[6] / beta[0], *SHARES)), own


def _of_the_link(c: Clean, twist: Array) -> Array:
    """What a spring's twist goes with (n, 6): what an effort does, of the link."""
    link = c.q - twist
    speed = derivative(link, c.dt)
    return design(replace(c, q=link, v=speed, a=derivative(speed, c.dt), model=None))
