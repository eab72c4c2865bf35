"""Draws a case by its fixed seed: parameters, sizes of the laws, and noise of the blocks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from foreign_robots.case_table import CASES, ROBOTS, SETS, Kind
from foreign_robots.size_in_floors import Sized, SizeInFloors, nominal_values
from pianobot_ros.gap import Block, Twin

SEED = 20261
# Floors between which a law's size is drawn, log-uniform, by kind.
FLOORS = {"effect": (1.5, 8.0), "unknown": (3.0, 8.0), "pair": (4.0, 8.0)}
# How far the parameters are off, as shares, by kind; those of "none" are as believed.
WRONG_ONLY, WRONG_BESIDE = (0.10, 0.15), (0.0, 0.10)


@dataclass(frozen=True)
class HiddenLaw:
    """A law of the plant at work: the family that it is a relative of, its size in the plant's
    terms and in floors, and in floors what refitted parameters leave of it.
    """

    family: str
    text: str
    size: float
    raw: Sized
    beyond_refit: Sized


@dataclass(frozen=True)
class HiddenRobot:
    """A case: what is diagnosed, and what is true."""

    robot: str
    index: int
    kind: Kind
    laws: tuple[HiddenLaw, ...]
    twin: Twin
    blocks: list[Block]
    parameters: dict[str, float]

    @property
    def truth(self) -> frozenset[str]:
        """The names that are right."""
        if self.kind in ("effect", "pair"):
            return frozenset(law.family for law in self.laws)
        return frozenset({self.kind})


def draw_parameters(
    twin: Twin, random: np.random.Generator, least: float, most: float
) -> dict[str, float]:
    """Parameters off by a share from ``least`` to ``most``, up or down, but by no more than one
    standard deviation of the prior (1.5 where ``most`` is 0.15).
    """
    out = {}
    for p in twin.parameters:
        x = random.uniform(least, most) * random.choice([-1, 1])
        cap = p.sd if p.log or not p.nominal else p.sd / abs(p.nominal)
        x = float(np.clip(x, -cap * most / 0.1, cap * most / 0.1))
        out[p.name] = p.nominal * (1 + x) if p.nominal else x
    return out


def draw_case(which: str, robot: str, index: int) -> HiddenRobot:
    """Case ``index`` of a robot in the set ``which``, the same in every run."""
    made, plan = ROBOTS[robot], CASES[which][robot][index]
    twin = made.twin()
    random = np.random.default_rng([SEED, SETS.index(which) + 1, list(ROBOTS).index(robot), index])
    if plan.kind == "none":
        parameters = nominal_values(twin)
    else:
        wrong = WRONG_ONLY if plan.kind == "parameters" else WRONG_BESIDE
        parameters = draw_parameters(twin, random, *wrong)
    seed = int(random.integers(1 << 30))
    laws: dict[str, HiddenLaw] = {}
    if plan.laws:
        sizes = SizeInFloors(made, twin, parameters, seed)
        low, high = FLOORS[plan.kind]
        for name in plan.laws:
            floors = math.exp(random.uniform(math.log(low), math.log(high)))
            size, raw = sizes.solve(name, floors)
            law, beyond = made.laws[name], sizes.beyond_refit(name, size)
            laws[name] = HiddenLaw(law.family, law.text, size, raw, beyond)
    blocks = made.record(parameters, {name: law.size for name, law in laws.items()}, seed)
    known = tuple(laws.values())
    return HiddenRobot(robot, index, plan.kind, known, twin, blocks, parameters)
