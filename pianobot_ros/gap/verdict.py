"""From held-out scores and gaps to probabilities and a verdict."""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.options import Calibration


def unknown_probability(calibration: Calibration, open_share: float, left: float, stays: float = 1.0) -> float:
    """Probability that structure is missing that no member of the library has.

    `open_share` is the part of the held-out gap above the floor that the best hypothesis leaves (0 to 1), `left` the
    remaining gap of the worst observable in floor units, `stays` the share of it that refitting left too (0 to 1). Near the
    floor nothing is unknown.
    """
    if not np.isfinite(open_share):
        open_share = 0.0
    left = max(left, 1.0)
    logit = (
        calibration.unknown_bias
        + calibration.unknown_open * open_share
        + calibration.unknown_left * np.sqrt(stays) * np.log(left)
    )
    probability = 1.0 / (1.0 + np.exp(-logit))
    near = np.clip((left - 1.0 - 0.5 * calibration.material) / calibration.unknown_near, 0.0, 1.0)
    return float(probability * near)


def credible_set(names: list[str], probabilities: list[float], level: float = 0.95) -> tuple[str, ...]:
    """Smallest set of names that holds `level` of the probability."""
    order = np.argsort(probabilities)[::-1]
    chosen, total = [], 0.0
    for i in order:
        chosen.append(names[int(i)])
        total += probabilities[int(i)]
        if total >= level:
            break
    return tuple(chosen)


def log_priors(hypotheses: list[tuple[str, tuple[str, ...]]], calibration: Calibration, prior: dict[str, float],
               library: int) -> np.ndarray:  # fmt: skip
    """Log prior odds: "none" above "parameters" above single effects above pairs; shared out over the library."""
    share = np.log(max(library, 1) / 10.0) if library > 10 else 0.0
    out = []
    for name, effects in hypotheses:
        if name == "none":
            out.append(1.0)
        elif not effects:
            out.append(0.0)
        else:
            own = sum(np.log(max(prior.get(e, 1.0), 1e-12)) for e in effects)
            out.append(calibration.effect_log_odds + calibration.pair_log_odds * (len(effects) - 1)
                       - share * len(effects) + own)  # fmt: skip
    return np.array(out)
