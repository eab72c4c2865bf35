"""Fit of the models of Table 1 to transfer functions, in the paper's sequence: A, then AK with A
fixed, then AKWH, and the rail.

Each stage is a weighted least squares in the complex plane. The weights come from the coherence,
the interval of each parameter from the Jacobian, and the uncertainty of what an earlier stage fixed
is carried into the later ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from pianobot_ros.cell.arrays import Array, ComplexArray
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.action.rig.frf import FrequencyResponse, transfer_estimate
from pianobot_ros.piano.action.rig.linear import StateSpace
from pianobot_ros.piano.action.rig.voice_coil import TrialKind, model_of, resample, run_trial

__all__ = [
    "FIRST_GUESS",
    "HALF_WIDTH_95",
    "STAGES",
    "RigEstimate",
    "TableTwo",
    "fit_sequence",
    "held_response",
    "identify_rig",
    "response_of",
    "stacked",
    "value_of",
    "with_values",
]


# Stage: the preparation it uses and the numbers of Table 2 it frees, as (section, field) of
# ActionParameters.
STAGES: dict[TrialKind, tuple[tuple[str, str], ...]] = {
    "A": (("armature", "mass"), ("armature", "damping"), ("armature", "stiffness")),
    "AK": (("key", "mass"), ("key", "damping")),
    "AKWH": (
        ("hammer", "mass"),
        ("hammer", "coupler_damping"),
        ("hammer", "coupler_stiffness"),
        ("hammer", "bushing_damping"),
    ),
    "AKR": (("front_rail", "stiffness"), ("front_rail", "damping")),
}
# every stage starts this far off, in ratio to the table, to show that it needs no good guess
FIRST_GUESS = 0.6
HALF_WIDTH_95 = 1.959964  # half width of a 95 % interval in standard deviations


@dataclass(frozen=True)
class RigEstimate:
    """One identified number: ``value`` with a 95 % interval ``low`` to ``high``, all in SI."""

    value: float
    low: float
    high: float

    def holds(self, truth: float) -> bool:
        """Whether the interval holds ``truth``."""
        return self.low <= truth <= self.high


@dataclass(frozen=True)
class TableTwo:
    """Identified numbers by (section, field) of :class:`ActionParameters`, with the responses they
    were fitted to.

    ``misfit`` is the root of the mean squared weighted residual by preparation: 1 if the model
    explains all but noise.
    """

    estimates: Mapping[tuple[str, str], RigEstimate]
    responses: Mapping[TrialKind, FrequencyResponse]
    misfit: Mapping[TrialKind, float]
    parameters: ActionParameters


def held_response(model: StateSpace, gain: float, frequency: Array, period: float) -> ComplexArray:
    """Response [m per unit of input] of ``model`` at ``frequency`` [Hz] with the input held for
    ``period`` [s].
    """
    rates, modes = np.linalg.eig(model.A.astype(complex))
    residues = gain * (model.C @ modes) * np.linalg.solve(modes, model.B.astype(complex))
    decay = np.exp(rates * period)
    z = np.exp(2j * np.pi * frequency * period)
    return np.asarray(((decay - 1.0) / rates * residues) @ (1.0 / (z[None, :] - decay[:, None])))


def response_of(
    parameters: ActionParameters, preparation: TrialKind, frequency: Array, period: float
) -> ComplexArray:
    """X/I [m/A] of a preparation at ``frequency`` [Hz], with the current held for ``period``
    [s].
    """
    return held_response(
        model_of(parameters, preparation), parameters.armature.motor_constant, frequency, period
    )


def fit_sequence(
    parameters: ActionParameters, responses: Mapping[TrialKind, FrequencyResponse]
) -> TableTwo:
    """Fit Table 2 stage by stage to X/I ``responses``; k_M and everything not in :data:`STAGES` is
    taken from ``parameters``.

    Stages whose preparation is missing are skipped, except A, which the rest needs. Raises
    :class:`ConfigError`.
    """
    if "A" not in responses:
        raise ConfigError("the fit starts with preparation A: record it too")
    current = parameters
    names: list[tuple[str, str]] = []
    covariance = np.zeros((0, 0))
    spans: dict[TrialKind, list[int]] = {}
    misfit: dict[TrialKind, float] = {}
    settings = parameters.frequency_response
    for preparation, free in STAGES.items():
        if preparation not in responses:
            continue
        # Bins of a Hann window overlap their neighbours; every second one is nearly independent.
        band = responses[preparation].band(settings.fit_low, settings.fit_high, every=2)
        stage = _fit_stage(current, preparation, band, free)
        used = [i for earlier in _needed(preparation) for i in spans.get(earlier, [])]
        sensitivity = _sensitivity(stage, preparation, band, [names[i] for i in used])
        covariance = _extend(covariance, used, sensitivity, stage.covariance)
        spans[preparation] = list(range(len(names), len(names) + len(free)))
        names.extend(free)
        misfit[preparation] = stage.misfit
        current = stage.parameters
    spread = HALF_WIDTH_95 * np.sqrt(np.diag(covariance))
    values = [value_of(current, name) for name in names]
    estimates = {
        n: RigEstimate(float(v), float(v - s), float(v + s))
        for n, v, s in zip(names, values, spread, strict=True)
    }
    return TableTwo(estimates, dict(responses), misfit, current)


def identify_rig(
    parameters: ActionParameters, *, seed: int, duration: float | None = None
) -> TableTwo:
    """Run every preparation on the simulated rig and recover Table 2 from the records.
    Deterministic in ``seed``.
    """
    kinds: tuple[TrialKind, ...] = ("A", "AK", "AKW", "AKWH", "AKR")
    responses: dict[TrialKind, FrequencyResponse] = {}
    for offset, kind in enumerate(kinds):
        trial = run_trial(parameters, kind, seed=seed * len(kinds) + offset, duration=duration)
        even = resample(trial, parameters.rig.mean_period)
        responses[kind] = transfer_estimate(
            even.current,
            even.displacement,
            even.period,
            parameters.frequency_response,
            hold=even.hold,
        )
    return fit_sequence(parameters, responses)


# ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Stage:
    parameters: ActionParameters
    covariance: Array
    misfit: float
    jacobian: Array
    sigma: Array


def _needed(preparation: TrialKind) -> tuple[TrialKind, ...]:
    return {"A": (), "AK": ("A",), "AKWH": ("A", "AK"), "AKR": ("A", "AK")}.get(preparation, ())  # type: ignore[return-value]


def value_of(parameters: ActionParameters, name: tuple[str, str]) -> float:
    """One number by (section, field)."""
    return float(getattr(getattr(parameters, name[0]), name[1]))


def with_values(
    parameters: ActionParameters, names: tuple[tuple[str, str], ...], values: Array
) -> ActionParameters:
    """``parameters`` with the numbers ``names`` set to ``values`` (n,)."""
    for (section, field), value in zip(names, values, strict=True):
        parameters = parameters.vary(section, **{field: float(value)})
    return parameters


def _fit_stage(
    parameters: ActionParameters,
    preparation: TrialKind,
    band: FrequencyResponse,
    free: tuple[tuple[str, str], ...],
) -> _Stage:
    scale = np.array([value_of(parameters, name) for name in free])
    sigma = _spread(band)

    def residual(log_ratio: Array) -> Array:
        trial = with_values(parameters, free, scale * np.exp(log_ratio))
        return stacked(
            band.response - response_of(trial, preparation, band.frequency, band.hold), sigma
        )

    start = np.full(len(free), np.log(FIRST_GUESS))
    # The weights span decades, so a wrong start is led by a soft loss first and polished by plain
    # least squares.
    rough = least_squares(residual, start, loss="soft_l1", f_scale=30.0, max_nfev=200)
    found = least_squares(residual, rough.x, xtol=1e-12, ftol=1e-12)
    if not found.success:
        raise ConfigError(
            f"the fit of {preparation} did not converge: check the record, or widen the fitted band"
        )
    variance = 2 * found.cost / max(1, found.fun.size - len(free))
    values = scale * np.exp(found.x)
    jacobian = np.asarray(found.jac, dtype=float) / values  # from the logarithm to the value
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    return _Stage(
        with_values(parameters, free, values), covariance, float(np.sqrt(variance)), jacobian, sigma
    )


def _sensitivity(
    stage: _Stage, preparation: TrialKind, band: FrequencyResponse, fixed: list[tuple[str, str]]
) -> Array:
    """d(fitted values) / d(values fixed by earlier stages), shape (free, fixed)."""
    free = stage.jacobian.shape[1]
    if not fixed:
        return np.zeros((free, 0))

    def residual(values: Array) -> Array:
        trial = with_values(stage.parameters, tuple(fixed), values)
        return stacked(
            band.response - response_of(trial, preparation, band.frequency, band.hold), stage.sigma
        )

    outer = _differences(residual, np.array([value_of(stage.parameters, name) for name in fixed]))
    return np.asarray(-np.linalg.solve(stage.jacobian.T @ stage.jacobian, stage.jacobian.T @ outer))


def _differences(function: Callable[[Array], Array], at: Array) -> Array:
    columns = []
    for i in range(at.size):
        step = np.zeros_like(at)
        step[i] = 1e-5 * at[i]
        columns.append((function(at + step) - function(at - step)) / (2 * step[i]))
    return np.stack(columns, axis=1)


def _extend(covariance: Array, used: list[int], sensitivity: Array, own: Array) -> Array:
    """Joint covariance after a stage that leans on the parameters ``used`` of earlier ones."""
    old, new = covariance.shape[0], own.shape[0]
    full = np.zeros((new, old))
    full[:, used] = sensitivity
    joint = np.zeros((old + new, old + new))
    joint[:old, :old] = covariance
    joint[old:, :old] = full @ covariance
    joint[:old, old:] = joint[old:, :old].T
    joint[old:, old:] = own + full @ covariance @ full.T
    return joint


def _spread(band: FrequencyResponse) -> Array:
    """Standard deviation of the real and of the imaginary part of each estimate (Bendat and
    Piersol), smoothed.
    """
    coherence = np.clip(band.coherence, 1e-6, 1.0 - 1e-12)
    ratio = (1.0 - coherence) / (2.0 * band.averages * coherence)
    smooth = median_filter(ratio, size=min(51, ratio.size), mode="nearest") / np.log(2)
    return np.asarray(np.abs(band.response) * np.sqrt(smooth))


def stacked(difference: ComplexArray, sigma: Array) -> Array:
    """Real and imaginary parts (2 n,) of a ``difference`` (n,), each in units of ``sigma`` (n,)."""
    scaled = difference / sigma
    return np.concatenate([scaled.real, scaled.imag])
