"""From CSV logs of one joint to a verdict: `python -m examples.servo_axis.diagnose LOG.csv [LOG2.csv ...]`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from examples.servo_axis.experiments import candidates
from examples.servo_axis.log import Log, read_csv
from examples.servo_axis.segment import blocks_of, clean
from examples.servo_axis.twin import NUISANCES, ServoAxis
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.gap import Block, Diagnosis, GapError, Options, diagnose
from pianobot_ros.gap.types import Array

__all__ = ["diagnose_logs", "main"]

OPTIONS = Options(tolerance=0.02, timing_tolerance=0.1)


def diagnose_logs(
    logs: Sequence[Log],
    *,
    nominal: Mapping[str, float] | None = None,
    known: Mapping[str, Mapping[str, float]] | None = None,
    reference: Sequence[Log] = (),
    seed: int = 0,
    budget: float = 60.0,
    jobs: int = 1,
    options: Options | None = None,
) -> Diagnosis:
    """Diagnose logs of one joint against the axis twin.

    `nominal` are believed parameter values (inertia, viscous, bandwidth, damping, feedforward, integral, effort_offset);
    without them the twin is commissioned from the logs. `known` are effects the twin already has: {name: {parameter: value}}.
    With `reference` logs of the same joint (another day, no payload) the twin is first identified on those, structure
    included, and the question becomes what changed since.
    """
    if not logs:
        raise GapError("give at least one log")
    trust, missed = 0.2, dict[str, float]()
    if reference:
        was, blocks, _ = _prepared(reference, nominal, known)
        before = diagnose(was, blocks, seed=seed, budget=0.5 * budget, jobs=jobs, options=options or OPTIONS)
        nominal = {n: p.value for n, p in before.parameters.items() if n in NUISANCES}
        known, trust, budget = {**(known or {}), **_found(before)}, 0.05, max(budget - before.runtime_s, 0.4 * budget)
        missed = _missed(was, blocks, before)
    twin, blocks, notes = _prepared(logs, nominal, known, trust=trust, reference=bool(reference), missed=missed)
    if reference:
        notes.append(f"the reference already has: {', '.join(known or {}) or 'no structural effect'}")
    result = diagnose(
        twin, blocks, seed=seed, budget=budget, jobs=jobs, options=options or OPTIONS, experiments=candidates(twin)
    )
    return replace(result, warnings=(*result.warnings, *notes))


def _prepared(logs: Sequence[Log], nominal: Mapping[str, float] | None, known: Mapping[str, Mapping[str, float]] | None,
              **how: Any) -> tuple[ServoAxis, list[Block], list[str]]:  # fmt: skip
    """Twin and blocks of some logs, and what there is to say about how they were read."""
    cleaned = [clean(log) for log in logs]
    if all(c.command is None and c.effort is None for c in cleaned):
        raise GapError("a log with position alone says nothing about a twin: a command or an effort column is needed "
                       "(--columns command=HEADER or effort=HEADER)")  # fmt: skip
    blocks: list[Block] = []
    notes: list[str] = []
    for c in cleaned:
        made, said = blocks_of(c, max(8, 40 // len(cleaned)))
        blocks += made
        notes += [f"{c.log.name}: {said}", *(f"{c.log.name}: {n}" for n in c.log.notes)]
        missing = [r for r in ("command", "velocity", "effort") if getattr(c.log, r) is None]
        if missing:
            notes.append(f"{c.log.name}: no {', '.join(missing)} column, so effects that show only there stay unseen")
    return ServoAxis(cleaned, nominal, known, **how), blocks, notes


def _found(before: Diagnosis) -> dict[str, dict[str, float]]:
    """Structure that describes the reference best, even where it was not sure enough to be named."""
    if before.verdict in ("none", "parameters") or not before.hypotheses:
        return {}
    best = before.hypotheses[0]
    own = {n: v for n, v in best.values.items() if n not in before.parameters}
    return dict.fromkeys(best.effects, own)


def _missed(was: ServoAxis, blocks: Sequence[Block], before: Diagnosis) -> dict[str, float]:
    """RMS that the identified twin leaves of each observable of its own reference: what is smaller is no change."""
    found = _found(before)
    values = {n: p.value for n, p in before.parameters.items()}
    for own in found.values():
        values.update(own)
    squares: dict[str, list[Array]] = {}
    for block, prediction in zip(blocks, was.simulate(blocks, values, tuple(found)), strict=True):
        for o in was.observables:
            if o.signal in block.outputs and o.name in prediction:
                squares.setdefault(o.name, []).append((np.asarray(prediction[o.name]) - block.outputs[o.signal].y) ** 2)
    return {name: float(np.sqrt(np.nanmean(np.concatenate(s)))) for name, s in squares.items()}


def _pairs(items: Sequence[str], what: str) -> dict[str, str]:
    out = {}
    for item in items:
        name, equals, value = item.partition("=")
        if not equals:
            raise GapError(f"{what} wants NAME=VALUE, got {item!r}")
        out[name] = value
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit code (2 for bad input)."""
    parser = argparse.ArgumentParser(prog="python -m examples.servo_axis.diagnose", description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument(
        "--columns", nargs="*", default=[], metavar="ROLE=HEADER", help="time, command, position, velocity, effort"
    )
    parser.add_argument(
        "--units", nargs="*", default=[], metavar="ROLE=UNIT", help="e.g. position=deg effort=mA time=ms"
    )
    parser.add_argument(
        "--nominal", nargs="*", default=[], metavar="NAME=VALUE", help="the twin's believed parameter values"
    )
    parser.add_argument("--reference", nargs="*", default=[], type=Path, help="logs of the same joint as it was before")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--budget", type=float, default=60.0, help="seconds")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="print diagnosis.json")
    parser.add_argument("--report", type=Path, help="write a self-contained HTML report")
    args = parser.parse_args(argv)
    try:
        columns, units = _pairs(args.columns, "--columns"), _pairs(args.units, "--units")
        nominal = {k: float(v) for k, v in _pairs(args.nominal, "--nominal").items()}
        logs = [read_csv(path, columns, units) for path in args.logs]
        reference = [read_csv(path, columns, units) for path in args.reference]
        result = diagnose_logs(
            logs, nominal=nominal or None, reference=reference, seed=args.seed, budget=args.budget, jobs=args.jobs
        )
        if args.report:
            from pianobot_ros.report import write_report

            write_report(result, args.report)
    except (PianobotError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if args.json:
        print(json.dumps(result.to_json(), indent=1))
    else:
        print(result.sentence)
        for c in result.candidates[:6]:
            print(f"  {100 * c.probability:5.1f} %  {c.name}" + (f"  ({c.stage})" if c.stage else ""))
        for e in result.effects:
            for name, p in e.parameters.items():
                print(f"  {name} = {p.value:.4g} ({p.low:.4g} to {p.high:.4g}) {p.unit}")
        for warning in result.warnings:
            print(f"  note: {warning}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
