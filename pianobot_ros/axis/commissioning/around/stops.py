"""Whether a joint seems to press on something beyond an angle of its own: an end stop, an object
that a finger closes on.

Against it the effort (or what a joint stops short of its command by) grows with how far the joint,
or its command where the thing is hard, is beyond the angle, and on one side only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.commissioning.around.arm import target
from pianobot_ros.axis.commissioning.regression import design
from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.gap.problem.types import Array

__all__ = ["free_of", "stop"]

PLACES = np.linspace(0.4, 0.995, 40)
"""Shares of the travel at which a stop is looked for, from the other end."""
LEAVES = 0.25
"""Share of the squares beside inertia, friction and gravity that a stop leaves at most. Of joints
by two authors two with a stop leave 0.004 and 0.015, and of 38 without one seven would seem to have
one that leaves 0.42 to 0.74.
"""
FEWEST = 0.02
"""Share of the samples that must be beyond the angle."""
NEAR = 0.01
"""Share of the travel from the angle within which the joint may touch."""
SOFTEST = 0.02
"""Of how far the command goes beyond the angle, the joint itself is taken to go at least as far."""


def stop(logs: Sequence[Clean]) -> dict[str, float]:
    """First values of the effect `end_stop` and its side by least squares of effort (or of command
    minus position where none was measured) beside inertia, friction and gravity; empty where it
    does not help these.
    """
    use = [(c, y) for c in logs if (y := target(c)) is not None]
    if not use:
        return {}
    kept = [np.flatnonzero(c.valid[:: c.step]) for c, _ in use]
    base = np.concatenate([design(c)[k] for (c, _), k in zip(use, kept, strict=True)])
    felt = np.concatenate([y[:: c.step][k] for (c, y), k in zip(use, kept, strict=True)])
    joint = np.concatenate([c.q[:: c.step][k] for (c, _), k in zip(use, kept, strict=True)])
    drivers = [joint]
    if all(c.command is not None for c, _ in use):
        asked = [c.command[:: c.step][k] for (c, _), k in zip(use, kept, strict=True)]  # type: ignore[index]
        drivers.append(np.concatenate(asked))
    found = _best(base, felt, joint, drivers)
    if found is None:
        return {}
    side, angle, slope, driver = found
    beyond, depth = (np.maximum(side * (x - angle), 0.0) for x in (driver, joint))
    share = float(depth @ beyond) / float(beyond @ beyond)
    return {
        "end_stop": slope / max(share, SOFTEST),
        "end_stop_angle": angle,
        "end_stop_side": side,
    }


def free_of(c: Clean, found: Mapping[str, float]) -> Clean:
    """A log of which only the samples count at which the joint is clear of the stop."""
    if not found:
        return c
    side, margin = found["end_stop_side"], NEAR * float(np.ptp(c.q))
    return replace(c, valid=c.valid & (side * (c.q - found["end_stop_angle"]) < -margin))


def _best(
    base: Array, felt: Array, joint: Array, drivers: Sequence[Array]
) -> tuple[float, float, float, Array] | None:
    """Side, angle, slope (effort per rad) and driver of the one-sided spring that explains most of
    `felt` (n,) beside `base` (n, k); None where that is little.
    """
    known = np.linalg.qr(base / (np.sqrt(np.mean(base**2, axis=0)) + 1e-12))[0]
    left = felt - known @ (known.T @ felt)
    low, high = float(joint.min()), float(joint.max())
    best, most = None, (1.0 - LEAVES) * float(left @ left)
    for side in (1.0, -1.0):
        begins, ends = (low, high) if side > 0 else (high, low)
        for angle in begins + PLACES * (ends - begins):
            for driver in drivers:
                beyond = np.maximum(side * (driver - angle), 0.0)
                if np.count_nonzero(beyond) < FEWEST * beyond.size:
                    continue
                own = beyond - known @ (known.T @ beyond)
                slope = float(own @ left) / max(float(own @ own), 1e-300)
                gain = slope * float(own @ left)
                if side * slope > 0.0 and gain > most:
                    best, most = (side, float(angle), side * slope, driver), gain
    return best
