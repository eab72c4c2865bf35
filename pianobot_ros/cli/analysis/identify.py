"""`pianobot identify keystroke | vacuum | parameters`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.numbers.shown import in_kpa
from pianobot_ros.cli.new_paths import RESULT, new_file
from pianobot_ros.cli.shared_options import Json, Output, number, progress_bar, several
from pianobot_ros.cli.shared_options import seed as seed_option

if TYPE_CHECKING:
    from pianobot_ros.piano.identify.cell.answer import Known

__all__ = ["app", "emit", "values_of"]

app = typer.Typer(help="From recordings to the twin's parameters.", no_args_is_help=True)

Recordings = Annotated[list[Path], several("Bags of one cell, each whole or repaired.")]
Cell = Annotated[str, typer.Option(help="Which cell of the recording: real or sim.")]


def emit(
    result: Mapping[str, Any],
    output: Path | None,
    as_json: bool,
    lines: list[str],
    draw: Callable[[Path], Path],
) -> None:
    """Print a result, as JSON or as lines, and keep it in ``output`` with the picture that ``draw``
    makes there. What cannot be written is said all the same.
    """
    from pianobot_ros.piano.identify.state import plain

    data, failed = {**plain(result), "pictures": []}, None
    if output is not None:
        try:
            output.mkdir(parents=True, exist_ok=True)
            data["pictures"] = [str(draw(output))]
            (output / RESULT).write_text(json.dumps(data, indent=1), encoding="utf-8")
        except OSError as error:
            failed = error
    if as_json:
        typer.echo(json.dumps(data))
    else:
        for line in (*lines, *(f"Picture: {p}" for p in data["pictures"])):
            typer.echo(line)
    if failed:
        raise PianobotError(f"cannot write to {output}: {failed.strerror or failed}") from failed


@app.command("keystroke")
def keystroke(
    recording: Annotated[
        Path,
        typer.Argument(help="Bag of a key with encoder, or CSV with columns time, force, angle."),
    ],
    note: Annotated[
        int, typer.Option(min=0, max=127, help="MIDI note (0: the key that carries the sensor).")
    ] = 0,
    seed: Annotated[int, seed_option("Seed of the Bayesian optimisation.")] = 0,
    iterations: Annotated[
        int, typer.Option(min=0, help="Iterations of the Bayesian optimisation.")
    ] = 20,
    force_error: Annotated[
        float | None,
        number(
            "Standard error of the force sensor's gain, 0.02 for 2 % (default: priors.yaml).",
            0.0,
            1.0,
        ),
    ] = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Stiffness, damping, stop and touch weight of a key from load and release."""
    from pianobot_ros.piano.identify.key.key_estimate import identify_keystroke
    from pianobot_ros.piano.identify.key.load_test import read_load_test
    from pianobot_ros.piano.identify.plots import plot_keystroke

    test = read_load_test(recording, note or None)
    with progress_bar(as_json) as progress:
        fit = identify_keystroke(
            test, seed=seed, force_error=force_error, bayes_iterations=iterations, progress=progress
        )
    lines = [
        f"{e.name:16} {e.value:10.4g} {'' if e.unit == '1' else e.unit:11}"
        f" 95 %: {e.low:.4g} to {e.high:.4g}"
        for e in fit.estimates
    ]
    lines.append(
        f"error on presses not fitted: {1e3 * fit.rms:.3f} mrad; bounce"
        f" {1e3 * fit.bounce_measured:.0f} ms, model {1e3 * fit.bounce_modelled:.0f} ms"
    )
    if fit.bayes:
        lines.append(
            f"the paper's method on the same data: stiffness {fit.bayes['stiffness']:.4g} N*m/rad, "
            f"damping {fit.bayes['damping']:.4g} N*m*s/rad"
        )
    lines += [f"Note: {w}" for w in fit.warnings]
    emit(fit.as_dict(), output, as_json, lines, partial(plot_keystroke, fit))


