"""Keystroke identification: the key's stiffness, damping, stop and touch weight from load tests (III-A of the paper).

The measured force drives the key model of the twin; the parameters are those whose angle comes nearest to the measured one.
Two searches stand side by side: bounded least squares on the whole angle sequences, and, as in the paper, Bayesian
optimisation of stiffness and damping on the angle error and the bounce time after the release.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.identify.bayes import Dimension, Optimizer
from pianobot_ros.identify.load_test import GRID, LoadTest, Press, cut_presses
from pianobot_ros.twin.strike import StrikeModel
from pianobot_ros.twin.strike_geometry import KeyModel, finger_model, key_model

__all__ = ["Estimate", "KeystrokeFit", "bounce_time", "identify_keystroke"]

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Estimate:
    """One identified parameter with its 95 % interval; ``note`` says when it is on a bound or cannot be identified."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    identified: bool
    note: str = ""


@dataclass(frozen=True)
class KeystrokeFit:
    """Result of :func:`identify_keystroke`.

    ``rms`` rad over the presses kept for scoring, ``rms_fitted`` over those fitted; ``bayes`` holds the paper's method on the
    same data: stiffness, damping, objective; ``presses`` the traces (time, force, measured and modelled angle) of scored ones.
    """

    source: str
    note: int
    estimates: tuple[Estimate, ...]
    rms: float
    rms_fitted: float
    bounce_measured: float
    bounce_modelled: float
    bayes: dict[str, float]
    warnings: tuple[str, ...]
    presses: tuple[dict[str, list[float]], ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class _Free:
    """A free parameter: name, unit, bounds; all are searched on a log scale."""

    name: str
    unit: str
    start: float
    low: float
    high: float


def identify_keystroke(
    test: LoadTest,
    *,
    fit_inertia: bool = True,
    bayes_iterations: int = 20,
    seed: int = 0,
    progress: Progress | None = None,
) -> KeystrokeFit:
    """Identify the key's mechanism from a load test.

    Presses are split in two halves in turn: odd ones are fitted, even ones scored (with a single press both are the same,
    and a warning says so). The stop is fitted only where the key bottoms, the touch weight (a constant torque) only where it
    shortens the residual by more than its own noise. Intervals come from a bootstrap over presses, or, for fewer than four,
    from the curvature of the fit with the residual's autocorrelation counted.
    """
    tell = progress or (lambda _stage, _fraction: None)
    presses = cut_presses(test)
    if not presses:
        raise RecordingError(f"{test.source}: no press found: the force never rises above its noise")
    warnings: list[str] = []
    fitted, scored = (presses[::2], presses[1::2]) if len(presses) > 1 else (presses, presses)
    if len(presses) == 1:
        warnings.append("only one press: it is both fitted and scored, so the error given is optimistic")
    nominal = key_model(test.note)
    model = _Model(test, nominal)
    bottomed = [p for p in presses if p.angle.max() > 0.97 * max(q.angle.max() for q in presses) and _stops(p)]
    free = _free_parameters(nominal, presses, bool(bottomed), fit_inertia)
    if not bottomed:
        warnings.append(
            "the key never reaches its stop in these data: angle and stiffness of the stop keep their configured values"
        )
    if all(_release_speed(p) < 0.2 for p in presses):
        warnings.append("no release is abrupt: damping rests on slow motion and its interval is wide")
    tell("least squares", 0.1)
    solution = model.fit(free, fitted)
    with_touch = [*free, _Free("touch_weight", "N", 0.05, 1e-4, 2.0)]
    touched = model.fit(with_touch, fitted)
    # One more parameter always fits better; it stays only if it also predicts the other presses better.
    if model.rms(with_touch, touched, scored) < 0.97 * model.rms(free, solution, scored):
        free, solution = with_touch, touched
    tell("intervals", 0.4)
    spread = model.spread(free, solution, fitted, seed)
    estimates = tuple(_estimate(f, v, s, warnings) for f, v, s in zip(free, solution, spread, strict=True))
    tell("Bayesian optimisation", 0.7)
    bayes = model.bayes(free, solution, fitted, bayes_iterations, seed)
    tell("done", 1.0)
    traces = tuple(model.trace(free, solution, p) for p in scored[:4])
    return KeystrokeFit(
        test.source, test.note, estimates, model.rms(free, solution, scored), model.rms(free, solution, fitted),
        float(np.mean([bounce_time(p.angle[p.release :]) for p in scored])),
        float(np.mean([bounce_time(model.angle(free, solution, p)[p.release :]) for p in scored])),
        bayes, tuple(warnings), traces,
    )  # fmt: skip


def bounce_time(angle: Array) -> float:
    """Time (s) from the release until the angle stays below 5 % of what it was at the release."""
    above = np.flatnonzero(np.abs(angle) > 0.05 * max(abs(float(angle[0])), 1e-9))
    return GRID * float(above[-1] + 1) if above.size else 0.0


def _stops(press: Press) -> bool:
    """Whether the key meets its stop: the force still rises by half while the angle gains less than 15 %."""
    i = int(np.argmax(press.angle))
    near = press.angle > 0.85 * press.angle[i]
    return bool(near.sum() > 10 and np.ptp(press.force[near]) > 0.5 * press.force.max())


def _release_speed(press: Press) -> float:
    """Fastest upward key rate after the load starts to go, rad/s."""
    tail = press.angle[max(press.release - 100, 0) :]
    return float(-np.min(np.diff(tail)) / GRID) if tail.size > 1 else 0.0


def _free_parameters(key: KeyModel, presses: Sequence[Press], bottomed: bool, inertia: bool) -> list[_Free]:
    free = [
        _Free("stiffness", "N*m/rad", key.stiffness, key.stiffness / 20, key.stiffness * 20),
        _Free("damping", "N*m*s/rad", key.damping, key.damping / 50, key.damping * 50),
    ]
    if inertia:
        free.append(_Free("inertia", "kg*m^2", key.inertia, key.inertia / 5, key.inertia * 10))
    if bottomed:
        deepest = max(float(p.angle.max()) for p in presses)
        r2 = key.stop_radius**2
        free.append(_Free("max_angle", "rad", min(key.max_angle, 0.95 * deepest), 0.5 * deepest, deepest))
        free.append(_Free("stop_stiffness", "N/m", key.stop_stiffness / r2, 100.0, 1e5))
    return free


def _estimate(free: _Free, value: float, log_sd: float, warnings: list[str]) -> Estimate:
    actual = float(np.exp(value))
    low, high = float(np.exp(value - 1.96 * log_sd)), float(np.exp(value + 1.96 * log_sd))
    note = ""
    if min(abs(value - np.log(free.low)), abs(value - np.log(free.high))) < 1e-3:
        note = f"on its bound ({actual:.3g} {free.unit}): something is missing in the model or in the data"
    elif not log_sd < 0.35:
        note = "cannot be identified from these data: its 95 % interval spans more than a factor of 4"
    if note:
        warnings.append(f"{free.name}: {note}")
    return Estimate(free.name, actual, low, high, free.unit, not note, note)


class _Model:
    """The key of the twin under a measured force."""

    def __init__(self, test: LoadTest, key: KeyModel) -> None:
        self.test, self.key = test, key
        self.finger = finger_model("middle")  # the key alone moves; which finger is attached does not matter

    def angle(self, free: Sequence[_Free], logs: Array, press: Press) -> Array:
        """Modelled angle (n,) rad of a press."""
        values = dict(zip((f.name for f in free), np.exp(logs), strict=True))
        touch = float(values.pop("touch_weight", 0.0)) * self.test.radius
        r2 = self.key.stop_radius**2
        if "stop_stiffness" in values:
            values["stop_stiffness"] *= r2
        model = StrikeModel(self.finger, replace(self.key, **values))
        return model.drive(press.start, press.force, self.test.radius, {"key_preload": touch}).angle

    def residual(self, free: Sequence[_Free], logs: Array, presses: Sequence[Press]) -> Array:
        return np.concatenate([self.angle(free, logs, p) - p.angle for p in presses])

    def rms(self, free: Sequence[_Free], logs: Array, presses: Sequence[Press]) -> float:
        return float(np.sqrt(np.mean(self.residual(free, logs, presses) ** 2)))

    def fit(self, free: Sequence[_Free], presses: Sequence[Press], start: Array | None = None) -> Array:
        """Natural logarithms of the best parameters."""
        low, high = np.log([f.low for f in free]), np.log([f.high for f in free])
        first = np.log([f.start for f in free]) if start is None else start
        first = np.clip(first, low + 1e-6, high - 1e-6)
        scale = 1e-4 + 0.02 * max(float(p.angle.max()) for p in presses)
        found = least_squares(
            lambda u: self.residual(free, u, presses) / scale, first, bounds=(low, high), loss="soft_l1", diff_step=1e-3,
            x_scale=0.3, max_nfev=60,
        )  # fmt: skip
        return np.asarray(found.x)

    def spread(self, free: Sequence[_Free], logs: Array, presses: Sequence[Press], seed: int) -> Array:
        """Standard deviation of each log parameter."""
        if len(presses) >= 4:
            rng = np.random.default_rng(seed)
            picks = [rng.integers(0, len(presses), len(presses)) for _ in range(12)]
            fits = [self.fit(free, [presses[i] for i in pick], logs) for pick in picks]
            return np.asarray(np.std(fits, axis=0, ddof=1))
        base = self.residual(free, logs, presses)
        columns = []
        for i in range(len(free)):
            nudged = logs.copy()
            nudged[i] += 0.01
            columns.append((self.residual(free, nudged, presses) - base) / 0.01)
        jacobian = np.stack(columns, axis=1)
        # Neighbouring residuals say nearly the same: count only as many samples as are independent.
        lag = base[1:] @ base[:-1] / max(base @ base, 1e-30)
        independent = max(base.size * (1 - lag) / (1 + lag), len(free) + 1.0)
        variance = base @ base / base.size * base.size / independent
        information = jacobian.T @ jacobian
        return np.asarray(np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)) * variance, 0.0)))

    def bayes(
        self, free: Sequence[_Free], logs: Array, presses: Sequence[Press], iterations: int, seed: int
    ) -> dict[str, float]:
        """The paper's method on stiffness and damping, the other parameters held at their least-squares values."""
        if iterations <= 0:
            return {}
        names = [f.name for f in free]
        scale = max(float(p.angle.max()) for p in presses)
        optimizer = Optimizer([Dimension(f.name, f.low, f.high) for f in free[:2]], seed=seed)

        def objective(values: dict[str, float]) -> float:
            u = logs.copy()
            for name, value in values.items():
                u[names.index(name)] = np.log(value)
            modelled = [self.angle(free, u, p) for p in presses]
            residual = np.concatenate([m - p.angle for m, p in zip(modelled, presses, strict=True)])
            error = float(np.sqrt(np.mean(residual**2)))
            bounce = np.mean(
                [
                    abs(bounce_time(m[p.release :]) - bounce_time(p.angle[p.release :]))
                    for m, p in zip(modelled, presses, strict=True)
                ]
            )
            return float(error / scale + bounce / 0.1)

        for _ in range(iterations):
            asked = optimizer.ask()
            optimizer.tell(asked, objective(asked))
        best, value = optimizer.best()
        return {**best, "objective": value, "iterations": float(iterations)}

    def trace(self, free: Sequence[_Free], logs: Array, press: Press) -> dict[str, list[float]]:
        """A press and its model as plain lists, for plots."""
        modelled = self.angle(free, logs, press)
        return {
            "time": press.time.tolist(),
            "force": press.force.tolist(),
            "measured": press.angle.tolist(),
            "modelled": modelled.tolist(),
        }
