"""Combinations of effects that are worth trying because a regression finds them together.

Friction and gravity of a joint hide each other: looked for one after the other, the first of the
two takes inertia and damping along, and the second does not bring them back.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING

from pianobot_ros.axis.commission import arm_load

if TYPE_CHECKING:
    from pianobot_ros.axis.twin import ServoAxis

__all__ = ["combinations"]


def combinations(axis: ServoAxis) -> Iterator[Mapping[str, Mapping[str, float]]]:
    """Dry friction and gravity as commissioning found them, {effect: {parameter: value}}, with the
    gravity that other joints turn where there is any; then other laws of dry friction of the same
    size.
    """
    there = {e.name for e in axis.effects}
    usual = {n: own for n, own in axis.usual().items() if n in there}
    arm = _with_arm(axis, there) if "arm_gravity" in there else {}
    yield from (own for own in (arm, usual) if own)
    yield from _other_friction(axis, arm or usual, there)


def _with_arm(axis: ServoAxis, there: Collection[str]) -> dict[str, dict[str, float]]:
    """Dry friction and gravity with the angles of other joints, as far as they are of any size."""
    found = arm_load(axis.logs, axis.others.arm)
    least = 0.02 * axis.scales.effort
    out: dict[str, dict[str, float]] = {}
    if found and "coulomb" in there and found["coulomb"] > least:
        out["coulomb"] = {"coulomb": found["coulomb"]}
    if found and found["arm_gravity"] > least:
        out["arm_gravity"] = {n: v for n, v in found.items() if n != "coulomb"}
    return out if "arm_gravity" in out else {}


def _other_friction(
    axis: ServoAxis, usual: Mapping[str, Mapping[str, float]], there: Collection[str]
) -> Iterator[Mapping[str, Mapping[str, float]]]:
    if "coulomb" not in usual:
        return
    rest = {n: own for n, own in usual.items() if n != "coulomb"}
    size = usual["coulomb"]["coulomb"]
    for name, own in {
        "stribeck": {
            "stribeck_rise": 0.3 * size,
            "stribeck_level": 0.8 * size,
            "stribeck_speed": 0.3 * axis.scales.speed,
        },
        "load_friction": {"load_friction": 0.1, "load_friction_level": 0.8 * size},
        "asymmetric_friction": {"friction_asymmetry": 0.05 * size, "asymmetric_level": size},
        "hysteresis": {"hysteresis": size},
    }.items():
        if name in there:
            yield {name: own, **rest}
