"""What a demo found, in numbers and in words."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import PianobotError

__all__ = ["compared", "failed", "markdown", "strikes_of", "write_summary"]


def strikes_of(played: Any, phrase: str) -> dict[str, int]:
    """Strikes that the phrase asks for, those played once more, and those lost at the end."""
    from pianobot_ros.cell.score import load_score

    asked = len(load_score(phrase).places)
    return {
        "asked": asked,
        "repeated": max(int(played.strikes) - asked, 0),
        "lost": len(played.unreachable) if played.success else max(asked - int(played.strikes), 0),
    }


def compared(reports: list[Any], twin: Any) -> dict[str, Any]:
    """How alike the cells were, and how well the twin kept pace."""
    errors = [g.err for r in reports for g in r.keystrokes if not math.isnan(g.err)]
    latencies = sorted(r.latency for r in reports)
    return {
        "strikes": len(reports),
        "both_sounded": sum(
            not (g.real_missing or g.sim_missing) for r in reports for g in r.keystrokes
        ),
        "err_mean": sum(errors) / len(errors) if errors else None,
        "compare_latency_max": latencies[-1] if latencies else None,
        "real_time_factor": twin.real_time_factor if twin else None,
        "step_jitter_p99": twin.jitter_p99 if twin else None,
    }


def failed(summary: dict[str, Any], played: Any, least: float) -> list[str]:
    """What went wrong, after a look into the bag that was recorded; ``least``: share of the strikes
    that must sound on both cells.
    """
    failures = []
    if not played.success:
        failures.append(f"the phrase was not played: {played.message}")
    if summary["strikes"] < played.strikes:
        failures.append(f"only {summary['strikes']} of {played.strikes} strikes were compared")
    failures += _bag(Path(summary["run"]) / "bag", summary)
    if summary["asked"] - summary["lost"] < least * summary["asked"]:
        failures.append(f"{summary['lost']} of {summary['asked']} strikes were lost")
    return failures


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


def markdown(summary: dict[str, Any], reports: list[Any]) -> str:
    """The summary as Markdown."""
    from pianobot_ros.cli.demo.closing_loop import adopted_lines

    lines = ["# pianobot demo", "", "## Real (emulated) against simulated", ""]
    lines += [*_table(reports), *_cells(summary)]
    if found := summary.get("diagnosis"):
        lines += _verdict(found)
    if loop := summary.get("unheard"):
        lines += ["", *adopted_lines(loop)]
    if summary["failures"]:
        lines += ["", "## Failed", "", *(f"- {f}" for f in summary["failures"])]
    lines += [
        "",
        f"{summary['seconds']:.0f} s; everything is in {summary['run']}; to see it again:"
        f" `pianobot view {shlex.quote(summary['run'] + '/bag')}`",
        "",
    ]
    return "\n".join(lines)


def write_summary(folder: Path, summary: dict[str, Any], reports: list[Any]) -> str:
    """Write the summary into ``folder`` as Markdown and as JSON; returns the Markdown."""
    text = markdown(summary, reports)
    (folder / "summary.md").write_text(text, encoding="utf-8")
    (folder / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    return text


def _table(reports: list[Any]) -> list[str]:
    from pianobot_ros.cli.graph.comparison_table import strike_rows

    return [
        (
            "| # | note | condition | V_pre m/s | V_rel m/s | T_hold s | T_idle s | peak N | Err |"
            " latency |"
        ),
        "|" + "---|" * 10,
        *("| " + " | ".join(c.replace("|", "/") for c in strike_rows(r)) + " |" for r in reports),
        "",
        "Each pair is real / simulated; Err is Eq. 5.",
        "",
    ]


def _cells(summary: dict[str, Any]) -> list[str]:
    def shown(name: str, factor: float, unit: str, digits: int = 2) -> str:
        value = summary.get(name)
        return "unknown" if value is None else f"{factor * value:.{digits}f}{unit}"

    lines = [
        (
            f"- {summary['strikes']} strikes compared, {summary['both_sounded']} sounded on both"
            f" cells; mean Err {shown('err_mean', 100, ' %', 1)}"
        ),
        (
            f"- of {summary.get('asked', 0)} strikes {summary.get('repeated', 0)} were played once"
            f" more, {summary.get('lost', 0)} are lost"
        ),
        f"- slowest comparison {shown('compare_latency_max', 1e3, ' ms', 0)} after the strike",
        (
            f"- twin: real-time factor {shown('real_time_factor', 1, '', 3)}, step jitter p99"
            f" {shown('step_jitter_p99', 1e3, ' ms')}"
        ),
        f"- MIDI: {summary['midi']}",
    ]
    if bag := summary.get("bag"):
        lines.append(
            f"- bag: {bag['path']} ({bag['messages']} messages, {bag['duration']:.1f} s,"
            f" {bag['megabytes']:.1f} MB)"
        )
    return lines


def _verdict(found: dict[str, Any]) -> list[str]:
    likely = ", ".join(f"{c['name']} {100 * c['probability']:.0f} %" for c in found["candidates"])
    answer = ", ".join(
        f"{name} ({m:.1f} × the repeatability floor)" for name, m in found["magnitude"].items()
    )
    judged = (
        "named first" if found["hit"] else "in the credible set" if found["inside"] else "missed"
    )
    return [
        "",
        "## Diagnosis of this bag",
        "",
        found["sentence"],
        "",
        f"- candidates: {likely}",
        f"- report: {found['report']}",
        f"- the answer, opened only now: **{answer}**: {judged} (seed {found['seed']})",
    ]
