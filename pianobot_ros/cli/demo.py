"""``pianobot demo``: the whole system on an emulated cell with one hidden effect; its bag is diagnosed, then comes the answer."""

from __future__ import annotations

import json
import math
import os
import sys
import time
import webbrowser
from pathlib import Path
from typing import Any

import typer

from pianobot_ros.cell.budget import DIAGNOSIS_BUDGET
from pianobot_ros.cell.errors import PianobotError

__all__ = ["run_demo"]

PHRASE = "demo"
MAGNITUDE = (3.0, 10.0)  # of the hidden effect, units of the repeatability floor: clear enough for a first look
ANSWER = "answer.json"  # of the run directory; the emulated cell writes it, nothing here reads it before the verdict
SOUNDED = 0.75  # share of the strikes that must sound on both cells: a hidden effect may silence a few


def run_demo(
    *,
    seed: int,
    screen: bool,
    diagnosis: bool,
    run: Path | None,
    domain: int | None,
    as_json: bool,
    picture: Path | None = None,
) -> int:
    """Play, compare, record, diagnose the bag, open the report, give the answer. Returns 0, or 1 if a part failed.

    ``seed`` draws what is hidden in the emulated cell (negative: at random); without ``diagnosis`` the cell is nominal.
    ``picture`` gets the live table as SVG.
    """
    from pianobot_ros.cli.cell import Stopped, isolated_emulation, midi_said, running_cell
    from pianobot_ros.cli.supervisor import new_run_directory
    from pianobot_ros.cli.table import live_view, write_picture

    if picture is not None and picture.suffix != ".svg":
        raise PianobotError(f"{picture} must end in .svg")

    begun = time.monotonic()
    if domain is None and "ROS_DOMAIN_ID" not in os.environ:
        domain = 1 + int.from_bytes(os.urandom(2), "little") % 100
    failures: list[str] = []
    folder = new_run_directory() if run is None else run.absolute()
    seed = seed if seed >= 0 else int.from_bytes(os.urandom(3), "little")
    hidden = _hidden(seed, folder) if diagnosis else ()
    try:
        with running_cell(
            emulated=isolated_emulation(*hidden), jobs=False, screen=screen, run=folder, domain=domain
        ) as cell:
            if diagnosis:
                cell.tell(
                    "the emulated cell has one effect that the twin lacks, and wrong parameters; which is not told yet"
                )
            cell.tell(f"playing '{PHRASE}' on the emulated and on the simulated cell")
            cell.observer.reports.clear()
            played = cell.play(score=PHRASE)
            end = time.monotonic() + 2.0
            while len(cell.observer.reports) < played.strikes and time.monotonic() < end:
                cell.turn()
            reports, twin, midi = list(cell.observer.reports), cell.observer.twin, midi_said(cell.observer)
            if picture is not None:
                write_picture(picture, live_view(reports, cell.observer.states(), twin))
    except Stopped:
        print("interrupted; everything was stopped", file=sys.stderr)
        return 130
    if not played.success:
        failures.append(f"the phrase was not played: {played.message}")
    if len(reports) < played.strikes:
        failures.append(f"only {len(reports)} of {played.strikes} strikes were compared")
    summary: dict[str, Any] = _compared(reports, twin)
    summary["run"] = str(folder)
    summary["midi"] = midi
    failures += _bag(folder / "bag", summary)
    if summary["both_sounded"] < (SOUNDED if diagnosis else 1.0) * summary["strikes"]:
        failures.append(f"only {summary['both_sounded']} of {summary['strikes']} strikes sounded on both cells")
    if diagnosis:
        try:
            summary["diagnosis"] = _diagnose(folder, seed, show=not as_json)
        except PianobotError as error:
            failures.append(f"diagnosis: {error}")
    summary["failures"] = failures
    summary["seconds"] = time.monotonic() - begun
    text = _markdown(summary, reports)
    (folder / "summary.md").write_text(text, encoding="utf-8")
    (folder / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    typer.echo(json.dumps(summary) if as_json else text)
    return 1 if failures else 0


def _compared(reports: list[Any], twin: Any) -> dict[str, Any]:
    errors = [g.err for r in reports for g in r.keystrokes if not math.isnan(g.err)]
    latencies = sorted(r.latency for r in reports)
    return {
        "strikes": len(reports),
        "both_sounded": sum(not (g.real_missing or g.sim_missing) for r in reports for g in r.keystrokes),
        "err_mean": sum(errors) / len(errors) if errors else None,
        "compare_latency_max": latencies[-1] if latencies else None,
        "real_time_factor": twin.real_time_factor if twin else None,
        "step_jitter_p99": twin.jitter_p99 if twin else None,
    }


def _bag(path: Path, summary: dict[str, Any]) -> list[str]:
    """Look into the bag that was recorded; what is wrong with it."""
    from pianobot_ros.bags.info import bag_info

    try:
        info = bag_info(path)
    except PianobotError as error:
        return [f"bag: {error}"]
    summary["bag"] = {
        "path": info.path,
        "messages": info.messages,
        "duration": info.duration,
        "megabytes": info.size / 1e6,
    }
    return [] if info.whole else ["the bag is not whole"]


def _hidden(seed: int, folder: Path) -> tuple[str, ...]:
    """Words for the emulator that make it draw an effect and keep it to itself."""
    low, high = (f"{m:g}" for m in MAGNITUDE)
    return ("--draw", "effect", "--seed", str(seed), "--magnitude", low, high, "--secret", str(folder / ANSWER))


def _diagnose(folder: Path, seed: int, show: bool) -> dict[str, Any]:
    """Diagnose the bag that was recorded, show the report, and only then read the answer."""
    from pianobot_ros.cell_gap import diagnose_bag

    print("diagnosis of the recorded bag, without knowing the answer …", file=sys.stderr)
    report = folder / "diagnosis"
    found = diagnose_bag(folder / "bag", output=report, budget=DIAGNOSIS_BUDGET, threads=os.cpu_count() or 1)
    page = report / "report.html"
    if show:
        _open(page)
    answer = json.loads((folder / ANSWER).read_text(encoding="utf-8"))["effects"]
    named = [c.name for c in found.candidates]
    return {
        "verdict": found.verdict, "sentence": found.sentence, "credible_set": list(found.credible_set),
        "candidates": [{"name": c.name, "probability": c.probability} for c in found.candidates[:5]],
        "report": str(page), "seed": seed, "answer": sorted(answer), "magnitude": answer,
        "hit": sorted(answer) == named[:1], "inside": all(name in found.credible_set for name in answer),
    }  # fmt: skip


def _open(page: Path) -> None:
    """Show the page in a browser where somebody sits before a screen."""
    seen = sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if seen and sys.stdout.isatty():
        webbrowser.open(page.as_uri())


def _markdown(summary: dict[str, Any], reports: list[Any]) -> str:
    from pianobot_ros.cli.table import strike_rows

    def shown(name: str, factor: float, unit: str, digits: int = 2) -> str:
        value = summary.get(name)
        return "unknown" if value is None else f"{factor * value:.{digits}f}{unit}"

    lines = ["# pianobot demo", "", "## Real (emulated) against simulated", ""]
    lines += [
        "| # | note | condition | V_pre m/s | V_rel m/s | T_hold s | T_idle s | peak N | Err | latency |",
        "|" + "---|" * 10,
    ]
    lines += ["| " + " | ".join(c.replace("|", "/") for c in strike_rows(r)) + " |" for r in reports]
    lines += [
        "", "Each pair is real / simulated; Err is Eq. 5.", "",
        f"- {summary['strikes']} strikes compared, {summary['both_sounded']} sounded on both cells; "
        f"mean Err {shown('err_mean', 100, ' %', 1)}",
        f"- slowest comparison {shown('compare_latency_max', 1e3, ' ms', 0)} after the strike",
        f"- twin: real-time factor {shown('real_time_factor', 1, '', 3)}, step jitter p99 {shown('step_jitter_p99', 1e3, ' ms')}",
        f"- MIDI: {summary['midi']}",
    ]  # fmt: skip
    if bag := summary.get("bag"):
        lines.append(
            f"- bag: {bag['path']} ({bag['messages']} messages, {bag['duration']:.1f} s, {bag['megabytes']:.1f} MB)"
        )
    if found := summary.get("diagnosis"):
        likely = ", ".join(f"{c['name']} {100 * c['probability']:.0f} %" for c in found["candidates"])
        answer = ", ".join(f"{name} ({m:.1f} × the repeatability floor)" for name, m in found["magnitude"].items())
        judged = "named first" if found["hit"] else "in the credible set" if found["inside"] else "missed"
        lines += [
            "", "## Diagnosis of this bag", "", found["sentence"], "", f"- candidates: {likely}", f"- report: {found['report']}",
            f"- the answer, opened only now: **{answer}**: {judged} (seed {found['seed']})",
        ]  # fmt: skip
    if summary["failures"]:
        lines += ["", "## Failed", "", *(f"- {f}" for f in summary["failures"])]
    lines += ["", f"{summary['seconds']:.0f} s; everything is in {summary['run']}", ""]
    return "\n".join(lines)
