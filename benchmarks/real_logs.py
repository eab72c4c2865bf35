"""Logs of real machines through the axis diagnosis: what is known of each, and what it answers.

    python benchmarks/real_logs.py DIR [--without FAMILY] [--budget BLOCKS] [--only WORD]
    python benchmarks/real_logs.py DIR --held-out [--first]

DIR holds `so101` and `simple_pendulum` (see docs/results/real-logs.md); the logs are not part of
the repository. The first form diagnoses each log as a stranger would. `--without` takes a family
of effects out of the library (`each`: one after the other), on the logs where it is known:
*unknown* or a declared relative is right. The second fits each joint of the arm on eight motions
and predicts the others from their commands alone; with `--first` by the commissioned twin with its
dry friction, before any diagnosis.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from servo_axis_blind import KNOWN

from pianobot_ros.axis.diagnosis.joint import Finding, diagnose_joint
from pianobot_ros.axis.diagnosis.lines import answer
from pianobot_ros.axis.diagnosis.robot import logs_by_joint
from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading import read_recordings
from pianobot_ros.axis.signals.cleaning import Clean, clean
from pianobot_ros.axis.twin.fitted import followed, predict
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.cli.analysis.axis import settings
from pianobot_ros.gap import GapError, Options
from pianobot_ros.gap.problem.budget import BLOCKS

FAMILIES = {
    "friction": (
        "coulomb",
        "stribeck",
        "load_friction",
        "asymmetric_friction",
        "hysteresis",
        "concave_viscous",
        "warming",
    ),
    "gravity": ("gravity", "arm_gravity"),
    "backlash": ("backlash", "deadband"),
    "limit": ("torque_limit", "speed_limit"),
    "payload": ("payload",),
    "delay": ("command_delay", "command_lag", "sensor_latency", "clock_skew"),
}
RELATIVES = {"friction": ("backlash",), "gravity": ("friction",), "limit": ("friction",)}
"""Families that may be named where one is taken out: they leave much the same trace."""
FITTED = (
    "backlash_detection",
    "chirp_sweep",
    "friction_gravity",
    "large_amplitude",
    "multisine",
    "random_waypoints",
    "single_joint_elbow",
    "step_response",
)
"""Motions of the arm that are fitted; the others are predicted."""


@dataclass(frozen=True)
class RealLog:
    """A log and the families of which at least one is physically known to be there."""

    paths: tuple[Path, ...]
    joint: str
    known: tuple[str, ...]
    reference: tuple[Path, ...] = ()

    @property
    def name(self) -> str:
        """Log and joint."""
        return f"{self.paths[0].name.removesuffix('.csv')[:34]} {self.joint}".strip()


def cases(folder: Path) -> Iterator[RealLog]:
    """What is known of the logs."""
    arm = folder / "so101"
    for motion, joint, known in (
        ("random_waypoints", "Rotation", ("friction", "backlash")),
        ("random_waypoints", "Elbow", ("friction", "gravity", "backlash")),
        ("friction_gravity", "Wrist_Roll", ("friction", "backlash")),
        ("repetitive_motion", "Pitch", ("friction", "gravity", "backlash")),
        ("large_amplitude", "Wrist_Pitch", ("friction", "gravity", "backlash")),
    ):
        yield RealLog((arm / motion,), joint, known)
    swing = folder / "simple_pendulum"
    before = swing / "energy_shaping__data_measured.csv"
    yield RealLog((before,), "", ("gravity",))
    loaded = swing / "energy_shaping__data_measured_1kg.csv"
    yield RealLog((loaded,), "", ("payload",), (before,))
    yield RealLog((swing / "pd__system_identification__data_measured.csv",), "", ("gravity",))


def names_of(family: str) -> tuple[str, ...]:
    """Effects of a family, or the effect of that name."""
    return FAMILIES.get(family, (family,))


def options(without: str) -> Options:
    """The settings of `pianobot axis diagnose` without one family."""
    known = settings()
    if not without:
        return known
    from dataclasses import replace

    return replace(known, only=tuple(n for n in KNOWN if n not in names_of(without)))


def judged(case: RealLog, found: Finding, without: str) -> str:
    """Whether an answer fits what is known."""
    said = {e.name for e in found.diagnosis.effects}
    if said & set(names_of("delay")):
        return "WRONG"
    right = {n for f in case.known for n in names_of(f)}
    if without:
        right |= {n for f in RELATIVES.get(without, ()) for n in names_of(f)}
        right -= set(names_of(without))
    if said:
        return "right" if said & right else "WRONG"
    return "open" if not without else "right"


def each(folder: Path, budget: int, only: str) -> None:
    """Take out one family after the other, on the logs where it is known to be there."""
    for family in ("friction", "gravity", "backlash", "payload"):
        print(f"without {family}: {', '.join(names_of(family))}")
        run(folder, family, budget, only)


def run(folder: Path, without: str, budget: int, only: str) -> None:
    """Diagnose every case and print a line for each; with a family taken out, those in which it is
    known.
    """
    print(f"{'log':<46} {'known':<28} {'answer':<34} {'prob':>5} {'closed':>6} {'s':>6}  verdict")
    tally: dict[str, int] = {}
    for case in cases(folder):
        asked = not without or without in case.known
        if only not in case.name or not asked or not case.paths[0].exists():
            continue
        started = time.process_time()
        logs = logs_by_joint(read_recordings(case.paths), [case.joint])[case.joint]
        before = read_recordings(case.reference) if case.reference else []
        reference = logs_by_joint(before)[case.joint] if before else []
        found = diagnose_joint(logs, reference=reference, budget=budget, options=options(without))
        sure, what = answer(found)
        word = judged(case, found, without)
        tally[word] = tally.get(word, 0) + 1
        closed = found.diagnosis.gap.closed
        print(
            f"{case.name:<46} {' '.join(case.known):<28} {what[:34]:<34} {sure:5.2f}"
            f" {closed:6.2f} {time.process_time() - started:6.1f}  {word}",
            flush=True,
        )
    print(", ".join(f"{n} {w}" for w, n in sorted(tally.items())))


def held_out(folder: Path, budget: int, only: str) -> None:
    """Fit each joint on `FITTED`, predict the other motions, and print errors in mrad."""
    motions = sorted(d for d in (folder / "so101").iterdir() if d.is_dir())
    fit = logs_by_joint(read_recordings([d for d in motions if d.name in FITTED]))
    rest = logs_by_joint(read_recordings([d for d in motions if d.name not in FITTED]))
    pooled: list[float] = []
    for joint, logs in fit.items():
        if only not in joint:
            continue
        started = time.process_time()
        try:
            found = diagnose_joint(logs, budget=budget)
        except GapError as error:
            print(f"{joint}: {error}")
            continue
        seconds = time.process_time() - started
        errors = list(_errors(found, rest[joint]))
        pooled += errors
        print(
            f"{joint:<12} held out {1e3 * _pool(errors):5.1f} mrad over {len(errors)} motions,"
            f" {seconds:5.1f} s; predicted by {found.fitted['hypothesis']}; says"
            f" {answer(found)[1]}",
            flush=True,
        )
    print(
        f"pooled over {len(pooled)}: {1e3 * _pool(pooled):.1f} mrad,"
        f" median {1e3 * float(np.median(pooled)):.1f}"
    )


def first(folder: Path, only: str) -> None:
    """The same by first values alone: a commissioned twin with its dry friction and contact."""
    motions = sorted(d for d in (folder / "so101").iterdir() if d.is_dir())
    pooled: list[float] = []
    for joint, logs in logs_by_joint(read_recordings(motions)).items():
        if only not in joint:
            continue
        started = time.process_time()
        cleaned = list(_cleaned(logs))
        fit = [c for c in cleaned if c.log.name.split()[0] in FITTED]
        twin = ServoAxis(fit)
        p = twin.joint.vector({"coulomb": twin.joint.beside.get("coulomb", 0.0)})
        errors = [
            float(np.sqrt(np.mean((followed(c, p, twin.joint.others) - c.position)[c.valid] ** 2)))
            for c in cleaned
            if c.log.name.split()[0] not in FITTED
        ]
        pooled += errors
        stiff, damp = p[kernel.WN], p[kernel.ZETA]
        print(
            f"{joint:<12} held out {1e3 * _pool(errors):5.1f} mrad over {len(errors)} motions,"
            f" {time.process_time() - started:4.1f} s; bandwidth {stiff:.0f} rad/s, damping"
            f" {damp:.2f}, friction {1e3 * p[kernel.FC]:.0f} mrad"
            f"{', in contact now and then' if twin.joint.others.contact else ''}",
            flush=True,
        )
    print(
        f"pooled over {len(pooled)}: {1e3 * _pool(pooled):.1f} mrad,"
        f" median {1e3 * float(np.median(pooled)):.1f}"
    )


def _cleaned(logs: Sequence[Log]) -> Iterator[Clean]:
    for log in logs:
        try:
            yield clean(log)
        except GapError:
            continue  # the joint rests in this motion


def _errors(found: Finding, logs: Sequence[Log]) -> Iterator[float]:
    for log in logs:
        try:
            error = predict(found.fitted, log).position
        except GapError:
            continue  # the joint rests in this motion
        if math.isfinite(error):
            yield error


def _pool(errors: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan


def main() -> None:
    """Parse arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--without", default="", choices=["", "each", *FAMILIES])
    parser.add_argument("--budget", type=int, default=BLOCKS)
    parser.add_argument("--only", default="")
    parser.add_argument("--held-out", action="store_true")
    parser.add_argument("--first", action="store_true", help="first values only")
    args = parser.parse_args()
    if args.held_out and args.first:
        first(args.folder, args.only)
    elif args.held_out:
        held_out(args.folder, args.budget, args.only)
    elif args.without == "each":
        each(args.folder, args.budget, args.only)
    else:
        run(args.folder, args.without, args.budget, args.only)


if __name__ == "__main__":
    main()
