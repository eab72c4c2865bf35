"""Hidden cells for ``benchmarks/identify.py``: everything off by up to 20 %, and in every second
cell one effect that the model lacks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import parse_phrase, plan_score
from pianobot_ros.emulator.plant.cases.case import PARAMETERS
from pianobot_ros.emulator.plant.cases.effects import EFFECTS
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
from pianobot_ros.piano.identify.cell.answer import CellAnswer, err_of, identify_cell
from pianobot_ros.piano.identify.cell.cell_fit import CellProblem
from pianobot_ros.piano.identify.cell.vacuum import identify_vacuum
from pianobot_ros.piano.identify.stiffness import optimize_stiffness
from pianobot_ros.piano.identify.takes.objective import Objective
from pianobot_ros.piano.identify.takes.take import Take, takes_from_recording
from pianobot_ros.piano.twin.reduced.strike_geometry import stiffness_of

__all__ = ["KINDS", "draw", "measure", "summary", "tolerances"]

OFF = 0.2  # largest relative error of a parameter
FLOORS = (3.0, 10.0)  # magnitude of the effect, log-uniform
SOFT = (0.05, 0.5)  # N m/deg: hidden stiffness of the two-note strikes, log-uniform
VACUUM = -50e3
TWO_NOTES = (
    "strikes:\n"
    "  - {notes: {thumb: 64, middle: 68}, speed: 0.15, depth: 0.014, hold: 0.4, note_length: 2.5,"
    " pressure: -50000}\n"
    "  - {notes: {thumb: 64, middle: 68}, speed: 0.22, depth: 0.016, hold: 0.25, note_length: 2.5,"
    " pressure: -50000}\n"
)
"""Thumb on E, middle finger on G sharp, T_N = 2.5 s: the first is fitted, the second predicted."""
KINDS = ("only k unknown", "everything unknown", "one effect on top")


def draw(seed: int, number: int) -> dict[str, Any]:
    """A hidden cell: factors of its parameters, its effect (every second has one), its noise."""
    random = np.random.default_rng([seed, number])
    errors = {name: float(random.uniform(-OFF, OFF)) for name in PARAMETERS}
    name = str(random.choice(sorted(EFFECTS)))
    size = float(np.exp(random.uniform(*np.log(FLOORS))))
    return {
        "number": number,
        "errors": errors,
        "effects": {name: size} if number % 2 else {},
        "noise": int(random.integers(2**31)),
        "set": int(random.integers(2**31)),
        "soft": float(np.exp(random.uniform(*np.log(SOFT)))) * 180 / np.pi,
    }


def measure(cell: dict[str, Any], *, two_notes: bool = True) -> dict[str, Any]:
    """Stiffness levels and parameters of 40 strikes, and the paper's two notes before and after."""
    begun = time.process_time()
    row: dict[str, Any] = {**cell, "levels": [], "known": [], "two_notes": []}
    record = simulate_cell(
        standard_strikes(cell["set"], 40),
        effects=cell["effects"],
        parameter_errors=cell["errors"],
        seed=cell["noise"],
        encoder=True,
    )
    try:
        curve = identify_vacuum(takes_from_recording(record))
    except PianobotError as error:
        row["refused"] = str(error)
    else:
        for level in curve.levels:
            if level.branch == "all":
                truth = (1 + cell["errors"]["joint_stiffness"]) * float(
                    stiffness_of(level.pressure)
                )
                row["levels"].append(
                    {
                        **_interval(truth, level.stiffness, level.low, level.high),
                        "pressure": level.pressure,
                        "identifiable": level.identifiable,
                    }
                )
        for known in curve.known:
            if known.name in PARAMETERS:
                row["known"].append(
                    {
                        "name": known.name,
                        "identifiable": known.identifiable,
                        **_interval(
                            1 + cell["errors"][known.name], known.value, known.low, known.high
                        ),
                    }
                )
    for kind in (KINDS[0], KINDS[1 + cell["number"] % 2]) if two_notes else ():
        row["two_notes"].append(_two_notes(cell, kind))
    row["seconds"] = time.process_time() - begun
    return row


