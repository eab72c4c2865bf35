"""``pianobot demo``: the whole system on an emulated cell with one hidden effect; its bag is
diagnosed, then comes the answer. One graph does all of it, so that one page in the browser shows
all of it.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.recordings.before_after import UNHEARD
from pianobot_ros.cli.graph.view import open_in_browser

if TYPE_CHECKING:
    from pianobot_ros.cli.graph.running_cell import SupervisedCell

__all__ = ["Script", "run_demo"]

PHRASE = "demo"
# of the hidden effect, units of the repeatability floor: clear enough for a first look
MAGNITUDE = (3.0, 10.0)
# of the run directory; the emulated cell writes it, nothing here reads it before the verdict
ANSWER = "answer.json"
# node that the demo has no use for
WITHOUT = ("optimizer",)
# share of the strikes that must sound on both cells: a hidden effect may silence a few
SOUNDED = 0.75


@dataclass(frozen=True)
class Script:
    """What is played: the phrase that is diagnosed, the one that is played before and after, and
    parameters of the nodes.
    """

    phrase: str = PHRASE
    unheard: str = UNHEARD
    parameters: Mapping[str, dict[str, object]] = field(default_factory=dict)


def run_demo(
    *,
    seed: int | None,
    screen: bool,
    diagnosis: bool,
    run: Path | None,
    domain: int | None,
    as_json: bool,
    picture: Path | None = None,
    view: bool = True,
    script: Script = Script(),
) -> int:
    """Play, compare, record, diagnose the bag, give the answer, adopt the verdict, play a phrase
    that was not used, open the report. Returns 0, or 1 if a part failed.

    ``seed`` draws what is hidden in the emulated cell (None: at random); without ``diagnosis``
    the cell is nominal. ``picture`` gets the live table as SVG.
    """
    from pianobot_ros.cli.demo.requests import end_bag
    from pianobot_ros.cli.demo.summary import compared, failed, strikes_of, write_summary
    from pianobot_ros.cli.graph import running_cell as graph
    from pianobot_ros.cli.graph.comparison_table import live_view, write_picture
    from pianobot_ros.cli.graph.supervisor import new_run_directory

    if picture is not None and picture.suffix != ".svg":
        raise PianobotError(f"{picture} must end in .svg")
    begun = time.monotonic()
    folder = new_run_directory() if run is None else run.absolute()
    seed = seed if seed is not None else int.from_bytes(os.urandom(3), "little")
    hidden = hidden_effect(seed, folder) if diagnosis else ()
    try:
        with graph.running_cell(
            emulated=graph.isolated_emulation(*hidden),
            parameters=dict(script.parameters),
            without=WITHOUT,
            screen=screen,
            run=folder,
            domain=_domain() if domain is None else domain,
            view=view,
        ) as cell:
            played, reports = _play(cell, script.phrase, diagnosis)
            twin, midi = cell.observer.twin, graph.midi_said(cell.observer)
            if picture is not None:
                write_picture(picture, live_view(reports, cell.observer.states(), twin))
            end_bag(cell)
            summary: dict[str, Any] = compared(reports, twin) | strikes_of(played, script.phrase)
            summary |= {"run": str(folder), "midi": midi}
            failures = failed(summary, played, SOUNDED if diagnosis else 1.0)
            if diagnosis and played.success:
                failures += _look_and_adopt(cell, folder, seed, script.unheard, summary)
    except graph.Stopped:
        print("interrupted; everything was stopped", file=sys.stderr)
        return 130
    summary |= {"failures": failures, "seconds": time.monotonic() - begun}
    text = write_summary(folder, summary, reports)
    if not as_json and (found := summary.get("diagnosis")):
        open_in_browser(Path(found["report"]).as_uri())
    typer.echo(json.dumps(summary) if as_json else text)
    return 1 if failures else 0


def _domain() -> int | None:
    """A domain drawn at random, unless the environment names one."""
    if "ROS_DOMAIN_ID" in os.environ:
        return None
    return 1 + int.from_bytes(os.urandom(2), "little") % 100


def _play(cell: SupervisedCell, phrase: str, diagnosis: bool) -> tuple[Any, list[Any]]:
    """Play the phrase on both cells; its result, and the comparisons of its strikes."""
    from pianobot_ros.cli.demo.closing_loop import play_and_compare

    if diagnosis:
        cell.tell(
            "the emulated cell has one effect that the twin lacks, and wrong parameters; which is"
            " not told yet"
        )
    cell.tell(f"playing '{phrase}' on the emulated and on the simulated cell")
    return play_and_compare(cell, phrase)


def hidden_effect(seed: int, folder: Path) -> tuple[str, ...]:
    """Words for the emulator that make it draw an effect and keep it to itself."""
    low, high = (f"{m:g}" for m in MAGNITUDE)
    return (
        "--draw",
        "effect",
        "--seed",
        str(seed),
        "--magnitude",
        low,
        high,
        "--secret",
        str(folder / ANSWER),
    )


def _look_and_adopt(
    cell: SupervisedCell, folder: Path, seed: int, unheard: str, summary: dict[str, Any]
) -> list[str]:
    """Diagnose, then close the loop; what is found goes to ``summary``. Returns what failed."""
    from pianobot_ros.cli.demo.closing_loop import close_the_loop
    from pianobot_ros.cli.demo.requests import begin_bag

    try:
        summary["diagnosis"] = found = _diagnose(cell, folder, seed)
        cell.tell(found["sentence"])
        begin_bag(cell)
        summary["unheard"] = close_the_loop(cell, folder, unheard)
    except PianobotError as error:
        return [f"diagnosis: {error}"]
    return []


def _diagnose(cell: SupervisedCell, folder: Path, seed: int) -> dict[str, Any]:
    """Let the graph diagnose the bag that was recorded, and only then read the answer."""
    from pianobot_ros.cli.demo.requests import diagnose

    cell.tell("diagnosis of the recorded bag, without knowing the answer …")
    report = folder / "diagnosis"
    found = diagnose(cell, folder / "bag", report)
    answer = json.loads((folder / ANSWER).read_text(encoding="utf-8"))["effects"]
    named = [c["name"] for c in found["candidates"]]
    return {
        "verdict": found["verdict"],
        "sentence": found["sentence"],
        "credible_set": list(found["credible_set"]),
        "candidates": [
            {"name": c["name"], "probability": c["probability"]} for c in found["candidates"][:5]
        ],
        "report": str(report / "report.html"),
        "seed": seed,
        "answer": sorted(answer),
        "magnitude": answer,
        "hit": sorted(answer) == named[:1],
        "inside": all(name in found["credible_set"] for name in answer),
    }
