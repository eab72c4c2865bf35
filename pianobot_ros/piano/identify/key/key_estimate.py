"""Keystroke identification: the key's stiffness, damping, stop and touch weight from load tests
(III-A of the paper).

The measured force drives the key model of the twin; the parameters are those whose angle comes
nearest to the measured one.
Two searches stand side by side: bounded least squares on the whole angle sequences, and, as in the
paper, Bayesian optimisation of stiffness and damping on the angle error and the bounce time after
the release.

The gain of the force sensor is not known exactly, and nothing in a load test tells it: force,
stiffness, damping and inertia times one factor give the same angle. So it is integrated out of the
intervals, and what it does not touch (natural frequency, damping ratio) stands beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.piano.identify.bayes import Dimension, Optimizer
from pianobot_ros.piano.identify.estimated import Estimated
from pianobot_ros.piano.identify.key.key_fit import Free, KeyFit, bounce_time
from pianobot_ros.piano.identify.key.load_test import GRID, LoadTest, Press, cut_presses
from pianobot_ros.piano.identify.priors import prior_of
from pianobot_ros.piano.twin.reduced.strike_geometry import key_model
from pianobot_ros.piano.twin.reduced.strike_records import KeyModel

__all__ = ["KeyEstimate", "KeystrokeFit", "bounce_time", "identify_keystroke"]

Progress = Callable[[str, float], None]

# of the error without it: a further parameter stays only if it predicts the other presses so much
# better
CLEARLY = 0.97
ALONE = 0.7  # likewise, where there is no other press to predict
SMALLEST_TOUCH = 0.01  # of the largest force; less cannot be told from the sensor's zero
ABRUPT = 0.2  # rad/s: a key let go at once is faster than this
IDENTIFIABLE = 0.7  # half width of a logarithm's interval: a factor of 4 from end to end
FREE_NAMES = ("stiffness", "damping", "inertia")
NOT_BY_FORCE = ("max_angle", "force_delay")  # all others are as much off as the force is
FREE_OF_GAIN = {  # name: unit, powers of stiffness, damping and inertia, factor
    "natural_frequency": ("Hz", (0.5, 0.0, -0.5), 0.5 / np.pi),
    "damping_ratio": ("1", (-0.5, 1.0, -0.5), 0.5),
}


@dataclass(frozen=True)
class KeyEstimate(Estimated):
    """One identified parameter with its 95 % interval, the sensor's unknown gain counted in;
    ``note`` says when it is on a bound or cannot be identified.
    """

    identified: bool
    note: str = ""


@dataclass(frozen=True)
class KeystrokeFit:
    """Result of :func:`identify_keystroke`.

    ``rms`` rad over the presses kept for scoring, ``rms_fitted`` over those fitted; ``bayes`` holds
    the paper's method on the
    same data: stiffness, damping, objective; ``presses`` the traces (time, force, measured and
    modelled angle) of scored ones.
    """

    source: str
    note: int
    estimates: tuple[KeyEstimate, ...]
    rms: float
    rms_fitted: float
    bounce_measured: float
    bounce_modelled: float
    bayes: dict[str, float]
    warnings: tuple[str, ...]
    presses: tuple[dict[str, list[float]], ...]

    def __getitem__(self, name: str) -> KeyEstimate:
        """The estimate of that name."""
        return next(e for e in self.estimates if e.name == name)

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return asdict(self)


def identify_keystroke(
    test: LoadTest,
    *,
    fit_inertia: bool = True,
    force_error: float | None = None,
    bayes_iterations: int = 20,
    seed: int = 0,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> KeystrokeFit:
    """Identify the key's mechanism from a load test.

    Presses are split in two halves in turn: odd ones are fitted, even ones scored (with a single
    press both are the same, and a warning says so). The stop is fitted only where the key meets it;
    a touch weight (constant torque) and a delay between force and angle only where they predict the
    other presses clearly better. ``force_error``: standard deviation of the logarithm of the force
    sensor's gain (None: ``fsr_gain`` of config/priors.yaml). ``cancelled`` is asked between the
    questions of the Bayesian optimisation, which ends early then. Raises :class:`RecordingError`
    for data without a press.
    """
    tell = progress or (lambda _stage, _fraction: None)
    presses = cut_presses(test)
    if not presses:
        raise RecordingError(
            f"{test.source}: no press found: the force never rises above its noise"
        )
    fitted, scored = (presses[::2], presses[1::2]) if len(presses) > 1 else (presses, presses)
    swings = any(p.angle[p.release :].min(initial=0.0) < -0.1 * p.angle.max() for p in presses)
    bottomed = _meets_stop(presses)
    nominal = key_model(test.note) if bottomed else _stopless(key_model(test.note), presses)
    model = KeyFit(nominal, test.radius, rest_stop=not swings)
    warnings = _remarks(presses, bottomed, swings)
    tell("least squares", 0.1)
    free = _parameters(nominal, presses, bottomed, fit_inertia)
    free, solution = _choose(model, free, fitted, scored, presses)
    tell("intervals", 0.6)
    error = prior_of("fsr_gain").sd if force_error is None else force_error
    covariance = model.covariance(free, solution, fitted)
    estimates = _estimates(free, solution, covariance, error, warnings)
    tell("Bayesian optimisation", 0.7)
    values = model.values(free, solution)
    stop = cancelled or (lambda: False)
    bayes = _bayes(model, free, values, fitted, iterations=bayes_iterations, seed=seed, stop=stop)
    tell("done", 1.0)
    modelled = model.angles(values, scored)
    pairs = list(zip(modelled, scored, strict=True))
    return KeystrokeFit(
        test.source,
        test.note,
        estimates,
        model.rms(free, solution, scored),
        model.rms(free, solution, fitted),
        float(np.mean([bounce_time(p.angle[p.release :]) for p in scored])),
        float(np.mean([bounce_time(m[p.release :]) for m, p in pairs])),
        bayes,
        tuple(warnings),
        tuple(_trace(p, m) for m, p in pairs[:4]),
    )


def _stopless(nominal: KeyModel, presses: Sequence[Press]) -> KeyModel:
    """The key whose stop, wherever it is, lies beyond the deepest angle."""
    deepest = max(float(p.angle.max()) for p in presses)
    return nominal._replace(max_angle=max(nominal.max_angle, 2 * deepest))


def _choose(
    model: KeyFit,
    free: list[Free],
    fitted: Sequence[Press],
    scored: Sequence[Press],
    presses: Sequence[Press],
) -> tuple[list[Free], Array]:
    """The parameters that the data ask for, and their best coordinates."""
    solution = model.fit(free, fitted)
    largest = max(float(p.force.max()) for p in presses)
    # How the rest stop catches the key is not what is asked for, but its bounce must not be taken
    # for the key's own damping.
    rest = model.key.rest_damping / model.key.stop_radius**2
    more = [Free("rest_damping", "N*s/m", 3 * rest, rest / 30, rest * 30)] if rest > 0 else []
    more += [
        Free("touch_weight", "N", 0.05 * largest, 1e-4 * largest, 0.9 * largest),
        Free("force_delay", "s", 0.0, -5e-3, 5e-3, log=False),
    ]
    for extra in more:
        wider = [*free, extra]
        tried = model.fit(wider, fitted, model.values(free, solution))
        worth = extra.name != "touch_weight" or extra.value(tried[-1]) > SMALLEST_TOUCH * largest
        needed = CLEARLY if len(presses) > 1 else ALONE
        if worth and model.rms(wider, tried, scored) < needed * model.rms(free, solution, scored):
            free, solution = wider, tried
    return free, solution


def _remarks(presses: Sequence[Press], bottomed: bool, swings: bool) -> list[str]:
    """What a reader has to know about the data."""
    remarks = []
    if len(presses) == 1:
        remarks.append(
            "only one press: it is both fitted and scored, so the error given is optimistic"
        )
    if not bottomed:
        remarks.append(
            "the key never reaches its stop in these data: the stop cannot be identified and keeps"
            " its configured values"
        )
    if swings:
        remarks.append("the key swings back through zero: it was fitted without a rest stop")
    if all(_release_rate(p) < ABRUPT for p in presses):
        remarks.append(
            "no release is abrupt: damping rests on slow motion and its interval is wide"
        )
    return remarks


def _meets_stop(presses: Sequence[Press]) -> bool:
    """Whether the force rises much faster with the angle near the deepest point than on the way
    there.
    """
    deepest = max(float(p.angle.max()) for p in presses)
    angle = np.concatenate([p.angle[: p.release] for p in presses])
    force = np.concatenate([p.force[: p.release] for p in presses])
    rate = np.concatenate([np.gradient(p.angle[: p.release], GRID) for p in presses])
    bend = np.concatenate(
        [np.gradient(np.gradient(p.angle[: p.release], GRID), GRID) for p in presses]
    )
    columns = np.column_stack([angle, rate, bend])
    middle = (angle > 0.15 * deepest) & (angle < 0.8 * deepest)
    top = (angle > 0.93 * deepest) & (np.abs(rate) < 0.1)
    if middle.sum() < 20 or top.sum() < 10:
        return False
    gains = np.linalg.lstsq(columns[middle], force[middle], rcond=None)[0]
    return float(np.percentile(force[top] - columns[top] @ gains, 75)) > 0.3 * float(
        gains[0] * deepest
    )


def _release_rate(press: Press) -> float:
    """Fastest upward key rate after the load starts to go, rad/s."""
    tail = press.angle[max(press.release - 100, 0) :]
    return float(-np.min(np.diff(tail)) / GRID) if tail.size > 1 else 0.0


def _parameters(
    key: KeyModel, presses: Sequence[Press], bottomed: bool, inertia: bool
) -> list[Free]:
    free = [
        Free("stiffness", "N*m/rad", key.stiffness, key.stiffness / 20, key.stiffness * 20),
        Free("damping", "N*m*s/rad", key.damping, key.damping / 50, key.damping * 50),
    ]
    if inertia:
        free.append(Free("inertia", "kg*m^2", key.inertia, key.inertia / 10, key.inertia * 20))
    if bottomed:
        deepest = max(float(p.angle.max()) for p in presses)
        r2 = key.stop_radius**2
        stiffness, damping = key.stop_stiffness / r2, key.stop_damping / r2
        free += [
            Free("max_angle", "rad", min(key.max_angle, 0.95 * deepest), 0.5 * deepest, deepest),
            Free("stop_stiffness", "N/m", stiffness, stiffness / 50, stiffness * 50),
            Free("stop_damping", "N*s/m", damping, damping / 100, damping * 100),
        ]
    return free


def _estimates(
    free: Sequence[Free],
    solution: Array,
    spread: tuple[Array, float],
    force_error: float,
    warnings: list[str],
) -> tuple[KeyEstimate, ...]:
    """Every parameter with the sensor's gain integrated out, then what the gain does not touch."""
    covariance, width = spread
    by_force = np.array([f.name not in NOT_BY_FORCE for f in free])
    variance = np.maximum(np.diag(covariance), 0.0)
    halves = np.sqrt(width**2 * variance + (1.96 * force_error * by_force) ** 2)
    found = [
        _estimate(f, float(v), float(h), warnings)
        for f, v, h in zip(free, solution, halves, strict=True)
    ]
    if force_error > 0:
        shares = ", ".join(f.name for f in free if f.name not in NOT_BY_FORCE)
        warnings.append(
            f"the force sensor's gain is taken as known to {100 * force_error:.0f} % (standard"
            f" deviation): {shares} share this error as one factor"
        )
    at = [next((i for i, f in enumerate(free) if f.name == n), -1) for n in FREE_NAMES]
    if min(at) < 0:
        return tuple(found)
    for name, (unit, powers, factor) in FREE_OF_GAIN.items():
        direction = np.zeros(len(free))
        direction[at] = powers
        middle = float(direction @ solution)
        half = width * float(np.sqrt(max(float(direction @ covariance @ direction), 0.0)))
        value, low, high = (factor * float(np.exp(middle + s * half)) for s in (0, -1, 1))
        found.append(KeyEstimate(name, value, low, high, unit, half < IDENTIFIABLE))
    return tuple(found)


