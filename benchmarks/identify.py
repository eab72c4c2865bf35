"""Identification over hidden cells, wanted dynamics played on the plant, and speed.

python benchmarks/identify.py [--cells 40] [--seed 0] [--output docs/results/identify] [--json]

With ``--cells 0`` dynamics, speed and their pictures alone. What a run measured replaces its
sections of ``results.json`` in the output folder, each with its own command, and README.md is
written from the whole. ``--tolerance`` measures the tolerances of ``config/priors.yaml``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from identify_cells import KINDS, draw, measure, summary, tolerances

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.keystroke import keystrokes_from_midi
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import parse_phrase, plan_score
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
from pianobot_ros.piano.identify.cell.dynamics import Played, solve, velocity_scale
from pianobot_ros.piano.identify.cell.vacuum import identify_vacuum
from pianobot_ros.piano.identify.key.key_estimate import identify_keystroke
from pianobot_ros.piano.identify.key.load_test import load_test_from_recording
from pianobot_ros.piano.identify.plots import (
    plot_dynamics,
    plot_keystroke,
    plot_stiffness,
    plot_vacuum,
)
from pianobot_ros.piano.identify.stiffness import optimize_stiffness
from pianobot_ros.piano.identify.takes.take import takes_from_recording
from pianobot_ros.piano.twin.reduced.strike_geometry import stiffness_of

VACUUM = -50e3
TWO_NOTES = (
    "strikes: [{notes: {thumb: 64, middle: 68}, speed: 0.15, depth: 0.014, hold: 0.4,"
    " note_length: 2.5, pressure: -50000}]"
)
"""Thumb on E, middle finger on G sharp, T_N = 2.5 s."""


def commands(phrase: str) -> Commands:
    return plan_score(parse_phrase(phrase))


def hidden(played: Commands, stiffness: float, seed: int) -> Recording:
    factor = stiffness / float(stiffness_of(VACUUM))
    return simulate_cell(played, parameter_errors={"joint_stiffness": factor - 1}, seed=seed)


def scale_on_plant(
    count: int = 12, seed: int = 0
) -> tuple[dict[str, Any], list[Played], list[float]]:
    """Solve a scale of velocities and play the solution on the emulated cell."""
    begun = time.perf_counter()
    played = solve(velocity_scale(count=count))
    seconds = time.perf_counter() - begun
    lines = "\n".join(
        f"  - {{note: {p.wanted.note}, finger: {p.finger}, speed: {p.motion.speed:.6f}, depth:"
        f" {p.motion.depth}, "
        f"hold: {p.motion.hold:.6f}, pressure: {p.pressure:.0f}}}"
        for p in played
    )
    record = simulate_cell(commands(f"strikes:\n{lines}"), seed=seed)
    gain = keyboard().midi.velocity_gain
    notes = keystrokes_from_midi(record.notes["real"], keyboard().midi)
    heard, held = [], []
    for p, strike in zip(played, record.strikes, strict=True):
        own = [k for k in notes if strike.start <= k.onset <= strike.end]
        heard.append(own[0].v_pre * gain if own else float("nan"))
        held.append(own[0].t_hold - p.wanted.t_hold if own else float("nan"))
    asked = [p.wanted.velocity for p in played]
    miss = np.abs(np.array(heard) - asked)
    return (
        {
            "asked": asked,
            "twin": [p.velocity for p in played],
            "played": heard,
            "worst_miss": float(np.nanmax(miss)),
            "median_miss": float(np.nanmedian(miss)),
            "silent": int(np.isnan(miss).sum()),
            "worst_hold_miss_ms": float(1e3 * np.nanmax(np.abs(held))),
            "seconds": seconds,
            "peak_force": [p.peak_force for p in played],
        },
        played,
        heard,
    )


def speed(folder: Path | None) -> dict[str, Any]:
    """Wall and processor time, and the share of the simulation; everything compiled before the
    clock runs.
    """
    takes = takes_from_recording(hidden(commands(TWO_NOTES), 10.0, 0))
    optimize_stiffness(takes, iterations=8)
    out: dict[str, Any] = {}
    wall, cpu = time.perf_counter(), time.process_time()
    optimize_stiffness(takes, iterations=30)
    out["optimize_30"] = {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
    cpu = time.process_time()
    for _ in range(50):
        for take in takes:
            take.keystroke(take.stroke(12.0))
    strike = (time.process_time() - cpu) / (50 * len(takes))
    out["strike_ms"] = 1e3 * strike
    out["simulation_share_of_search"] = 30 * len(takes) * strike / out["optimize_30"]["cpu_s"]
    record = simulate_cell(
        standard_strikes(1, 40), parameter_errors={"joint_stiffness": 0.2}, seed=1, encoder=True
    )
    test = load_test_from_recording(record)
    identify_keystroke(test, bayes_iterations=0)
    wall, cpu = time.perf_counter(), time.process_time()
    keystroke = identify_keystroke(test)
    out["keystroke"] = {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
    many = takes_from_recording(record)
    wall, cpu = time.perf_counter(), time.process_time()
    curve = identify_vacuum(many)
    out["vacuum_40_strikes"] = {
        "wall_s": time.perf_counter() - wall,
        "cpu_s": time.process_time() - cpu,
    }
    if folder is not None:
        plot_keystroke(keystroke, folder)
        plot_vacuum(curve, folder, lambda pressure: 1.2 * float(stiffness_of(pressure)))
    return out


def scatter(rows: list[dict[str, Any]], folder: Path) -> None:
    """Found against hidden stiffness of both ways, and Err against the paper's."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    runs = [x for r in rows for x in r["two_notes"] if "paper" in x]
    for axis, kind in zip(axes, KINDS, strict=True):
        own = [x for x in runs if x["kind"] == kind]
        truth = [x["truth"] for x in own]
        for how, colour, name in (
            ("paper", "#d62728", "only k free"),
            ("joint", "#1f77b4", "everything estimated"),
        ):
            axis.loglog(truth, [x[how]["k"] for x in own], "o", ms=4, color=colour, label=name)
        axis.plot([2.5, 32], [2.5, 32], color="0.6", ls=":")
        axis.set(xlabel="hidden stiffness [N m/rad]", ylabel="found", title=kind)
        axis.set(xlim=(2.3, 34), ylim=(2, 90))
        ticks = (3, 5, 10, 20, 30)
        axis.set_xticks(ticks, [str(t) for t in ticks])
        axis.set_yticks((*ticks, 60), [str(t) for t in (*ticks, 60)])
        axis.minorticks_off()
    axes[0].legend(fontsize=8, loc="upper left")
    figure.savefig(folder / "paper_result.png", dpi=110)
    pyplot.close(figure)


