"""The voice-coil rig as a simulated experiment.

White-noise current, held between ticks of a loop that asks for 1.5 kHz and overruns (the paper
resamples to 0.7774 ms), drives the armature and whatever is coupled to it. Between ticks the linear
model is solved exactly (its modes decay and rotate by exp(lambda dt)), so the record has no
integration error; the encoder counts and the load cell adds noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from scipy.signal import firwin, upfirdn

from pianobot_ros.cell.arrays import Array, ComplexArray
from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.action.rig.linear import PREPARATIONS, StateSpace, state_space

__all__ = ["Resampled", "Trial", "TrialKind", "model_of", "resample", "run_trial"]

_OVERSAMPLING = 6
TrialKind = Literal["A", "AK", "AKW", "AKWH", "AKR"]


@dataclass(frozen=True)
class Trial:
    """Raw record of one trial, one row per tick of the loop.

    ``time`` [s] (N,), uneven; ``current`` [A] (N,), commanded at that tick and held to the next;
    ``displacement`` [m] (N,), whole encoder counts, read at the tick; ``force`` [N] (N,), what the
    load cell says the armature does to the key.
    """

    preparation: TrialKind
    time: Array
    current: Array
    displacement: Array
    force: Array


@dataclass(frozen=True)
class Resampled:
    """A detrended record at even steps of ``period`` [s]: ``current`` [A], ``displacement`` [m],
    ``force`` [N], each (N,).

    To a model, the current acts as if held for ``hold`` [s].
    """

    period: float
    hold: float
    current: Array
    displacement: Array
    force: Array


@njit(cache=True)  # type: ignore[untyped-decorator]
def _march(
    decay: ComplexArray, drive: ComplexArray, current: Array, start: ComplexArray
) -> ComplexArray:
    """Modal states (N, n) at the ticks: w[k + 1] = decay[k] w[k] + drive[k] current[k]."""
    states = np.empty_like(decay)
    w = start.copy()
    for k in range(decay.shape[0]):
        for i in range(w.shape[0]):
            states[k, i] = w[i]
            w[i] = decay[k, i] * w[i] + drive[k, i] * current[k]
    return states


@njit(cache=True)  # type: ignore[untyped-decorator]
def _interpolate(nodes: Array, values: Array, grid: Array) -> Array:
    """Cubic through the four nearest ``nodes`` (N,), uneven, at ascending ``grid`` (M,) inside
    them.
    """
    out = np.empty(grid.size)
    left = 1
    for k in range(grid.size):
        t = grid[k]
        while left < nodes.size - 3 and nodes[left + 1] <= t:
            left += 1
        total = 0.0
        for i in range(left - 1, left + 3):
            weight = values[i]
            for j in range(left - 1, left + 3):
                if j != i:
                    weight *= (t - nodes[j]) / (nodes[i] - nodes[j])
            total += weight
        out[k] = total
    return out


def model_of(parameters: ActionParameters, kind: str) -> StateSpace:
    """Linear model of one of the paper's preparations, or of ``AKR``. Raises
    :class:`ConfigError`.
    """
    if (
        kind == "AKR"
        # the key pressed into the front rail without the action: AK with the rail's spring and
        # damper
    ):
        rail = parameters.front_rail
        pressed = parameters.vary(
            "armature", stiffness=parameters.armature.stiffness + rail.stiffness
        ).vary("key", damping=parameters.key.damping + rail.damping)
        return state_space(pressed, "AK")
    for name in PREPARATIONS:
        if kind == name:
            return state_space(parameters, name)
    raise ConfigError(unknown_name("preparation", kind, [*PREPARATIONS, "AKR"]))


def run_trial(
    parameters: ActionParameters,
    preparation: TrialKind,
    *,
    seed: int,
    duration: float | None = None,
    ideal: bool = False,
) -> Trial:
    """Run one white-noise trial on the simulated rig.

    ``preparation`` is one of the paper's four or ``AKR``, its supplemental experiment on the front
    rail. ``duration`` [s] defaults to the configured one. ``ideal`` leaves out encoder steps and
    load-cell noise. Gravity is trimmed out, as in the paper, so displacements are about the point
    of rest. Deterministic in ``seed``. Raises :class:`ConfigError`.
    """
    rig = parameters.rig
    model = model_of(parameters, preparation)
    rail = preparation == "AKR"
    length = (
        duration if duration is not None else (rig.rail_trial_duration if rail else rig.duration)
    )
    nominal = 1.0 / rig.command_rate
    overrun = rig.mean_period - nominal
    if overrun < 0 or length < 100 * rig.mean_period:
        raise ConfigError(
            "rig: mean_period must be at least 1/command_rate and the duration at least 100 periods"
        )
    count = round(length / rig.mean_period)
    rng = np.random.default_rng(seed)
    steps = nominal + rng.gamma(rig.overrun_shape, overrun / rig.overrun_shape, count)
    time = np.concatenate([[0.0], np.cumsum(steps[:-1])])
    bias, peak = (rig.rail_trial_bias, rig.rail_trial_peak) if rail else (0.0, rig.current_peak)
    current = bias + rng.uniform(-peak, peak, count)

    states = _simulate(model, parameters.armature.motor_constant, steps, current, bias)
    displacement, velocity = states[:, 0], states[:, 1]
    acceleration = states @ model.A[1] + parameters.armature.motor_constant * current * model.B[1]
    force = np.zeros(count)
    if preparation != "A":
        a = parameters.armature
        force = (
            a.motor_constant * current
            - a.mass * acceleration
            - a.damping * velocity
            - a.stiffness * displacement
        )
    if not ideal:
        displacement = np.round(displacement * rig.encoder_resolution) / rig.encoder_resolution
        force = force + rng.normal(0.0, rig.load_cell_noise, count)
    return Trial(preparation, time, current, displacement, force)


def _simulate(
    model: StateSpace, constant: float, steps: Array, current: Array, bias: float
) -> Array:
    """States (N, n) at the start of each step, from rest under the current ``bias``."""
    rates, modes = np.linalg.eig(model.A.astype(complex))
    inputs = np.linalg.solve(modes, model.B.astype(complex)) * constant
    decay = np.exp(np.outer(steps, rates))
    drive = (decay - 1.0) * (inputs / rates)
    start = -(inputs / rates) * bias
    return np.ascontiguousarray((_march(decay, drive, current, start) @ modes.T).real)


def resample(
    trial: Trial, period: float, *, method: Literal["area", "linear"] = "area"
) -> Resampled:
    """Detrend a record and bring it to even steps of ``period`` [s].

    ``area`` averages the held current over steps six times finer, which keeps its impulse, and then
    brings current and response to ``period`` through one anti-alias filter, which cancels in their
    ratio. ``linear`` interpolates between ticks, as a plain resampling does; that low-passes the
    noise of the drive but not the response to it, and biases the estimate (by several per cent at
    60 Hz), which is why it is not the default. Raises :class:`ConfigError`.
    """
    if method not in ("area", "linear"):
        raise ConfigError(unknown_name("resampling method", method, ["area", "linear"]))
    fine = period / _OVERSAMPLING if method == "area" else period
    count = int(np.floor((trial.time[-1] - trial.time[0]) / fine))
    if count < 100 * _OVERSAMPLING:
        raise ConfigError(
            f"a record of {trial.time.size} ticks is too short for steps of {period} s: record for"
            " longer"
        )
    grid = trial.time[0] + fine * np.arange(count)
    if method == "linear":
        signals = [
            np.interp(grid, trial.time, s) for s in (trial.current, trial.displacement, trial.force)
        ]
    else:
        charge = np.concatenate([[0.0], np.cumsum(trial.current[:-1] * np.diff(trial.time))])
        current = np.diff(np.interp(np.append(grid, grid[-1] + fine), trial.time, charge)) / fine
        smooth = [_interpolate(trial.time, s, grid) for s in (trial.displacement, trial.force)]
        taps = firwin(8 * _OVERSAMPLING + 1, 0.8 / _OVERSAMPLING)
        signals = [upfirdn(taps, s - s.mean(), down=_OVERSAMPLING) for s in (current, *smooth)]
    current, displacement, force = (_detrend(s) for s in signals)
    return Resampled(period, fine, current, displacement, force)


def _detrend(signal: Array) -> Array:
    """``signal`` (N,) without its straight line."""
    t = np.linspace(-1.0, 1.0, signal.size)
    return np.asarray(signal - signal.mean() - t * (signal @ t) / (t @ t))
