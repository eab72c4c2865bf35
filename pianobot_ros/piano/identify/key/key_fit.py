"""The key of the twin under a measured force: its angle, its fit to presses, and how sure the fit
is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.identify.key.load_test import GRID, Press
from pianobot_ros.piano.twin.reduced.strike_geometry import finger_model
from pianobot_ros.piano.twin.reduced.strike_model import StrikeModel
from pianobot_ros.piano.twin.reduced.strike_records import KeyModel

__all__ = ["Free", "KeyFit", "bounce_time"]


@dataclass(frozen=True)
class Free:
    """A free parameter: name, unit, start and bounds; searched on a log scale unless ``log`` is
    False.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    log: bool = True

    def coordinate(self, value: float) -> float:
        """Where ``value`` lies on the scale that is searched."""
        return float(np.log(value)) if self.log else value / (self.high - self.low)

    def value(self, coordinate: float) -> float:
        """The value at a coordinate."""
        return float(np.exp(coordinate)) if self.log else coordinate * (self.high - self.low)


class KeyFit:
    """The key model of ``key`` with a force at ``radius`` m from the hinge. Without ``rest_stop``
    the key swings through 0.
    """

    def __init__(self, key: KeyModel, radius: float, rest_stop: bool = True) -> None:
        self.key = key if rest_stop else key._replace(rest_stiffness=0.0, rest_damping=0.0)
        self.radius = radius
        self.finger = finger_model(
            "middle"
        )  # the key alone moves; which finger is attached does not matter

    def angles(self, values: Mapping[str, float], presses: Sequence[Press]) -> list[Array]:
        """Modelled angle (n,) rad of each press."""
        mechanism = dict(values)
        touch = mechanism.pop("touch_weight", 0.0) * self.radius
        late = mechanism.pop("force_delay", 0.0)
        for name in ("stop_stiffness", "stop_damping", "rest_damping"):
            if name in mechanism:
                mechanism[name] *= self.key.stop_radius**2
        model = StrikeModel(self.finger, self.key._replace(**mechanism))
        found = []
        for press in presses:
            force = press.force
            if late:
                grid = np.arange(force.size, dtype=float)
                force = np.interp(grid + late / GRID, grid, force)
            found.append(model.drive(press.start, force, self.radius, {"key_preload": touch}).angle)
        return found

    def values(self, free: Sequence[Free], x: Array) -> dict[str, float]:
        """Values by name at the coordinates ``x`` (n,)."""
        return {f.name: f.value(u) for f, u in zip(free, x, strict=True)}

    def residuals(self, free: Sequence[Free], x: Array, presses: Sequence[Press]) -> list[Array]:
        """Modelled less measured angle of each press."""
        modelled = self.angles(self.values(free, x), presses)
        return [m - p.angle for m, p in zip(modelled, presses, strict=True)]

    def rms(self, free: Sequence[Free], x: Array, presses: Sequence[Press]) -> float:
        """Root mean square of the residual, rad."""
        return float(np.sqrt(np.mean(np.concatenate(self.residuals(free, x, presses)) ** 2)))

    def fit(
        self,
        free: Sequence[Free],
        presses: Sequence[Press],
        start: Mapping[str, float] | None = None,
    ) -> Array:
        """Coordinates of the best parameters. ``start`` overrides where some of them begin."""
        low = np.array([f.coordinate(f.low) for f in free])
        high = np.array([f.coordinate(f.high) for f in free])
        first = np.array([f.coordinate((start or {}).get(f.name, f.start)) for f in free])
        first = np.clip(first, low + 1e-6, high - 1e-6)
        scale = 1e-4 + 0.02 * max(float(p.angle.max()) for p in presses)
        found = least_squares(
            lambda u: np.concatenate(self.residuals(free, u, presses)) / scale,
            first,
            bounds=(low, high),
            loss="soft_l1",
            diff_step=1e-3,
            x_scale=0.3,
            xtol=1e-5,
            ftol=1e-6,
            max_nfev=40,
        )
        return np.asarray(found.x)

    def covariance(
        self, free: Sequence[Free], x: Array, presses: Sequence[Press]
    ) -> tuple[Array, float]:
        """Covariance (n, n) of the coordinates, and the factor from a standard deviation to half of
        a 95 % interval.

        Whole presses are the independent data (cluster-robust covariance), which needs no belief
        about how the residuals within a press hang together; with fewer than four presses their
        autocorrelation is used instead.
        """
        base = self.residuals(free, x, presses)
        columns: list[list[Array]] = []
        for i in range(len(free)):
            ahead, behind = x.copy(), x.copy()
            ahead[i] += 0.01
            behind[i] -= 0.01
            sides = zip(
                self.residuals(free, ahead, presses),
                self.residuals(free, behind, presses),
                strict=True,
            )
            columns.append([np.asarray(a - b) / 0.02 for a, b in sides])
        jacobians = [np.stack(c, axis=1) for c in zip(*columns, strict=True)]
        inverse = np.linalg.pinv(np.sum([j.T @ j for j in jacobians], axis=0), hermitian=True)
        count = len(presses)
        if count >= 4:
            scores = np.array([j.T @ r for j, r in zip(jacobians, base, strict=True)])
            covariance = inverse @ (scores.T @ scores) @ inverse * count / max(count - 1, 1)
            return np.asarray(covariance), float(student.ppf(0.975, count - 1))
        whole = np.concatenate(base)
        # Neighbouring residuals say nearly the same: count only as many samples as are independent.
        lag = float(whole[1:] @ whole[:-1]) / max(float(whole @ whole), 1e-30)
        independent = max(whole.size * (1 - lag) / (1 + lag), len(free) + 1.0)
        variance = whole @ whole / independent
        return np.asarray(inverse * variance), 1.96


def bounce_time(angle: Array) -> float:
    """Time (s) from the release until the angle stays below 5 % of what it was at the release."""
    above = np.flatnonzero(np.abs(angle) > 0.05 * max(abs(float(angle[0])), 1e-9))
    return GRID * float(above[-1] + 1) if above.size else 0.0