def percent(value: float | None, digits: int = 1) -> str:
    return "-" if value is None or np.isnan(value) else f"{100 * value:.{digits}f} %"


def between(ends: list[float] | None) -> str:
    return "" if ends is None else f" ({percent(ends[0], 0)} to {percent(ends[1], 0)})"


def table_of_cells(s: dict[str, Any]) -> list[str]:
    lines = [
        "| cells | levels | identified | 90 % interval holds k (5 to 95 %, cells drawn again) |"
        " error of k where identified: median, 90th percentile |",
        "|---|---|---|---|---|",
    ]
    for kind in ("all cells", "without effect", "one effect"):
        x = s[kind]
        lines.append(
            f"| {kind} | {x['levels']} | {percent(x['identifiable'], 0)} |"
            f" {percent(x['coverage'], 0)}{between(x['coverage_90'])} | "
            f"{percent(x['error'])}, {percent(x['error_p90'])} |"
        )
    held = ", ".join(f"{n} {percent(v, 0)}" for n, v in s["all cells"]["parameters"].items())
    missed = ", ".join(f"{n or 'no effect'} {a} of {b}" for n, (a, b) in s["missed"].items())
    return [
        *lines,
        "",
        f"Their 90 % intervals hold the other parameters in: {held}.",
        "",
        f"Levels that their interval does not hold, by effect: {missed or 'none'}.",
    ]


