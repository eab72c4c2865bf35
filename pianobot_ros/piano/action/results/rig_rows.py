"""Rows and the picture of what the rig tells beside X/I: load cell, linearisation, rail."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pianobot_ros.cell.numbers.config import load_provenance
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.action.results.paper_tables import TableRow, truth_of
from pianobot_ros.piano.action.rig.linearise import Linearised, linearise
from pianobot_ros.piano.action.rig.load_cell import (
    DURATION,
    DrivingPoint,
    RailPress,
    compliance,
    driving_point,
    press_rail,
)
from pianobot_ros.piano.action.rig.transfer_fit import RigEstimate
from pianobot_ros.piano.action.rig.voice_coil import TrialKind

__all__ = ["RigResults", "plot_rig", "rig_results", "rig_rows"]


class RigResults:
    """The experiments beside the four preparations, deterministic in ``seed``; ``duration`` s
    shortens the noise.
    """

    def __init__(self, p: ActionParameters, seed: int, duration: float | None = None) -> None:
        length = min(duration or DURATION, DURATION)
        self.key = driving_point(p, "AK", seed=seed + 11, duration=length)
        self.hammer = driving_point(
            p, "AKWH", seed=seed + 12, duration=length, known=self.key.parameters
        )
        self.rail: RailPress = press_rail(p, seed=seed + 13)
        self.coil: Linearised = linearise(p, seed=seed + 14)


def rig_results(p: ActionParameters, seed: int, duration: float | None = None) -> RigResults:
    """Run them."""
    return RigResults(p, seed, duration)


def rig_rows(p: ActionParameters, found: RigResults) -> list[TableRow]:
    """What they gave, against Table 2."""
    units = load_provenance("action.yaml")
    rows = []

    def row(name: tuple[str, str], e: RigEstimate, how: str) -> TableRow:
        truth, unit = truth_of(p, name), units[".".join(name)]["unit"]
        words = " ".join(name).replace("_", " ")
        return TableRow(
            f"{words}, {how}",
            f"{e.value:.4g} {unit}",
            f"{truth:g} {unit}",
            f"{100 * (e.value / truth - 1):+.1f} %",
        )

    for point in (found.key, found.hammer):
        rows += [row(n, e, "load cell only") for n, e in point.estimates.items()]
    rows += [
        row(("front_rail", "stiffness"), found.rail.stiffness, "pressed, F against x"),
        row(("front_rail", "damping"), found.rail.damping, "pressed, F against x"),
        TableRow(
            "voice coil: off a straight line, before and after the third-order feed-forward",
            f"{100 * found.coil.off_before:.1f} %, {100 * found.coil.off_after:.2f} %",
            "linear",
            "how bent flexure and field are is free (config/action.yaml: curve)",
        ),
        TableRow(
            "voice coil: stiffness that is left",
            f"{found.coil.stiffness:.1f} N/m",
            f"{p.armature.stiffness:g} N/m",
        ),
    ]
    return rows


def plot_rig(p: ActionParameters, found: RigResults, path: Path) -> Path:
    """Driving point at the key, force against displacement on the rail, coil before and after."""
    figure = Figure(figsize=(12.5, 4), layout="constrained")
    point, rail, coil = figure.subplots(1, 3)
    shown: tuple[tuple[TrialKind, DrivingPoint, str], ...] = (
        ("AK", found.key, "#c46210"),
        ("AKWH", found.hammer, "#2e7d32"),
    )
    for name, measured, colour in shown:
        band = measured.response
        every = max(1, band.frequency.size // 300)
        point.loglog(
            band.frequency[::every],
            np.abs(band.response[::every]),
            ".",
            ms=2.5,
            color=colour,
            label=f"load cell, {name}",
        )
        model = compliance(measured.parameters, name, band.frequency)
        point.loglog(band.frequency, np.abs(model), "k-", lw=0.8)
    point.set(
        xlabel="frequency (Hz)", ylabel="|X/F| (m/N)", title="Driving point at the key, no armature"
    )
    point.legend(fontsize=8, loc="lower left")
    press = found.rail
    rail.plot(1e3 * press.displacement, press.force, color="#6a1b9a", lw=0.9)
    deep = np.linspace(p.key.dip, float(press.displacement.max()), 2)
    rail.plot(
        1e3 * deep,
        press.stiffness.value * (deep - p.key.dip),
        "k--",
        lw=0.9,
        label=f"{press.stiffness.value:.0f} N/m",
    )
    rail.set(xlabel="key (mm)", ylabel="load cell (N)", title="Key pressed against the front rail")
    rail.legend(fontsize=8, loc="upper left")
    for current, label in ((found.coil.before, "alone"), (found.coil.after, "compensated")):
        coil.plot(1e3 * found.coil.displacement, current, ".-", ms=3, lw=0.8, label=label)
    coil.set(xlabel="armature (mm)", ylabel="current (A)", title="Third-order feed-forward")
    coil.legend(fontsize=8, loc="upper left")
    for axis in (point, rail, coil):
        axis.grid(True, which="both", alpha=0.25)
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    return path
