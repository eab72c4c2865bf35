"""`pianobot diagnose`, `pianobot blind …` and `pianobot experiment next`.

Use :func:`register` to put them on the main command. Errors are :class:`PianobotError`; the main
command prints them.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.default_budgets import (
    DIAGNOSIS_BUDGET,
    INVESTIGATION_GOAL,
    INVESTIGATION_GOALS,
    INVESTIGATION_STRIKES,
)
from pianobot_ros.cell.numbers.shown import in_kpa
from pianobot_ros.cli.new_paths import default_folder, new_diagnosis, new_file
from pianobot_ros.cli.shared_options import Json, Seed, number, progress_bar, several

if TYPE_CHECKING:
    from pianobot_ros.gap import Diagnosis

__all__ = ["blind_app", "diagnose_command", "experiment_app", "register"]

blind_app = typer.Typer(
    help="Check the diagnosis on emulated cells whose effects are hidden from it.",
    no_args_is_help=True,
)
experiment_app = typer.Typer(help="What to play next.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the commands to ``app``."""
    app.command("diagnose")(diagnose_command)
    app.add_typer(blind_app, name="blind")
    app.add_typer(experiment_app, name="experiment")


def diagnose_command(
    bags: Annotated[list[Path], several("One bag, or several of the same cell.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Folder for report.html and diagnosis.json.",
            show_default="diagnosis/<run>",
            callback=new_diagnosis,
        ),
    ] = None,
    seed: Seed = 0,
    strikes: Annotated[int, typer.Option(min=0, help="Use at most so many strikes (0: all).")] = 0,
    budget: Annotated[
        int, typer.Option(min=100, help="Strikes simulated for the search.")
    ] = DIAGNOSIS_BUDGET,
    threads: Annotated[int, typer.Option(min=1, help="Threads for the rollouts.")] = 2,
    without: Annotated[
        str, typer.Option(metavar="NAME[,NAME]", help="Families that the library shall lack.")
    ] = "",
    as_json: Json = False,
) -> None:
    """Where the sim-to-real gap lies, which effect causes it, and how far it shrinks."""
    folder = output or default_folder(bags[0])
    from pianobot_ros.piano.gap.diagnosis.diagnose import diagnose_bag, write_results

    with progress_bar(as_json) as progress:
        found = diagnose_bag(
            bags,
            seed=seed,
            strikes=strikes,
            budget=budget,
            threads=threads,
            without=[n.strip() for n in without.split(",") if n.strip()],
            progress=progress,
        )
    if as_json:
        typer.echo(
            json.dumps(found.to_json() | {"report": str(folder / "report.html")}, allow_nan=False)
        )
    else:
        _tell(found)
    write_results(found, folder)  # what cannot be written has been said
    if not as_json:
        typer.echo(f"Report: {folder / 'report.html'}")


def _tell(found: Diagnosis) -> None:
    typer.echo(found.sentence)
    worst = sorted((s for s in found.stages if s.gap == s.gap), key=lambda s: -s.gap)[:3]
    typer.echo("Gap by stage (× floor): " + ", ".join(f"{s.name} {s.gap:.1f}" for s in worst))
    likely = [c for c in found.candidates if c.probability >= 0.01][:5]
    typer.echo("Candidates: " + ", ".join(f"{c.name} {100 * c.probability:.0f} %" for c in likely))
    g = found.gap
    typer.echo(
        f"Held-out gap (× floor): before {g.before:.2f}, parameters refitted {g.refit:.2f}, after"
        f" {g.after:.2f}"
    )
    closed = {
        "refitting closes": g.closed_by_parameters,
        "the effect closes of the rest": g.closed_by_effect,
        "together": g.closed,
    }
    parts = [f"{what} {100 * x:.0f} %" for what, x in closed.items() if math.isfinite(x)]
    if parts:
        typer.echo("Held out, above the floor: " + ", ".join(parts))
    for group in found.inseparable:
        typer.echo(f"Cannot be told apart with these strikes: {', '.join(group)}")
    if found.next_experiment:
        n = found.next_experiment
        typer.echo(f"Next experiment: {_words(n)}; separates {' and '.join(n['separates'])}")
    for warning in found.warnings:
        typer.echo(f"Note: {warning}")


def _words(proposal: object) -> str:
    assert hasattr(proposal, "__getitem__")
    a = proposal["attributes"]
    return (
        f"note {a['note']:.0f} at {a['speed']:.2f} m/s, {1e3 * a['depth']:.0f} mm deep, held"
        f" {a['hold']:.1f} s, {in_kpa(a['pressure'])} ({proposal['expected_gain']:.2f} nats,"
        f" {proposal['gain_over_median']:.1f} × a typical strike)"
    )