def table_of_notes(s: dict[str, Any]) -> list[str]:
    lines = [
        "| what is unknown | runs | Err before | Err after | on a strike not fitted: before | after"
        " | error of k: before | after | 90 % interval holds k | identified |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for kind, x in s["two_notes"].items():
        two = [
            " / ".join(percent(v, 2 if name != "k_error" else 0) for v in x[how][name])
            for name in ("err", "held", "k_error")
            for how in ("paper", "joint")
        ]
        lines.append(
            f"| {kind} | {x['runs']} | {' | '.join(two)} | {percent(x['holds'], 0)} |"
            f" {percent(x['identifiable'], 0)} |"
        )
    return [*lines, "", "Median / 90th percentile each."]


def markdown(result: dict[str, Any]) -> str:
    """The page: each section that ``result`` has, with the command that measured it."""
    lines = [
        "# Identification: results",
        "",
        "Made by `python benchmarks/identify.py --output docs/results/identify`; each section names"
        " its command.",
        "",
        "Emulated cell (plant) against the reduced strike model; nothing here was played on"
        " hardware. Key preset `paper`. Times were measured on two shared cores.",
        "",
    ]
    for name, section in (("levels", of_levels), ("notes", of_notes), ("rest", others)):
        if name in result:
            lines += section(result[name])
    return "\n".join(lines)


def of_levels(r: dict[str, Any]) -> list[str]:
    """Coverage over hidden cells."""
    s = r["summary"]
    return [
        "## Hidden cells",
        "",
        f"`{r['command']}`",
        "",
        f"{s['cells']} cells of seed {r['seed']}. Every parameter is off by up to 20 %, and every"
        " second cell has one effect of 3 to 10 floors that the model lacks, any of the plant's."
        " Each plays 40 strikes at three vacuum levels with force and key angle recorded. Refused:"
        f" {s['refused']}.",
        "",
        *table_of_cells(s),
        "",
    ]


def of_notes(r: dict[str, Any]) -> list[str]:
    """The paper's experiment."""
    return [
        "## The paper's result",
        "",
        f"`{r['command']}`",
        "",
        "Thumb on E, middle finger on G sharp, one strike each together, -50 kPa, hidden k 0.05 to"
        " 0.5 N·m/deg, λ = 0.8/0.2, 30 iterations, T_N 2.5 s, key angle and force on E only."
        " *Before* is the paper's procedure, in which only k is free; *after* estimates everything"
        " that is not known. The paper reports Err = 4.41 % for one hand of which not everything"
        " else was known: only the last row may stand beside it.",
        "",
        *table_of_notes(r["summary"]),
        "",
        "Err before is small where a wrong k makes up for a wrong gain; that is what the error of k"
        " shows. Err after is of two notes with about forty numbers to fit them, so the strike that"
        " was not fitted says more.",
        "",
        "![Found against hidden stiffness](paper_result.png)",
        "",
        "One run by the paper's procedure with only k unknown, and its profile:",
        "",
        "![One run](stiffness.png)",
        "",
    ]


def others(result: dict[str, Any]) -> list[str]:
    """Wanted dynamics and speed."""
    d, v = result["dynamics"], result["speed"]
    lines = [
        "## Wanted dynamics, played on the plant",
        "",
        f"`{result['command']}`",
        "",
        "| asked | " + " | ".join(f"{x:.0f}" for x in d["asked"]) + " |",
        "|---" * (len(d["asked"]) + 1) + "|",
        "| twin | " + " | ".join(f"{x:.1f}" for x in d["twin"]) + " |",
        "| plant | " + " | ".join(f"{x:.0f}" for x in d["played"]) + " |",
        "",
        f"Median miss {d['median_miss']:.1f}, worst {d['worst_miss']:.1f} of 127; worst miss of"
        " T_hold "
        f"{d['worst_hold_miss_ms']:.1f} ms; peak force {min(d['peak_force']):.1f} to"
        f" {max(d['peak_force']):.1f} N. "
        "A MIDI velocity is a whole number and repeats of one strike scatter by about 0.5.",
        "",
        "![Asked against played](dynamics.png)",
        "",
        "## Speed",
        "",
        "| job | wall, s | processor, s |",
        "|---|---|---|",
    ]
    for name in ("optimize_30", "keystroke", "vacuum_40_strikes"):
        lines.append(f"| {name} | {v[name]['wall_s']:.2f} | {v[name]['cpu_s']:.2f} |")
    return [
        *lines,
        "",
        f"A strike takes {v['strike_ms']:.2f} ms in the reduced model, so simulation is "
        f"{100 * v['simulation_share_of_search']:.0f} % of the paper's search and the Gaussian"
        " process the rest. "
        "*vacuum_40_strikes* estimates everything that is not known.",
        "",
        "![Keystroke](keystroke.png)",
        "",
        "![Stiffness against vacuum](vacuum.png)",
        "",
    ]


def cells_of(
    count: int, seed: int, keep: Path | None, *, two_notes: bool = True
) -> list[dict[str, Any]]:
    """Measure so many hidden cells; ``keep`` holds those already measured and goes on from them."""
    rows: list[dict[str, Any]] = []
    if keep is not None and keep.exists():
        rows = [json.loads(line) for line in keep.read_text().splitlines()]
    for number in range(len(rows), count):
        rows.append(measure(draw(seed, number), two_notes=two_notes))
        if keep is not None:
            with keep.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    return rows[:count]


def show(s: dict[str, Any]) -> None:
    print(f"{s['cells']} cells, refused {s['refused']}")
    notes = ["", *table_of_notes(s)] if s["two_notes"] else []
    print("\n".join([*table_of_cells(s), *notes]), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=40, help="hidden cells; 0: only the rest")
    parser.add_argument("--seed", type=int, default=0, help="seed of the cells")
    parser.add_argument("--keep", type=Path, help="file of cells measured, to go on from")
    parser.add_argument(
        "--only-levels", action="store_true", help="of the cells only the vacuum levels"
    )
    parser.add_argument(
        "--only-cells", action="store_true", help="neither dynamics nor speed: tables and picture"
    )
    parser.add_argument(
        "--output", type=Path, help="folder for results.json, README.md and pictures"
    )
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    parser.add_argument(
        "--tolerance",
        type=int,
        nargs="+",
        metavar="SEED",
        help="instead: what errors have beyond their covariance, in cells without effect",
    )
    options = parser.parse_args()
    if options.tolerance:
        for name, (value, count) in tolerances(options.tolerance, options.cells).items():
            print(f"{name:20} {value:.4f}  of {count} values")
        return
    folder: Path | None = options.output
    rows = cells_of(options.cells, options.seed, options.keep, two_notes=not options.only_levels)
    command = "python " + " ".join(["benchmarks/identify.py", *_chosen(options)])
    measured = {"command": command, "seed": options.seed, "summary": summary(rows)}
    result: dict[str, Any] = {}
    if rows:
        result["levels"] = measured
        if not options.only_levels:
            result["notes"] = measured
        if not options.json:
            show(measured["summary"])
    if not options.only_cells:
        result["rest"] = {"command": command, **rest(folder)}
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        if rows and not options.only_levels:
            scatter(rows, folder)
        write(folder, result)
    if options.json:
        print(json.dumps({**result, "cells": rows}))
    elif "rest" in result:
        print("asked ", result["rest"]["dynamics"]["asked"])
        print("plant ", result["rest"]["dynamics"]["played"])
        print(json.dumps(result["rest"]["speed"], indent=1))


def _chosen(options: argparse.Namespace) -> list[str]:
    """What was asked for, as on the command line."""
    words = ["--cells", str(options.cells)]
    if options.cells:
        words += ["--seed", str(options.seed)]
    flags = ("only_cells", "only_levels")
    return words + ["--" + n.replace("_", "-") for n in flags if getattr(options, n)]


def rest(folder: Path | None) -> dict[str, Any]:
    """Wanted dynamics, speed and their pictures."""
    dynamics, played, heard = scale_on_plant()
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        takes = takes_from_recording(hidden(commands(TWO_NOTES), 7.0, 0))
        plot_stiffness(optimize_stiffness(takes, iterations=30), folder, 7.0)
        plot_dynamics(played, folder, heard)
    return {"dynamics": dynamics, "speed": speed(folder)}


def write(folder: Path, measured: dict[str, Any]) -> None:
    """Put what was ``measured`` in place of its sections of results.json, and write the page."""
    file = folder / "results.json"
    result = json.loads(file.read_text()) if file.exists() else {}
    result.update(measured)
    file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (folder / "README.md").write_text(markdown(result), encoding="utf-8")


if __name__ == "__main__":
    main()
