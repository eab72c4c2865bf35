"""Parameters as one vector whose prior is standard normal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.gap.problem.constants import ROUNDING
from pianobot_ros.gap.problem.types import Array, Parameter


class Space:
    """Maps parameter values to v = (transform(value) - transform(nominal)) / sd, with bounds, and
    back.
    """

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.parameters = tuple(parameters)
        self.names = tuple(p.name for p in parameters)
        self._log = np.array([p.log for p in parameters], bool)
        self._centre = np.array(
            [np.log(p.nominal) if p.log else p.nominal for p in parameters], float
        )
        self._sd = np.array([p.sd for p in parameters], float)
        self.low = np.array([self._one(i, p.low) for i, p in enumerate(parameters)], float)
        self.high = np.array([self._one(i, p.high) for i, p in enumerate(parameters)], float)

    def __len__(self) -> int:
        return len(self.parameters)

    def _one(self, i: int, value: float) -> float:
        raw = np.log(value) if self._log[i] else value
        return float((raw - self._centre[i]) / self._sd[i])

    def encode(self, values: Mapping[str, float]) -> Array:
        """Vector (p,) of `values`; a missing name takes its nominal value."""
        return np.array(
            [
                self._one(i, max(values[n], self.parameters[i].low) if self._log[i] else values[n])
                if n in values
                else 0.0
                for i, n in enumerate(self.names)
            ],
            float,
        )

    def clip(self, v: Array) -> Array:
        """Nearest vector within the bounds."""
        return np.clip(v, self.low, self.high)

    def decode(self, v: Array) -> dict[str, float]:
        """Parameter values of vector `v` (p,)."""
        raw = self._centre + self._sd * v
        return {
            n: float(np.exp(x)) if lg else float(x)
            for n, x, lg in zip(self.names, raw, self._log, strict=True)
        }

    def interval(self, v: Array, half: Array) -> dict[str, tuple[float, float]]:
        """Interval v ± half of every parameter in its own units, within its bounds."""
        low, high = self.decode(self.clip(v - half)), self.decode(self.clip(v + half))
        return {n: (low[n], high[n]) for n in self.names}

    def at_bounds(self, v: Array) -> list[str]:
        """Names of the parameters that sit on a bound: held there, not only near it."""
        width = self.high - self.low
        near = ROUNDING * width
        stuck = (width > 0) & ((v - self.low < near) | (self.high - v < near))
        return [n for n, s in zip(self.names, stuck, strict=True) if s]