@app.command("vacuum")
def vacuum(
    recordings: Recordings,
    write_calibration: Annotated[
        Path | None,
        typer.Option(
            help="Write a calibration (config/calibration/stiffness.yaml) that sim_twin loads.",
            callback=new_file,
        ),
    ] = None,
    cell: Cell = "real",
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Joint stiffness at each vacuum level, loading and unloading apart.

    Everything else that is not known (gains, triggers, key, damping, stamps) is estimated with it.
    """
    from pianobot_ros.piano.identify.cell import vacuum as curves
    from pianobot_ros.piano.identify.plots import plot_vacuum

    with progress_bar(as_json) as progress:
        takes = _takes(recordings, cell, progress)
        progress("stiffness at each level", 0.3)
        curve = curves.identify_vacuum(takes)
    lines = [
        f"{in_kpa(x.pressure):>10} {x.branch:9} {x.stiffness:8.3g} N*m/rad  90 %: {x.low:.3g} to"
        f" {x.high:.3g} ({x.strikes} strikes)"
        for x in curve.levels
    ]
    lines += values_of(curve.known)
    lines += [
        f"hysteresis at {in_kpa(h['pressure'])}: loading {h['loading']:.3g}, unloading"
        f" {h['unloading']:.3g} N*m/rad"
        for h in curve.hysteresis
    ]
    notes = [f"Note: {w}" for w in curve.warnings]
    if curve.decides:
        notes.append(f"What would decide it: {curve.decides}")
    emit(curve.as_dict(), output, as_json, lines + notes, partial(plot_vacuum, curve))
    if write_calibration is not None:
        source = ", ".join(path.name for path in recordings)
        written = curves.write_calibration(curve, write_calibration, source)
        if not as_json:
            typer.echo(f"Calibration: {written}")


@app.command("parameters")
def parameters(
    recordings: Recordings,
    names: Annotated[
        str,
        typer.Option(
            help="Comma-separated names of config/priors.yaml that are shown; all are estimated."
        ),
    ] = "",
    cell: Cell = "real",
    output: Output = None,
    as_json: Json = False,
) -> None:
    """All parameters at once.

    Stiffness for each vacuum level, damping, key, gains, trigger angles, stamps.
    """
    from pianobot_ros.piano.identify.cell.held_out import PARAMETERS, fit_parameters
    from pianobot_ros.piano.identify.plots import plot_parameters

    shown = tuple(n.strip() for n in names.split(",") if n.strip()) or PARAMETERS
    with progress_bar(as_json) as progress:
        takes = _takes(recordings, cell, progress)
        progress("everything at once", 0.3)
        fit = fit_parameters(takes, shown)
    lines = values_of(fit.estimates)
    lines.append(
        f"Err (Eq. 5): before {100 * fit.err_before:.2f} %, fitted strikes"
        f" {100 * fit.err_after:.2f} %, others {100 * fit.err_held_out:.2f} %"
    )
    notes = [f"Note: {w}" for w in fit.warnings]
    if fit.decides:
        notes.append(f"What would decide the stiffness: {fit.decides}")
    emit(fit.as_dict(), output, as_json, lines + notes, partial(plot_parameters, fit))


def values_of(known: Iterable[Known]) -> list[str]:
    """Lines of estimated values with their 90 % intervals; what the data leave open is said."""
    return [
        f"{k.name:24} {k.value:10.4g} {k.unit if k.unit != '1' else '':4} 90 %: {k.low:.4g} to"
        f" {k.high:.4g}" + ("" if k.identifiable else "  open")
        for k in known
    ]


def _takes(recordings: list[Path], cell: str, progress: Callable[[str, float], None]) -> list[Any]:
    from pianobot_ros.bags.reading.read import read_bag
    from pianobot_ros.piano.identify.takes.take import takes_from_recording

    takes = []
    for i, path in enumerate(recordings):
        progress(f"reading {path.name}", 0.3 * i / len(recordings))
        takes += takes_from_recording(read_bag(path), cell)
    return takes
