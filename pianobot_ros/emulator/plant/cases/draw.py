"""Draws emulated cells at random: for blind checks and for the demo, where one effect is
withheld.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.emulator.plant.cases.case import PARAMETERS, Case
from pianobot_ros.emulator.plant.cases.effects import EFFECTS
from pianobot_ros.emulator.plant.laws.table import LAW_COUNT, law_count

__all__ = ["KINDS", "allowed", "draw_case"]

KINDS = ("effect", "two", "none", "parameters", "unknown")
"""One effect of the library, two of them in different stages, nothing, wrong parameters only, one
left out of the library.
"""


def draw_case(
    seed: int,
    kind: str = "effect",
    *,
    magnitude: tuple[float, float] = (1.0, 10.0),
    parameter_error: float = 0.2,
    names: Sequence[str] | None = None,
    laws: Sequence[int] = (0,),
) -> Case:
    """A cell drawn by ``seed``.

    ``magnitude`` bounds the strength (logarithmically uniform, units of the repeatability floor);
    ``parameter_error`` the relative error of each parameter (uniform; none for the kind ``none``);
    ``names`` limits the effects; ``laws`` are those that an effect of the library may act by (which
    one is drawn apart, so that all else is the same for any ``laws``). The case's own seed, for
    noise and repeatability, is drawn too. Raises :class:`ConfigError` for an unknown kind or
    effect.
    """
    if kind not in KINDS:
        raise ConfigError(unknown_name("kind of case", kind, KINDS))
    if not 0 < magnitude[0] <= magnitude[1]:
        raise ConfigError(
            f"magnitudes from {magnitude[0]:g} to {magnitude[1]:g} are no range: LOW must be above"
            " 0, HIGH not below it"
        )
    for name in names or ():
        if name not in EFFECTS:
            raise ConfigError(unknown_name("effect", name, EFFECTS))
    random = np.random.default_rng([seed, 0xCE11])
    pool = [
        e
        for e in EFFECTS.values()
        if e.in_library != (kind == "unknown") and (not names or e.name in names)
    ]
    count = {"effect": 1, "unknown": 1, "two": 2}.get(kind, 0)
    chosen: list[str] = []
    while len(chosen) < count:
        free = [e for e in pool if all(e.stage != EFFECTS[name].stage for name in chosen)]
        if not free:
            raise ConfigError(
                "these names leave no two effects in different stages: allow more effects"
            )
        chosen.append(free[int(random.integers(len(free)))].name)
    low, high = np.log(magnitude)
    effects = {name: float(np.exp(random.uniform(low, high))) for name in chosen}
    errors = {
        name: 1.0 + float(random.uniform(-parameter_error, parameter_error)) for name in PARAMETERS
    }
    picked = np.random.default_rng([seed, 0x1A35])
    acting = {name: int(picked.choice(allowed(name, laws))) for name in chosen}
    return Case(
        effects,
        {} if kind == "none" else errors,
        seed=int(random.integers(2**31)),
        laws=acting,
    )


def allowed(name: str, laws: Sequence[int]) -> list[int]:
    """Those of ``laws`` that the effect ``name`` has; law 0 for one that has no other."""
    if not laws or any(law not in range(LAW_COUNT) for law in laws):
        raise ConfigError(f"laws {list(laws)}: give some of 0, 1, 2 and 3")
    return sorted(law for law in set(laws) if law < law_count(name)) or [0]
