"""Joints of the emulated servo axis with known causes, and their studies."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from real_logs import FAMILIES, RELATIVES, names_of
from servo_axis_blind import BASE
from servo_axis_blind import make as made

from calibration.views import Truth
from pianobot_ros.axis.diagnosis.joint import OPTIONS, prepared
from pianobot_ros.cell.numbers.learned import SERVO_AXIS
from pianobot_ros.gap import Options
from pianobot_ros.gap.engine import investigate
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.search.study import Study

__all__ = ["AxisJoints"]


@dataclass
class AxisJoints:
    """Joints of the development set, drawn again whenever one is asked for; only studies are kept
    in `keep`.
    """

    keep: Path
    file: str = SERVO_AXIS
    plant: str = "pianobot_ros.emulator.plant.axis_plant"
    dry: bool = False
    """Whether each joint has dry friction beside its cause."""
    names: list[str] = field(default_factory=list)

    @property
    def options(self) -> Options:
        """The settings before anything is learned."""
        return OPTIONS

    def make(self, cases: int, seed: int, laws: tuple[int, ...], jobs: int) -> None:
        """The joints `seed` to `seed + cases` of the development set; the axis has one law of each
        family.
        """
        self.names = [str(BASE["dev"] + seed + k) for k in range(cases)]

    @property
    def origin(self) -> dict[str, Any]:
        """Seed and laws of the joints."""
        return {"seed": int(self.names[0]), "laws": [0]}

    def truth(self, name: str) -> Truth:
        """What was done to a joint."""
        case = made(int(name), self.dry)
        relatives = relatives_of(case.truth[0]) if case.kind == "effect" else frozenset()
        return Truth(case.kind, case.truth, relatives)

    def investigate(self, name: str, budget: int, narrow: bool) -> Study:
        """Put on the table what may explain a joint."""
        if narrow:
            raise SystemExit("--narrow is for the piano cell: the axis' laws have few parameters")
        case = made(int(name), self.dry)
        twin, blocks, _ = prepared(case.logs, case.nominal, None)
        return investigate(twin, blocks, Budget(budget), options=OPTIONS)


def relatives_of(effect: str) -> frozenset[str]:
    """Effects that leave much the same trace: of its families, and what may be named for them."""
    own = [f for f, members in FAMILIES.items() if effect in members]
    families = [*own, *(r for f in own for r in RELATIVES.get(f, ()))]
    return frozenset(n for f in families for n in names_of(f)) - {effect}
