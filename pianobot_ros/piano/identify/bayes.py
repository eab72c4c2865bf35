"""Bayesian optimisation behind ask and tell, so that the library underneath can change.

A Gaussian process with expected improvement, as in "Data-driven Simulation Framework", III-B, from
scikit-optimize.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.stats.qmc import LatinHypercube
from skopt import Optimizer as SkoptOptimizer
from skopt.space import Real
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped,unused-ignore]

from pianobot_ros.cell.errors import ConfigError

__all__ = ["Dimension", "Optimizer"]


@dataclass(frozen=True)
class Dimension:
    """A parameter to search, from ``low`` to ``high``; on a log scale by default, which suits
    stiffness and damping.
    """

    name: str
    low: float
    high: float
    log: bool = True

    def __post_init__(self) -> None:
        if not (self.low < self.high and (self.low > 0 or not self.log)):
            raise ConfigError(
                f"dimension {self.name}: [{self.low}, {self.high}] is not a range to search"
            )


@lru_cache(maxsize=1)
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


class Optimizer:
    """Minimise an unknown function of a few parameters in few evaluations.

    Each question depends on nothing but the seed and the answers so far: the same seed and answers
    give the same questions, and a search carried over a restart by :meth:`state` and :meth:`resume`
    goes on exactly as if it had not stopped.
    """

    def __init__(self, dimensions: Sequence[Dimension], *, seed: int = 0, initial: int = 6) -> None:
        self.dimensions, self.seed, self.initial = tuple(dimensions), seed, initial
        self._space = [
            Real(d.low, d.high, prior="log-uniform" if d.log else "uniform", name=d.name)
            for d in dimensions
        ]
        self.history: list[tuple[dict[str, float], float]] = []

    def ask(self) -> dict[str, float]:
        """The parameters to try next, by name."""
        tried = [[asked[d.name] for d in self.dimensions] for asked, _ in self.history]
        if len(tried) < self.initial:
            return self._first(len(tried))
        random = np.random.RandomState(
            np.random.SeedSequence([self.seed, len(tried)]).generate_state(4)
        )
        # The matrices are so small that BLAS threads cost ten times what they save.
        with warnings.catch_warnings(), _threads().limit(limits=1, user_api="blas"):
            warnings.simplefilter("ignore")  # the library warns whenever it would repeat a point
            inner = SkoptOptimizer(
                self._space,
                base_estimator="GP",
                acq_func="EI",
                n_initial_points=1,
                initial_point_generator="random",
                acq_optimizer="sampling",
                random_state=random,
                acq_optimizer_kwargs={"n_points": 2000},
            )
            inner.tell(tried, [value for _, value in self.history])
            point = inner.ask()
        return {d.name: float(x) for d, x in zip(self.dimensions, point, strict=True)}

    def _first(self, index: int) -> dict[str, float]:
        """A point of the first design: a Latin hypercube, so that every part of every range is
        visited.
        """
        design = LatinHypercube(len(self.dimensions), seed=np.random.default_rng(self.seed)).random(
            self.initial
        )
        point = {}
        for d, share in zip(self.dimensions, design[index], strict=True):
            x = (
                np.exp(np.log(d.low) + share * np.log(d.high / d.low))
                if d.log
                else d.low + share * (d.high - d.low)
            )
            point[d.name] = float(x)
        return point

    def tell(self, asked: Mapping[str, float], value: float) -> None:
        """The function's value at what :meth:`ask` gave. Raises :class:`ConfigError` for a value
        that is not finite.
        """
        if not np.isfinite(value):
            raise ConfigError(
                f"the objective is {value} at {dict(asked)}: return a large finite penalty instead"
            )
        self.history.append(({d.name: float(asked[d.name]) for d in self.dimensions}, float(value)))

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
        """The search that :meth:`state` described. Raises :class:`ConfigError` for anything
        else.
        """
        try:
            optimizer = cls(
                [Dimension(*d) for d in state["dimensions"]],
                seed=int(state["seed"]),
                initial=int(state["initial"]),
            )
            for asked, value in state["history"]:
                optimizer.tell(asked, value)
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"this is not the state of a search: {error}") from error
        return optimizer
