"""`pianobot optimize stiffness | dynamics`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pianobot_ros.cell.errors import ConfigError, ScoreError
from pianobot_ros.cell.numbers.shown import in_kpa
from pianobot_ros.cli.analysis.identify import emit
from pianobot_ros.cli.new_paths import new_file
from pianobot_ros.cli.shared_options import Json, Output, Seed, number, progress_bar, several

if TYPE_CHECKING:
    from pianobot_ros.piano.identify.cell.answer import CellAnswer
    from pianobot_ros.piano.identify.cell.dynamics import Played, Wanted
    from pianobot_ros.piano.identify.stiffness import StiffnessFit

__all__ = ["app"]

app = typer.Typer(help="Find what makes the twin sound as wanted.", no_args_is_help=True)


@app.command("stiffness")
def stiffness(
    references: Annotated[list[Path], several("Standard MIDI files, or bags of the real cell.")],
    iterations: Annotated[int, typer.Option(min=1, max=1000, help="Strikes of the search.")] = 30,
    seed: Seed = 0,
    lambda1: Annotated[
        float, number("Weight of dynamics; articulation has the rest.", 0.0, 1.0)
    ] = 0.8,
    objective: Annotated[
        str, typer.Option(help="paper (Eq. 4), or hold_once (T_hold counted once).")
    ] = "paper",
    pressure: Annotated[
        float | None, number("Only strikes at this vacuum, Pa (0 to -100000).", -100e3, 0.0)
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            help="State file: go on from it if it exists, and write it after every iteration."
        ),
    ] = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Joint stiffness from reference keystrokes.

    Everything that is not known is estimated at once, and beside it stands the paper's procedure
    (Eqs. 3 to 5), Bayesian optimisation of the stiffness alone.

    A MIDI file is a wish and not a measurement: there only the paper's procedure answers.
    """
    from pianobot_ros.piano.identify.cell.answer import identify_cell
    from pianobot_ros.piano.identify.plots import plot_stiffness
    from pianobot_ros.piano.identify.state import load_state
    from pianobot_ros.piano.identify.stiffness import optimize_stiffness
    from pianobot_ros.piano.identify.takes.objective import Objective
    from pianobot_ros.piano.identify.takes.references import is_midi, takes_from_references

    wanted = Objective((lambda1, 1.0 - lambda1), objective)  # type: ignore[arg-type]
    about = {
        "reference": [str(r) for r in references],
        "weights": list(wanted.weights),
        "objective": wanted.form,
        "pressure": pressure,
    }
    state = load_state(resume, about) if resume is not None and resume.exists() else None
    takes = takes_from_references(references, pressure)
    with progress_bar(as_json) as bar:
        fit = optimize_stiffness(
            takes,
            wanted,
            iterations=iterations,
            seed=seed,
            resume=state,
            progress=partial(_note, bar, resume, about),
        )
        bar("everything that is not known", 1.0)
        joint = None if any(is_midi(r) for r in references) else identify_cell(takes)
    lines, result = _paper_lines(fit, wanted.weights, len(takes)), fit.as_dict()
    if joint is not None:
        lines, result["joint"] = [*_joint_lines(joint), *lines], joint.as_dict()
    emit(result, output, as_json, lines, partial(plot_stiffness, fit))


def _note(
    bar: Callable[[str, float], None],
    state: Path | None,
    about: Mapping[str, Any],
    search: Mapping[str, Any],
    numbers: Sequence[float],
) -> None:
    """Show how far a search is, and write its state down."""
    from pianobot_ros.piano.identify.state import save_state

    done, total, _, _, best, lowest = numbers
    bar(f"k = {best:.3g} N*m/rad, objective {lowest:.4f}", done / total)
    if state is not None:
        save_state(state, search, about)


def _joint_lines(joint: CellAnswer) -> list[str]:
    """What is said with everything estimated at once."""
    lines = [
        f"k = {k.value:.3g} N*m/rad at {in_kpa(p)}; 90 %: {k.low:.3g} to {k.high:.3g}"
        + ("" if k.identifiable else f"  open{': ' if k.combination else ''}{k.combination}")
        for k, p in zip(joint.levels, joint.pressures, strict=True)
    ]
    lines += [f"What would decide it: {joint.decides}"] if joint.decides else []
    return [
        *lines,
        f"Err (Eq. 5) with everything estimated {100 * joint.err_after:.2f} %, nominal twin"
        f" {100 * joint.err_before:.2f} %",
    ]