def _estimate(free: Free, coordinate: float, half_width: float, warnings: list[str]) -> KeyEstimate:
    value, low, high = (free.value(coordinate + s * half_width) for s in (0, -1, 1))
    note = ""
    if (
        min(
            abs(coordinate - free.coordinate(free.low)),
            abs(coordinate - free.coordinate(free.high)),
        )
        < 1e-3
    ):
        note = (
            f"on its bound ({value:.3g} {free.unit}): something is missing in the model or in the"
            " data"
        )
    elif free.log and not half_width < IDENTIFIABLE:
        note = (
            "cannot be identified from these data: its 95 % interval spans more than a factor of 4"
        )
    if note:
        warnings.append(f"{free.name}: {note}")
    return KeyEstimate(free.name, value, low, high, free.unit, not note, note)


def _bayes(
    model: KeyFit,
    free: Sequence[Free],
    values: Mapping[str, float],
    presses: Sequence[Press],
    *,
    iterations: int,
    seed: int,
    stop: Callable[[], bool],
) -> dict[str, float]:
    """The paper's method on stiffness and damping, the other parameters held at their least-squares
    values.
    """
    if iterations <= 0:
        return {}
    scale = max(float(p.angle.max()) for p in presses)
    optimizer = Optimizer([Dimension(f.name, f.low, f.high) for f in free[:2]], seed=seed)
    bounces = [bounce_time(p.angle[p.release :]) for p in presses]
    while len(optimizer.history) < iterations and not stop():
        asked = optimizer.ask()
        modelled = model.angles({**values, **asked}, presses)
        residual = np.concatenate([m - p.angle for m, p in zip(modelled, presses, strict=True)])
        late = [
            abs(bounce_time(m[p.release :]) - b)
            for m, p, b in zip(modelled, presses, bounces, strict=True)
        ]
        # The logarithm has the same minimum and is a surface that a Gaussian process follows much
        # better.
        optimizer.tell(
            asked, float(np.log(np.sqrt(np.mean(residual**2)) / scale + np.mean(late) / 0.1 + 1e-6))
        )
    if not optimizer.history:
        return {}
    best, value = optimizer.best()
    return {**best, "objective": float(np.exp(value)), "iterations": float(len(optimizer.history))}


def _trace(press: Press, modelled: Array) -> dict[str, list[float]]:
    """A press and its model as plain lists, for plots."""
    return {
        "time": press.time.tolist(),
        "force": press.force.tolist(),
        "measured": press.angle.tolist(),
        "modelled": modelled.tolist(),
    }
