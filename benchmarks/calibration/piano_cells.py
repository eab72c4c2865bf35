"""Cells of the emulated piano cell with known causes, and their studies."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from calibration.views import Truth
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.numbers.learned import PIANO_CELL
from pianobot_ros.emulator.plant.laws.table import HELD_BACK
from pianobot_ros.gap import Effect, Options
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.search.study import Study
from pianobot_ros.piano.blind import Design, make_cases
from pianobot_ros.piano.blind.folder import read_manifest
from pianobot_ros.piano.gap.diagnosis.relatives import relatives_of
from pianobot_ros.piano.gap.diagnosis.settings import prior_options
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

__all__ = ["PianoCells", "narrowed", "refuse_held_back"]


@dataclass(frozen=True)
class PianoCells:
    """The cells in `keep`; those of `pianobot blind make` are taken as well."""

    keep: Path
    file: str = PIANO_CELL
    plant: str = "pianobot_ros.emulator.plant"

    @property
    def options(self) -> Options:
        """The settings before anything is learned."""
        return prior_options()

    def make(self, cases: int, seed: int, laws: tuple[int, ...], jobs: int) -> None:
        """Draw and record the cells, unless they are there."""
        refuse_held_back(laws)
        if not (self._cells / "manifest.json").is_file():
            design = Design(cases=cases, seed=seed, laws=laws)
            make_cases(self._cells, self._answers, design, jobs=jobs)
        refuse_held_back(self._manifest.get("laws", [0]))

    @property
    def names(self) -> list[str]:
        """All cells."""
        return list(self._manifest["cases"])

    @property
    def origin(self) -> dict[str, Any]:
        """Seed and laws of the cells."""
        return {"seed": self._secret["seed"], "laws": self._manifest.get("laws", [0])}

    def truth(self, name: str) -> Truth:
        """What was done to a cell."""
        secret = self._secret["cases"][name]
        effects = tuple(secret["effects"])
        relatives = relatives_of(effects[0]) if secret["kind"] == "effect" else frozenset()
        return Truth(secret["kind"], effects, relatives)

    def investigate(self, name: str, budget: int, narrow: bool) -> Study:
        """Put on the table what may explain a cell."""
        twin = PianoTwin([read_bag(self._cells / name)])
        if narrow:
            twin.effects = tuple(map(narrowed, twin.effects))
        return investigate(twin, twin.blocks, Budget(budget), options=prior_options())

    @property
    def _cells(self) -> Path:
        return self.keep / "cases"

    @property
    def _answers(self) -> Path:
        return self.keep / "answers.json"

    @cached_property
    def _manifest(self) -> dict[str, Any]:
        return dict(read_manifest(self._cells))

    @cached_property
    def _secret(self) -> dict[str, Any]:
        return dict(json.loads(self._answers.read_text(encoding="utf-8")))


def refuse_held_back(laws: Iterable[int]) -> None:
    """Nothing may be learned from the law that blind checks are kept for."""
    if HELD_BACK in laws:
        raise SystemExit(f"law {HELD_BACK} of the plant is held back: nothing is developed with it")


def narrowed(effect: Effect) -> Effect:
    """An effect that has nothing but its size to fit; the rest stays as it is set."""
    sizes = dict.fromkeys(s[effect.magnitude] for s in effect.starts if effect.magnitude in s)
    own = tuple(p for p in effect.parameters if p.name == effect.magnitude)
    starts = [{effect.magnitude: size} for size in sizes] or [{}]
    return replace(effect, parameters=own, starts=starts)
