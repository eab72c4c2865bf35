"""Which strikes are so much alike that one rollout, slightly corrected, serves them all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap import Block
from pianobot_ros.piano.gap.evidence.strike_data import StrikeData

__all__ = ["SharedRollout", "shared_rollouts"]

SHIFTS = range(-12, 13)  # grid points by which repeats are moved against each other at most
APART = 4e-4  # m of wrist height: more than this apart, two strikes are not alike
STIFFER = 0.02  # likewise, relative joint stiffness
RESTING_APART = 1e-4  # rad between the angles at which the key rests
ANGLE_APART = 2e-3  # likewise, rad of measured key angle


@dataclass(frozen=True)
class SharedRollout:
    """``example`` is the strike that is rolled out; grid point i of this strike is its grid point i
    + ``shift``.
    """

    example: str
    shift: int


def shared_rollouts(
    data: Mapping[str, StrikeData], blocks: Sequence[Block]
) -> dict[str, SharedRollout]:
    """For every strike that has an example among the repeats of its condition: which one, and
    shifted by how much.
    """
    examples: dict[str, list[StrikeData]] = {}
    out: dict[str, SharedRollout] = {}
    for block in blocks:
        strike = data[block.name]
        if strike.given is None:
            continue
        known = examples.setdefault(block.condition, [])
        found = next((like for e in known if (like := _shared(strike, e)) is not None), None)
        if found is None:
            known.append(strike)
        else:
            out[block.name] = found
    return out


def _shared(a: StrikeData, b: StrikeData) -> SharedRollout | None:
    assert a.given is not None and b.given is not None
    if (
        a.model is not b.model
        or (a.angle is None) != (b.angle is None)
        or abs(a.resting - b.resting) > RESTING_APART
    ):
        return None
    n = min(len(a.given.position), len(b.given.position)) - 2 * max(SHIFTS)
    if n < 50:
        return None
    inside = np.arange(n) + max(SHIFTS)
    ka, kb = a.given.stiffness, b.given.stiffness
    z = a.given.position[inside, 2]
    distance = [float(np.max(np.abs(z - b.given.position[inside + s, 2]))) for s in SHIFTS]
    best = int(np.argmin(distance))
    shift = SHIFTS[best]
    if distance[best] > APART or np.max(np.abs(ka[inside] / kb[inside + shift] - 1.0)) > STIFFER:
        return None
    if a.angle is not None and b.angle is not None:
        gap = np.abs(a.angle[inside] - b.angle[inside + shift])
        if float(np.sqrt(np.mean(gap**2))) > ANGLE_APART:
            return None
    return SharedRollout(b.name, shift)
