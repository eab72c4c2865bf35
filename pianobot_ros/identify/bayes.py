"""Bayesian optimisation behind ask and tell, so that the library underneath can change.

A Gaussian process with expected improvement, as in soft-hand-piano-simulator.txt, III-B, from scikit-optimize.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from skopt import Optimizer as SkoptOptimizer
from skopt.space import Real

from pianobot_ros.cell.errors import ConfigError

__all__ = ["Dimension", "Optimizer"]


@dataclass(frozen=True)
class Dimension:
    """A parameter to search, from ``low`` to ``high``; on a log scale by default, which suits stiffness and damping."""

    name: str
    low: float
    high: float
    log: bool = True

    def __post_init__(self) -> None:
        if not (self.low < self.high and (self.low > 0 or not self.log)):
            raise ConfigError(f"dimension {self.name}: [{self.low}, {self.high}] is not a range to search")


class Optimizer:
    """Minimise an unknown function of a few parameters in few evaluations.

    The same seed and the same answers give the same questions. :meth:`state` and :meth:`resume` carry a search over a restart:
    the questions asked so far are asked again silently and answered from the record.
    """

    def __init__(self, dimensions: Sequence[Dimension], *, seed: int = 0, initial: int = 6) -> None:
        self.dimensions, self.seed, self.initial = tuple(dimensions), seed, initial
        space = [Real(d.low, d.high, prior="log-uniform" if d.log else "uniform", name=d.name) for d in dimensions]
        self._inner = SkoptOptimizer(
            space, base_estimator="GP", acq_func="EI", n_initial_points=initial, initial_point_generator="sobol",
            acq_optimizer="sampling", random_state=seed, acq_optimizer_kwargs={"n_points": 2000},
        )  # fmt: skip
        self.history: list[tuple[dict[str, float], float]] = []

    def ask(self) -> dict[str, float]:
        """The parameters to try next, by name."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the library warns whenever it would repeat a point
            point = self._inner.ask()
        return {d.name: float(x) for d, x in zip(self.dimensions, point, strict=True)}

    def tell(self, asked: Mapping[str, float], value: float) -> None:
        """The function's value at what :meth:`ask` gave. Raises :class:`ConfigError` for a value that is not finite."""
        if not np.isfinite(value):
            raise ConfigError(f"the objective is {value} at {dict(asked)}: return a large finite penalty instead")
        self.history.append((dict(asked), float(value)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._inner.tell([float(asked[d.name]) for d in self.dimensions], float(value))

    def best(self) -> tuple[dict[str, float], float]:
        """The best parameters so far and their value."""
        if not self.history:
            raise ConfigError("nothing was tried yet: there is no best")
        return min(self.history, key=lambda entry: entry[1])

    def state(self) -> dict[str, Any]:
        """The search so far as plain data."""
        return {
            "seed": self.seed,
            "initial": self.initial,
            "dimensions": [[d.name, d.low, d.high, d.log] for d in self.dimensions],
            "history": [[asked, value] for asked, value in self.history],
        }

    @classmethod
    def resume(cls, state: Mapping[str, Any]) -> Optimizer:
        """The search that :meth:`state` described."""
        try:
            optimizer = cls([Dimension(*d) for d in state["dimensions"]], seed=state["seed"], initial=state["initial"])
            for asked, value in state["history"]:
                optimizer.ask()
                optimizer.tell(asked, value)
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"this is not the state of a search: {error}") from error
        return optimizer
