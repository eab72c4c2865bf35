"""Several parameters at a time: stiffness per finger, damping, trigger angle.

Bounded least squares over the relative errors of the keystrokes, with priors that keep what the data do not determine where it
was. Bayesian optimisation needs too many strikes beyond two or three dimensions; it stays available for one
(:mod:`pianobot_ros.identify.stiffness`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pianobot_ros.cell.errors import PianobotError, unknown_name
from pianobot_ros.cell.keystroke import Keystroke
from pianobot_ros.identify.keystroke import Estimate
from pianobot_ros.identify.objective import Objective
from pianobot_ros.identify.stiffness import TIME_SD, VELOCITY_SD
from pianobot_ros.identify.takes import Take

__all__ = ["PARAMETERS", "JointFit", "fit_parameters"]

Array = NDArray[np.float64]

PARAMETERS = ("stiffness", "joint_damping", "key_stiffness", "key_damping", "trigger_on", "trigger_off")
"""What can be fitted. ``stiffness`` is one factor on the calibration for each finger that strikes; the others are factors too."""
PRIOR_SD = 0.5  # of the logarithm: a factor of 1.65 is nothing unusual
LOST = 5.0  # residual of a keystroke that should sound and does not


@dataclass(frozen=True)
class JointFit:
    """Result of :func:`fit_parameters`: factors with 95 % intervals, Err of Eq. 5 before and after (fractions), warnings."""

    estimates: tuple[Estimate, ...]
    err_before: float
    err_after: float
    err_held_out: float
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return asdict(self)


def fit_parameters(
    takes: Sequence[Take], names: Sequence[str] = ("stiffness", "joint_damping", "trigger_on")
) -> JointFit:
    """Fit several parameters at once to the keystrokes of ``takes``.

    Every other take of a finger is held out for the error given. Raises :class:`PianobotError` for unknown names.
    """
    for name in names:
        if name not in PARAMETERS:
            raise PianobotError(unknown_name("parameter", name, PARAMETERS))
    used = [t for t in takes if t.reference is not None]
    fitted, held = (used[::2], used[1::2]) if len(used) > 3 else (used, used)
    fingers = sorted({t.strike.finger for t in used})
    free = [f"stiffness.{f}" for f in fingers] if "stiffness" in names else []
    free += [n for n in names if n != "stiffness"]

    def residual(logs: Array) -> Array:
        rows = [_misses(t, _play(t, dict(zip(free, np.exp(logs), strict=True)))) for t in fitted]
        return np.concatenate([*rows, logs / PRIOR_SD])

    found = least_squares(
        residual, np.zeros(len(free)), diff_step=0.01, x_scale=0.1, loss="soft_l1", bounds=(-2.5, 2.5), max_nfev=40
    )
    scale = max(float(np.sum(residual(found.x)[: -len(free)] ** 2)) / max(3 * len(fitted) - len(free), 1), 1.0)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * scale
    warnings: list[str] = []
    estimates = []
    for i, name in enumerate(free):
        sd = float(np.sqrt(covariance[i, i]))
        note = ""
        if abs(abs(found.x[i]) - 2.5) < 1e-3:
            note = "on its bound: something is missing in the model or in the data"
        elif sd > 0.6 * PRIOR_SD:
            note = "hardly known from these data: the interval is mostly the prior's"
        if note:
            warnings.append(f"{name}: {note}")
        low, value, high = np.exp(found.x[i] + np.array([-1.96, 0.0, 1.96]) * sd)
        estimates.append(Estimate(name, float(value), float(low), float(high), "1", not note, note))
    best = dict(zip(free, np.exp(found.x), strict=True))
    objective = Objective()
    errors = [
        objective.err(part, [_play(t, values) for t in part])
        for part, values in ((used, {}), (fitted, best), (held, best))
    ]
    return JointFit(tuple(estimates), errors[0], errors[1], errors[2], tuple(warnings))


def _play(take: Take, factors: dict[str, float]) -> Keystroke | None:
    values = {n: f for n, f in factors.items() if n in ("joint_damping", "key_stiffness", "key_damping")}
    if (own := factors.get(f"stiffness.{take.strike.finger}")) is not None:
        values["joint_stiffness"] = own
    triggers = {n: f * getattr(take.midi, n) for n, f in factors.items() if n.startswith("trigger")}
    return take.keystroke(take.stroke(values=values), take.midi.model_copy(update=triggers))


def _misses(take: Take, found: Keystroke | None) -> Array:
    reference = take.reference
    assert reference is not None
    if found is None:
        return np.full(2 + int(np.isfinite(reference.v_rel)), LOST)
    step = 1 / take.midi.velocity_gain / np.sqrt(12)
    rows = [
        (getattr(found, n) - (wanted := getattr(reference, n))) / np.hypot(VELOCITY_SD * wanted, step)
        for n in ("v_pre", "v_rel")
        if np.isfinite(getattr(reference, n))
    ]
    return np.array([*rows, (found.t_hold - reference.t_hold) / (np.sqrt(2) * TIME_SD)])
