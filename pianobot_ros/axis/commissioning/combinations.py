"""Combinations of effects that are worth trying because a regression finds them together.

Friction and gravity of a joint hide each other: looked for one after the other, the first of the
two takes inertia and damping along, and the second does not bring them back.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from pianobot_ros.axis.commissioning.added_mass import payload_load
from pianobot_ros.axis.commissioning.around.arm import arm_load
from pianobot_ros.axis.commissioning.commissioned import Commissioned
from pianobot_ros.axis.commissioning.regression import rippling
from pianobot_ros.axis.commissioning.twisting import twisting

__all__ = ["combinations", "usual"]


def combinations(
    joint: Commissioned, there: Collection[str]
) -> Iterator[Mapping[str, Mapping[str, float]]]:
    """Dry friction and gravity as commissioning found them, {effect: {parameter: value}}, with the
    gravity that other joints turn where there is any; then with them a spring or a gap that a twist
    shows, other laws of dry friction of the same size, a stop, and cogging. Only effects that are
    `there`.
    """
    arm, plain = (_of(usual(joint, arm=turned), there) for turned in (True, False))
    load = payload_load(joint) if "payload" in there else {}
    yield from ({"payload": load} for _ in range(1 if load else 0))
    if "command_delay" in joint.beside and "command_delay" in there:
        late = {"command_delay": {"command_delay": joint.beside["command_delay"]}}
        yield from (late, {**late, **plain})
    yield from (own for own in (arm, plain if plain != arm else {}) if own)
    for between in twisting(joint.logs, there):
        yield {**(arm or plain), **between}
    yield from _other_friction(joint, arm or plain, there)
    if joint.scales.stop and "end_stop" in there:
        pressed = {"end_stop": {n: joint.scales.stop[n] for n in ("end_stop", "end_stop_angle")}}
        yield from ({**loads, **pressed} for loads in ([{}, plain] if plain else [{}]))
    ripple = rippling(joint.logs, joint.scales.waves) if "cogging" in there else {}
    if ripple:  # with the values beside which it was found: refitting hides it in the inertia
        own = {"cogging": {**joint.nominal, **ripple}}
        yield own
        if plain:
            yield {**plain, **own}


def usual(joint: Commissioned, *, arm: bool = True) -> dict[str, dict[str, float]]:
    """Dry friction and gravity as commissioning found them, as effects that the twin has; what is
    small beside the efforts is left out. With `arm` gravity follows the joints that turn it.
    """
    least = 0.02 * joint.scales.effort
    turns = joint.unit == "rad" and not joint.has("model")
    out: dict[str, dict[str, float]] = {}
    found = {}
    if arm and joint.others.arm and turns:
        found = arm_load(joint.logs, joint.others.arm)
    if found and found["arm_gravity"] > least:
        if found["coulomb"] > least:
            out["coulomb"] = {"coulomb": found["coulomb"]}
        out["arm_gravity"] = {n: v for n, v in found.items() if n.startswith("arm_")}
        return out
    if joint.beside.get("coulomb", 0.0) > least:
        out["coulomb"] = {"coulomb": joint.beside["coulomb"]}
    if turns and joint.beside.get("gravity", 0.0) > least:
        out["gravity"] = {n: joint.beside[n] for n in ("gravity", "gravity_angle")}
    return out


def _of(
    found: Mapping[str, dict[str, float]], there: Collection[str]
) -> dict[str, dict[str, float]]:
    return {n: own for n, own in found.items() if n in there}


def _other_friction(
    joint: Commissioned, found: Mapping[str, Mapping[str, float]], there: Collection[str]
) -> Iterator[Mapping[str, Mapping[str, float]]]:
    if "coulomb" not in found:
        return
    rest = {n: own for n, own in found.items() if n != "coulomb"}
    size = found["coulomb"]["coulomb"]
    for name, own in {
        "stribeck": {
            "stribeck_rise": 0.3 * size,
            "stribeck_level": 0.8 * size,
            "stribeck_speed": 0.3 * joint.scales.speed,
        },
        "load_friction": {"load_friction": 0.1, "load_friction_level": 0.8 * size},
        "asymmetric_friction": {"friction_asymmetry": 0.05 * size, "asymmetric_level": size},
        "hysteresis": {"hysteresis": size},
    }.items():
        if name in there:
            yield {name: own, **rest}