@blind_app.command("make")
def blind_make(
    folder: Annotated[Path, typer.Argument(help="New folder for the bags.")],
    answers: Annotated[
        Path,
        typer.Option(help="File for the answers; keep it away from the folder.", callback=new_file),
    ],
    cases: Annotated[int, typer.Option(min=1, help="Cells, a bag each.")] = 120,
    seed: Seed = 0,
    strikes: Annotated[int, typer.Option(min=8, help="Strikes in each bag.")] = 40,
    rig: Annotated[bool, typer.Option(help="Whether the cell has the key's angle sensor.")] = True,
    laws: Annotated[
        str, typer.Option(help="Laws of the plant that an effect may act by; 3 is held back.")
    ] = "0,1,2",
    investigate: Annotated[
        bool,
        typer.Option("--investigate", help="Each cell plays on until the goal."),
    ] = False,
    budget_strikes: Annotated[
        int, typer.Option(min=8, help="Most strikes of an investigation.")
    ] = INVESTIGATION_STRIKES,
    goal: Annotated[
        float, number("Probability at which it ends.", *INVESTIGATION_GOALS)
    ] = INVESTIGATION_GOAL,
    budget: Annotated[
        int, typer.Option(min=200, help="Simulated strikes of each diagnosis.")
    ] = DIAGNOSIS_BUDGET,
    as_json: Json = False,
) -> None:
    """Draw hidden effects and record bags of them."""
    from pianobot_ros.piano.blind.make import Design, make_cases
    from pianobot_ros.piano.gap.diagnosis.investigate import Goal

    with progress_bar(as_json) as progress:
        manifest = make_cases(
            folder,
            answers,
            Design(cases=cases, seed=seed, strikes=strikes, rig=rig, laws=_laws(laws)),
            jobs=-1,
            goal=Goal(goal, budget_strikes, budget=budget) if investigate else None,
            progress=progress,
        )
    listed = json.loads(manifest.read_text(encoding="utf-8"))
    typer.echo(
        json.dumps(listed)
        if as_json
        else f"{cases} cases in {folder}; answers in {answers}, SHA-256 {listed['commitment']}"
    )


def _laws(text: str) -> list[int]:
    try:
        return [int(x) for x in text.split(",")]
    except ValueError:
        raise ConfigError(f"--laws {text}: write some of 0,1,2,3") from None


@blind_app.command("diagnose")
def blind_diagnose(
    folder: Annotated[Path, typer.Argument(help="Folder of blind cases.")],
    jobs: Annotated[
        int, typer.Option(min=-1, help="Parallel processes (-1: one for each core).")
    ] = -1,
    backend: Annotated[
        str, typer.Option(help="joblib backend: loky, dask, ray, threading.")
    ] = "loky",
    budget: Annotated[
        int, typer.Option(min=100, help="Strikes simulated for each case.")
    ] = DIAGNOSIS_BUDGET,
    again: Annotated[bool, typer.Option(help="Diagnose cases again that have a result.")] = False,
    as_json: Json = False,
) -> None:
    """Diagnose every case, without the answers."""
    from pianobot_ros.piano.blind.run import diagnose_cases

    with progress_bar(as_json) as progress:
        results = diagnose_cases(
            folder, jobs=jobs, backend=backend, budget=budget, again=again, progress=progress
        )
    typer.echo(json.dumps({"results": str(results)}) if as_json else f"Results in {results}")


@blind_app.command("score")
def blind_score(
    folder: Annotated[Path, typer.Argument(help="Folder of diagnosed cases.")],
    answers: Annotated[Path, typer.Option(help="The answers that `blind make` wrote.")],
    svg: Annotated[
        Path | None,
        typer.Option(help="Draw the reliability diagram into this file.", callback=new_file),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check the commitment and score the diagnoses."""
    from pianobot_ros.piano.blind.reliability import to_svg
    from pianobot_ros.piano.blind.scorecard import score_cases

    score = score_cases(folder, answers)
    typer.echo(json.dumps(score.to_json()) if as_json else score.to_text())
    if svg is not None:
        svg.write_text(to_svg(score.reliability["all"]), encoding="utf-8")


@experiment_app.command("next")
def experiment_next(
    source: Annotated[list[Path], several("Bags, or a diagnosis.json (or its folder).")],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Write a phrase that `pianobot play` plays.", callback=new_file),
    ] = None,
    count: Annotated[int, typer.Option(min=1, max=12, help="Number of proposed strikes.")] = 3,
    repeats: Annotated[int, typer.Option(min=1, max=100, help="How often each is played.")] = 4,
    as_json: Json = False,
) -> None:
    """Propose strikes that separate the leading candidates, and say by how much."""
    from pianobot_ros.piano.gap.diagnosis.next_experiment import proposals_from
    from pianobot_ros.piano.gap.diagnosis.proposals import phrase_of, write_phrase

    with progress_bar(as_json) as progress:
        proposals = proposals_from(source, count=count, progress=progress)
    if 0 < len(proposals) < count:
        why = f"a diagnosis holds its best strike only; give its bags for {count}"
        typer.echo(f"Note: {why}", err=True)
    phrase = out if proposals else None
    if as_json:
        typer.echo(json.dumps({"proposals": proposals, "phrase": str(phrase) if phrase else None}))
    else:
        for p in proposals:
            typer.echo(
                f"{_words(p)}; separates {' and '.join(p['separates'])}, seen in {p['shows_in']}"
            )
        if not proposals:
            typer.echo("Only one explanation is left: no experiment would separate anything.")
    if phrase is not None:
        write_phrase(phrase_of(proposals, repeats), phrase)
        if not as_json:
            typer.echo(f"Phrase: {phrase} (pianobot play {phrase})")
