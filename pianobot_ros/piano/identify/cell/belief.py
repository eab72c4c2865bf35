"""What is believed of a cell, before any recording or after one, and what it says of a strike that
was not played yet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Midi
from pianobot_ros.cell.recordings.keystroke import Keystroke
from pianobot_ros.piano.identify.cell.answer import CellAnswer
from pianobot_ros.piano.identify.cell.cell_fit import PER_GROUP, SENSED, mechanics_of
from pianobot_ros.piano.identify.priors import Prior, priors
from pianobot_ros.piano.identify.takes.levels import level_name
from pianobot_ros.piano.identify.takes.missing import NOT_MECHANICAL, ON_STIFFNESS, in_notes

__all__ = [
    "Belief",
    "as_played",
    "belief_after",
    "belief_before",
    "mechanics_and_effects",
    "spread_of",
    "stiffness_factor",
]

STEP = 0.5  # standard deviations: step of a difference quotient, as in the fit
HALF_WIDTH_90 = 1.645  # half width of a 90 % interval in standard deviations
OF_SENSORS = ("fsr_offset", "fsr_curvature", "fsr_hysteresis", "fsr_creep")


@dataclass(frozen=True)
class Belief:
    """``parameters`` (p,) with their coordinates ``mean`` (p,) and ``covariance`` (p, p), both in
    standard deviations of the priors; effects that the model lacks are among them.
    """

    parameters: tuple[Prior, ...]
    mean: Array
    covariance: Array

    def values(self, at: Array | None = None) -> dict[str, float]:
        """Values by name at coordinates ``at`` (p,), by default the mean."""
        x = self.mean if at is None else at
        return {p.name: p.value(float(u)) for p, u in zip(self.parameters, x, strict=True)}


def belief_before() -> Belief:
    """What config/priors.yaml says, of one finger and one stiffness factor for all levels."""
    left_out = {*SENSED, *OF_SENSORS, *PER_GROUP, *ON_STIFFNESS} - {"joint_stiffness"}
    chosen = tuple(p for p in priors() if p.name not in left_out)
    return Belief(chosen, np.zeros(len(chosen)), np.eye(len(chosen)))


def belief_after(found: CellAnswer) -> Belief:
    """What a recording has left of it: parameters and missing effects together."""
    parameters = (*found.problem.parameters, *found.problem.missing)
    w = np.concatenate([found.joint.x, found.joint.effects])
    covariance = np.asarray(np.linalg.inv(found.joint.information), dtype=np.float64)
    tolerance = np.zeros(len(w))
    tolerance[: len(found.joint.x)] = found.problem.tolerance
    whole = covariance + np.diag(tolerance**2)
    return Belief(parameters, w, found.joint.birge**2 * whole)


def stiffness_factor(values: Mapping[str, float], pressure: float, finger: str) -> float:
    """Factor on the calibrated stiffness of ``finger`` at ``pressure`` (Pa)."""
    prefix = level_name(0.0).split(" ")[0]
    levels = sorted(
        (1e3 * float(name.split(" ")[1]), value)
        for name, value in values.items()
        if name.startswith(f"{prefix} ")
    )
    if levels:
        at, factors = zip(*levels, strict=True)
        factor = float(np.exp(np.interp(pressure, at, np.log(factors))))
    else:
        factor = values.get(prefix, 1.0)
    return factor * values.get(f"finger_stiffness {finger}", 1.0)


def mechanics_and_effects(values: Mapping[str, float]) -> dict[str, float]:
    """What of ``values`` the strike model takes."""
    missing = {p.name for p in priors() if p.missing} - NOT_MECHANICAL
    return mechanics_of(values) | {n: v for n, v in values.items() if n in missing and v}


def as_played(found: Keystroke, midi: Midi, values: Mapping[str, float]) -> Keystroke:
    """The keystroke as this instrument tells it, on the scale of the nominal velocity curve."""
    gain = midi.velocity_gain
    slope, offset = values.get("midi_velocity_gain", 1.0), values.get("midi_velocity_offset", 0.0)
    v_pre, v_rel = (gain * slope * v + offset for v in (found.v_pre, found.v_rel))
    effects = {n: values[n] for n in ("midi_curve", "trigger_speed") if values.get(n)}
    onset, t_hold, pre, rel = in_notes(np.array([found.onset, found.t_hold, v_pre, v_rel]), effects)
    return replace(
        found,
        onset=float(onset),
        t_hold=float(t_hold),
        v_pre=float(pre) / gain,
        v_rel=float(rel) / gain,
    )


def spread_of(
    belief: Belief, predict: Callable[[Mapping[str, float]], tuple[float, ...] | None]
) -> tuple[float, ...]:
    """Half widths of the 90 % intervals of what ``told`` predicts from values; NaN where nothing
    is predicted.
    """
    base = predict(belief.values())
    if base is None:
        return ()
    slopes = np.zeros((len(base), len(belief.parameters)))
    for j in range(len(belief.parameters)):
        ahead = belief.mean.copy()
        ahead[j] += STEP
        there = predict(belief.values(ahead))
        slopes[:, j] = (np.array(there) - base) / STEP if there is not None else np.nan
    variance = np.einsum("ij,jk,ik->i", slopes, belief.covariance, slopes)
    return tuple(float(HALF_WIDTH_90 * np.sqrt(v)) for v in variance)