def _paper_lines(fit: StiffnessFit, weights: tuple[float, float], keystrokes: int) -> list[str]:
    """What is said by the paper's procedure."""
    total = weights[0] * fit.f_d + weights[1] * fit.f_a
    return [
        "the paper's procedure (only the stiffness is free, all else as configured):",
        f"k = {fit.stiffness:.3g} N*m/rad; 95 %: {fit.profile.low:.3g} to {fit.profile.high:.3g}",
        (
            f"Err (Eq. 5) {100 * fit.err:.2f} % over {keystrokes} keystrokes: velocities"
            f" {100 * fit.v_error:.2f} %, T_hold {100 * fit.t_hold_error:.2f} %, T_idle"
            f" {100 * fit.t_idle_error:.2f} %"
        ),
        (
            f"absolute, Eq. 4 as printed: f_d = {1e3 * fit.f_d:.2f} mm/s, f_a ="
            f" {1e3 * fit.f_a:.2f} ms; Eq. 3 adds them in SI: {total:.5f}"
        ),
        *(f"Note: {w}" for w in fit.warnings),
    ]


@app.command("dynamics")
def dynamics(
    score: Annotated[
        Path | None, typer.Argument(help="Standard MIDI file whose notes are to be played.")
    ] = None,
    scale: Annotated[
        int,
        typer.Option(min=0, max=60, help="Instead of a score: so many velocities from pp to ff."),
    ] = 0,
    note: Annotated[int, typer.Option(min=0, max=127, help="Note of the scale.")] = 64,
    finger: Annotated[str, typer.Option(help="thumb, index or middle.")] = "middle",
    max_speed: Annotated[float, number("Largest wrist speed, m/s.", 0.03, 0.8)] = 0.6,
    known: Annotated[
        Path | None,
        typer.Option(help="Bag of this cell: what it tells is estimated first and used."),
    ] = None,
    phrase: Annotated[
        Path | None,
        typer.Option(
            help="Write the strikes as a phrase that `pianobot play` plays.", callback=new_file
        ),
    ] = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Wrist motion and vacuum that play wanted velocities and lengths."""
    from pianobot_ros.bags.reading.read import read_bag
    from pianobot_ros.piano.identify.cell import dynamics as inverse
    from pianobot_ros.piano.identify.cell.answer import identify_cell
    from pianobot_ros.piano.identify.cell.belief import belief_after
    from pianobot_ros.piano.identify.plots import plot_dynamics
    from pianobot_ros.piano.identify.takes.take import takes_from_recording

    if (score is None) == (scale == 0):
        raise ConfigError("give either a MIDI file or --scale N")
    wanted: list[Wanted] = (
        inverse.velocity_scale(note, scale) if score is None else inverse.wanted_from_midi(score)
    )
    if not wanted:
        raise ScoreError(f"{score} holds no notes on the keyboard")
    played: list[Played] = []
    with progress_bar(as_json) as bar:
        belief = None
        if known is not None:
            bar("what the recording tells", 0.0)
            belief = belief_after(identify_cell(takes_from_recording(read_bag(known))))
        for i, w in enumerate(wanted):
            bar(f"note {w.note} velocity {w.velocity}", i / len(wanted))
            played += inverse.solve([w], finger=finger, max_speed=max_speed, belief=belief)
    lines = [
        f"note {p.wanted.note} velocity {p.wanted.velocity:3d} hold {p.wanted.t_hold:.2f} s:"
        f" {p.motion.speed:.3f} m/s, {1e3 * p.motion.depth:.0f} mm, {p.motion.hold:.3f} s,"
        f" {in_kpa(p.pressure)} -> {p.velocity:.1f} ± {p.velocity_error:.1f},"
        f" {p.keystroke.t_hold:.3f} ± {p.t_hold_error:.3f} s, peak {p.peak_force:.1f} N"
        for p in played
    ]
    strikes = {"strikes": [p.as_dict() for p in played]}
    emit(strikes, output, as_json, lines, partial(plot_dynamics, played))
    if phrase is not None:
        inverse.write_phrase(played, phrase)
