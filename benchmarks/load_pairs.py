"""Load pairs: a mass is added to a joint of the independent plant; is it named, and how large?

    python benchmarks/load_pairs.py [--pairs 12] [--first 0] [--seconds 24]

Each pair is a log without and one with the mass, with other motions, friction and gravity of the
plant's own laws, and effort in N m. The controller's gains stay what they were. Printed for each
pair: the answer, and added gravity (N m) and inertia (kg m²), true and found with 95 % interval.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.axis.diagnosis.joint import Finding, diagnose_joint
from pianobot_ros.axis.log import Log
from pianobot_ros.emulator.plant.axis_plant import Axis, PlantLog, record, trajectory

KINDS = ("sines", "moves", "random")
WITHIN = 0.1
"""Share within which the size is asked for."""


@dataclass(frozen=True)
class Pair:
    """A log before and after a mass was added, and its gravity (N m) and inertia (kg m²)."""

    before: Log
    after: Log
    gravity: float
    inertia: float


def pair(seed: int, seconds: float) -> Pair:
    """Draw a joint of 0.05 to 0.5 kg m² and add a mass that has 0.3 to 1.5 times its inertia."""
    rng = np.random.default_rng([seed, 5])
    u = rng.uniform
    inertia = float(np.exp(u(math.log(0.05), math.log(0.5))))
    bare = Axis(inertia, inertia * u(0.5, 3.0), u(15, 30), u(0.6, 1.1), u(0, 0.9), u(0, 3))
    arm = u(0.3, 0.6)
    mass = u(0.3, 1.5) * inertia / arm**2
    added = mass * 9.81 * arm
    torque = 8.0 * inertia
    own = {"coulomb": {"level": torque * u(0.1, 0.6)}}
    weight, hangs = u(0.5, 2.0) * added, u(-1, 1)
    kinds = [str(rng.choice(KINDS)) for _ in range(2)]
    total = inertia + mass * arm**2
    soft = math.sqrt(inertia / total)  # of the loop's stiffness, which stays what it was
    loaded = replace(
        bare, inertia=total, bandwidth=bare.bandwidth * soft, damping=bare.damping * soft
    )
    made = []
    for axis, kind, more in ((bare, kinds[0], 0.0), (loaded, kinds[1], added)):
        field = {"gravity": {"grav": weight + more, "grav_angle": hangs}}
        held = record(axis, trajectory(kind, seconds, rng, 100.0), 100.0, rng, {**own, **field})
        made.append(as_log(held, kind))
    return Pair(made[0], made[1], added, mass * arm**2)


def as_log(held: PlantLog, kind: str) -> Log:
    """The plant's log with its current as the effort, N m."""
    return Log(
        kind, held.t, held.command, held.position, held.velocity, held.current, "Nm", (), "j"
    )


def errors(found: Finding, truth: Pair) -> tuple[list[str], list[float], list[bool]]:
    """Texts, relative errors and whether the intervals hold the truth, of gravity and inertia."""
    effect = next((e for e in found.diagnosis.effects if e.name == "payload"), None)
    if effect is None:
        return [], [], []
    texts, off, held = [], [], []
    for name, true in (("payload_gravity", truth.gravity), ("payload_inertia", truth.inertia)):
        p = effect.parameters[name]
        texts.append(f"{true:7.3f} {p.value:7.3f} ({p.low:.3f} to {p.high:.3f})")
        off.append(p.value / true - 1.0)
        held.append(p.low <= true <= p.high)
    return texts, off, held


def main() -> None:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=24.0)
    args = parser.parse_args()
    off: list[list[float]] = []
    held: list[list[bool]] = []
    for seed in range(args.first, args.first + args.pairs):
        truth = pair(seed, args.seconds)
        started = time.process_time()
        found = diagnose_joint([truth.after], reference=[truth.before])
        texts, own, inside = errors(found, truth)
        named = "+".join(e.name for e in found.diagnosis.effects) or found.diagnosis.verdict
        print(
            f"{seed:3d} {truth.before.name + ', ' + truth.after.name:<15} {named:<24}"
            f" {' | '.join(texts)}  {time.process_time() - started:.1f} s",
            flush=True,
        )
        if own:
            off.append(own)
            held.append(inside)
    print(f"named in {len(off)} of {args.pairs}")
    for k, what in enumerate(("gravity", "inertia")):
        if off:
            sizes = np.abs([o[k] for o in off])
            print(
                f"{what}: within {100 * WITHIN:.0f} % in {int(np.sum(sizes < WITHIN))}, median"
                f" error {100 * float(np.median(sizes)):.1f} %, interval holds the truth in"
                f" {sum(h[k] for h in held)}"
            )


if __name__ == "__main__":
    main()
