"""From held-out scores and gaps to probabilities and a verdict."""

from __future__ import annotations

from math import comb

import numpy as np

from pianobot_ros.gap.problem.constants import LEVEL
from pianobot_ros.gap.problem.options import Calibration


def unknown_probability(
    calibration: Calibration, share: float, worst: float, rarity: float = 1.0
) -> float:
    """Probability that structure is missing that no member of the library has.

    `share` is the part of the squared gap that refitting leaves, over all observables, that the
    best hypothesis leaves too (0 to 1): a law is seldom exact, so the odds go with what is left
    against what is explained, and with the hypothesis' `rarity`. `worst` is the largest systematic
    gap left, in floors: near the floor nothing is unknown. Never 0 or 1: `mimic` is the least of
    it, and of its complement.
    """
    usual, slope = calibration.imprecision, calibration.unknown_slope
    share = min(max(share, 0.0), 1.0)
    missing = rarity * (share * (1.0 - usual)) ** slope
    probability = missing / (missing + ((1.0 - share) * usual) ** slope)
    probability *= openness(calibration, worst)
    return float(np.clip(probability, calibration.mimic, 1.0 - calibration.certain))


def rarity(calibration: Calibration, effects: int, library: int) -> float:
    """How many times likelier it is beforehand that one effect of a `library` is at work than that
    so many `effects` are, 1 at least; a cause that the library lacks is as likely beside either.
    """
    if effects < 2:
        return 1.0
    hypotheses = [("", ("",) * n) for n in (1, effects)]
    one, several = np.exp(log_priors(hypotheses, calibration, library)).tolist()
    return float(max(library * one / (comb(library, effects) * several), 1.0))


def openness(calibration: Calibration, worst: float) -> float:
    """From 0 where the largest gap (floors) is half of what is material to 1 where it is
    `unknown_near` more.
    """
    return float(
        np.clip((worst - 1.0 - 0.5 * calibration.material) / calibration.unknown_near, 0.0, 1.0)
    )


def group_of(name: str) -> str:
    """Group of first answers whose credible sets have a threshold of their own."""
    return name if name == "unknown" else "quiet" if name in ("none", "parameters") else "effect"


def level_of(calibration: Calibration, first: str) -> float:
    """Mass that a credible set must hold where `first` is the likeliest name."""
    return float(calibration.levels.get(group_of(first), LEVEL))


def credible_set(
    names: list[str], probabilities: list[float], level: float = LEVEL
) -> tuple[str, ...]:
    """Smallest set of names that holds `level` of the probability."""
    order = np.argsort(probabilities)[::-1]
    count = int(np.searchsorted(np.cumsum(np.take(probabilities, order)), level)) + 1
    return tuple(names[i] for i in order[:count].tolist())


def log_priors(
    hypotheses: list[tuple[str, tuple[str, ...]]],
    calibration: Calibration,
    library: int,
) -> np.ndarray:
    """Log prior odds: "none" above "parameters" above single effects above pairs; shared out over
    the library.
    """
    share = np.log(max(library / 10.0, 1.0))
    out = []
    for name, effects in hypotheses:
        if name == "none":
            out.append(1.0)
        elif not effects:
            out.append(0.0)
        else:
            out.append(
                calibration.effect_log_odds
                + calibration.pair_log_odds * (len(effects) - 1)
                - share * len(effects)
            )
    return np.array(out)