def tolerances(seeds: Sequence[int], count: int) -> dict[str, tuple[float, int]]:
    """By parameter what the model's own simplicity moves an estimate by (standard deviation on the
    prior's scale), from so many cells without effect of each seed, and of how many values.

    It is what the errors have beyond the covariance of their own fits, by maximum likelihood: an
    error as a whole would count what the fit knows of its noise and of missing effects twice.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for cell in (draw(seed, 2 * number) for seed in seeds for number in range(count)):
        record = simulate_cell(
            standard_strikes(cell["set"], 40),
            parameter_errors=cell["errors"],
            seed=cell["noise"],
            encoder=True,
        )
        answer = identify_cell(takes_from_recording(record))
        problem, joint = answer.problem, answer.joint
        own = np.diag(joint.covariance) - problem.tolerance**2
        for prior, x, variance in zip(problem.parameters, joint.x, own, strict=True):
            name = prior.name.split(" ")[0]
            if name in cell["errors"]:
                error = float(np.log(prior.value(float(x)) / (1 + cell["errors"][name])))
                found.setdefault(name, []).append((error, float(variance) * prior.sd**2))
    return {n: (_beyond(np.array(v)), len(v)) for n, v in found.items()}


def _beyond(values: Array) -> float:
    """Standard deviation that errors (n, 0) have beside their own variances (n, 1)."""

    def unlikely(sd: float) -> float:
        whole = values[:, 1] + sd**2
        return float(np.sum(np.log(whole) + values[:, 0] ** 2 / whole))

    return float(minimize_scalar(unlikely, bounds=(0.0, 0.3), method="bounded").x)


def _interval(truth: float, value: float, low: float, high: float) -> dict[str, float]:
    return {
        "truth": truth,
        "value": value,
        "low": low,
        "high": high,
        "error": abs(value / truth - 1),
    }


def _two_notes(cell: dict[str, Any], kind: str) -> dict[str, Any]:
    """The paper's experiment on this cell: Err and k by its procedure and with everything
    estimated.
    """
    errors = {"joint_stiffness": cell["soft"] / float(stiffness_of(VACUUM)) - 1}
    if kind != KINDS[0]:
        errors = {**cell["errors"], **errors}
    record: Recording = simulate_cell(
        plan_score(parse_phrase(TWO_NOTES)),
        effects=cell["effects"] if kind == KINDS[2] else {},
        parameter_errors=errors,
        seed=cell["noise"] + 1,
        encoder=True,
    )
    takes = takes_from_recording(record)
    middle = float(np.median([t.strike.start for t in takes]))
    first = [t for t in takes if t.strike.start <= middle - 0.5]
    second = [t for t in takes if t.strike.start > middle - 0.5]
    row: dict[str, Any] = {"kind": kind, "truth": cell["soft"]}
    if any(t.reference is None for t in takes):
        return {**row, "silent": True}
    paper = optimize_stiffness(first, iterations=30, seed=cell["number"])
    row["paper"] = {
        "err": paper.err,
        "held": _played(second, paper.stiffness),
        "k": paper.stiffness,
        "k_error": abs(paper.stiffness / cell["soft"] - 1),
    }
    joint = identify_cell(first)
    known = joint.levels[0]
    row["joint"] = {
        "err": joint.err_after,
        "held": _predicted(joint, second),
        "k": known.value,
        "k_error": abs(known.value / cell["soft"] - 1),
        "identifiable": known.identifiable,
        "holds": known.low <= cell["soft"] <= known.high,
    }
    return row


def _played(takes: Sequence[Take], stiffness: float) -> float:
    found = [t.keystroke(t.stroke(stiffness)) for t in takes]
    return Objective().err(takes, found)


def _predicted(answer: CellAnswer, takes: Sequence[Take]) -> float:
    problem = CellProblem(takes)
    known = dict(zip(answer.problem.names, answer.joint.x, strict=True))
    known |= {problem.names[0]: float(answer.joint.x[0])}
    x = np.array([known.get(n, 0.0) for n in problem.names])
    signatures = [p.name for p in answer.problem.missing]
    effects = dict(zip(signatures, answer.joint.effects, strict=True))
    return err_of(problem, x, np.array([effects.get(p.name, 0.0) for p in problem.missing]))


def _held(level: dict[str, Any]) -> bool:
    return bool(level["low"] <= level["truth"] <= level["high"])


def _by_cells(held: Sequence[Sequence[bool]], draws: int = 2000) -> list[float] | None:
    """5th and 95th percentile of the share held, whole cells drawn again: their levels hang
    together.
    """
    cells = [h for h in held if h]
    if not cells:
        return None
    random = np.random.default_rng(0)
    hits, counts = np.array([sum(h) for h in cells]), np.array([len(h) for h in cells])
    picked = random.integers(len(cells), size=(draws, len(cells)))
    shares = hits[picked].sum(axis=1) / counts[picked].sum(axis=1)
    return [float(x) for x in np.percentile(shares, [5, 95])]


def _missed(rows: Sequence[dict[str, Any]]) -> dict[str, list[int]]:
    """By effect ("" for none) how many levels are not held, and of how many."""
    found: dict[str, list[int]] = {}
    for r in rows:
        for x in r["levels"]:
            count = found.setdefault(next(iter(r["effects"]), ""), [0, 0])
            count[0] += not _held(x)
            count[1] += 1
    return {n: c for n, c in sorted(found.items(), key=lambda i: -i[1][0]) if c[0]}


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Coverage of the intervals, errors of the stiffness, and the three rows of Err."""
    out: dict[str, Any] = {"cells": len(rows), "refused": sum("refused" in r for r in rows)}

    def share(values: list[bool]) -> float:
        return float(np.mean(values)) if values else float("nan")

    def median(values: list[float]) -> float:
        return float(np.median(values)) if values else float("nan")

    kinds: dict[str, Callable[[dict[str, Any]], bool]] = {
        "all cells": lambda _: True,
        "without effect": lambda r: not r["effects"],
        "one effect": lambda r: bool(r["effects"]),
    }
    for kind, chosen in kinds.items():
        levels = [x for r in rows if chosen(r) for x in r["levels"]]
        sure = [x for x in levels if x["identifiable"]]
        out[kind] = {
            "levels": len(levels),
            "identifiable": share([x["identifiable"] for x in levels]),
            "coverage": share([_held(x) for x in levels]),
            "coverage_90": _by_cells([[_held(x) for x in r["levels"]] for r in rows if chosen(r)]),
            "error": median([x["error"] for x in sure]),
            "error_p90": float(np.percentile([x["error"] for x in sure], 90)) if sure else None,
            "parameters": {
                name: share(
                    [_held(x) for r in rows if chosen(r) for x in r["known"] if x["name"] == name]
                )
                for name in PARAMETERS[1:]
            },
        }
    out["missed"] = _missed(rows)
    out["two_notes"] = {}
    for kind in KINDS:
        runs = [x for r in rows for x in r["two_notes"] if x["kind"] == kind and "paper" in x]
        if not runs:
            continue
        out["two_notes"][kind] = (
            {"runs": len(runs)}
            | {
                how: {
                    name: [
                        median([x[how][name] for x in runs]),
                        float(np.nanpercentile([x[how][name] for x in runs], 90)),
                    ]
                    for name in ("err", "held", "k_error")
                }
                for how in ("paper", "joint")
            }
            | {
                "holds": share([x["joint"]["holds"] for x in runs]),
                "identifiable": share([x["joint"]["identifiable"] for x in runs]),
            }
        )
    return out
