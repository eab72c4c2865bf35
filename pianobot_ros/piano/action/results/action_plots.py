"""Figures of the piano action: Bode plots as in Figs. 5 and 7, the step of Figs. 9 and 10, and the
repeated note.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pianobot_ros.piano.action.hybrid.simulator import Trajectory
from pianobot_ros.piano.action.mujoco.mujoco_hybrid import MujocoHistory
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.action.rig.frf import FrequencyResponse
from pianobot_ros.piano.action.rig.transfer_fit import TableTwo, response_of
from pianobot_ros.piano.action.rig.voice_coil import TrialKind

__all__ = ["plot_bode", "plot_fits", "plot_repetition", "plot_step", "plot_step_force"]

_LOW, _HIGH = 0.5, 100.0  # Hz, the range of Fig. 5
_COLOURS: dict[TrialKind, str] = {
    "A": "#1b6ca8",
    "AK": "#c46210",
    "AKW": "#7a7a7a",
    "AKWH": "#2e7d32",
    "AKR": "#6a1b9a",
}
_WORDS = {
    "bottom": "key bottoms",
    "release": "hammer leaves",
    "land": "hammer lands",
    "lift": "key lifts",
}
_MODES = ("ACCELERATION", "FREE FLIGHT", "RAIL STOP", "REPETITION")


def _save(figure: Figure, path: Path) -> Path:
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    return path


def _degrees(response: np.ndarray) -> np.ndarray:
    """Phase [deg] without jumps, from its value at low frequency."""
    return np.asarray(np.rad2deg(np.unwrap(np.angle(response))))


def _decibels(response: np.ndarray) -> np.ndarray:
    return np.asarray(20 * np.log10(np.abs(response)))


def _thin(estimate: FrequencyResponse, points: int = 600) -> FrequencyResponse:
    """About ``points`` bins at even ratios: averages in ratio would hide the scatter, so bins are
    picked.
    """
    band = estimate.band(_LOW, _HIGH)
    wanted = np.geomspace(band.frequency[0], band.frequency[-1], points)
    pick = np.unique(np.searchsorted(band.frequency, wanted).clip(0, band.frequency.size - 1))
    return FrequencyResponse(
        band.frequency[pick], band.response[pick], band.coherence[pick], band.hold, band.averages
    )


def plot_bode(responses: Mapping[TrialKind, FrequencyResponse], path: Path) -> Path:
    """As Fig. 5: estimated X/I of the preparations, with the coherence that Fig. 5 leaves out."""
    figure = Figure(figsize=(7.5, 7.5), layout="constrained")
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=[3, 3, 1.6])
    for kind in ("A", "AK", "AKW", "AKWH"):
        if kind not in responses:
            continue
        band = _thin(responses[kind])
        style = {"color": _COLOURS[kind], "lw": 1.1, "ls": "--" if kind == "AKW" else "-"}
        magnitude.semilogx(band.frequency, _decibels(band.response), label=kind, **style)
        phase.semilogx(band.frequency, _degrees(band.response), **style)
        coherence.semilogx(band.frequency, band.coherence, **style)
    magnitude.set_ylabel("|X/I| (dB re 1 m/A)")
    magnitude.set_title("Simulated rig, 15 min of white noise: four preparations (cf. Fig. 5)")
    magnitude.legend()
    phase.set_ylabel("phase (deg)")
    coherence.set(
        ylabel="coherence", xlabel="frequency (Hz)", ylim=(0.95, 1.003), xlim=(_LOW, _HIGH)
    )
    for axis in (magnitude, phase, coherence):
        axis.grid(True, which="both", alpha=0.25)
    return _save(figure, path)


def plot_fits(table: TableTwo, path: Path) -> Path:
    """As Fig. 7: the fitted models over the estimates they were fitted to."""
    figure = Figure(figsize=(11, 5.5), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True, sharey="row")
    panels: tuple[tuple[TrialKind, ...], ...] = (("A",), ("AK", "AKW"), ("AKWH",))
    for column, kinds in enumerate(panels):
        top, bottom = axes[0, column], axes[1, column]
        for kind in kinds:
            band = _thin(table.responses[kind])
            top.semilogx(
                band.frequency,
                _decibels(band.response),
                ".",
                ms=2.5,
                color=_COLOURS[kind],
                label=f"estimate {kind}",
            )
            bottom.semilogx(
                band.frequency, _degrees(band.response), ".", ms=2.5, color=_COLOURS[kind]
            )
        frequency = np.geomspace(_LOW, _HIGH, 400)
        model = response_of(table.parameters, kinds[0], frequency, table.responses[kinds[0]].hold)
        top.semilogx(frequency, _decibels(model), "k-", lw=1.0, label=f"model {kinds[0]}")
        bottom.semilogx(frequency, _degrees(model), "k-", lw=1.0)
        top.set_title(f"({'abc'[column]}) {' and '.join(kinds)}")
        top.legend(fontsize=8)
        bottom.set_xlabel("frequency (Hz)")
        for axis in (top, bottom):
            axis.grid(True, which="both", alpha=0.25)
    axes[0, 0].set_ylabel("|X/I| (dB re 1 m/A)")
    axes[1, 0].set_ylabel("phase (deg)")
    return _save(figure, path)


def plot_step(
    paths: Mapping[str, Trajectory], mujoco: MujocoHistory, parameters: ActionParameters, path: Path
) -> Path:
    """As Fig. 9: key, hammer and mode against time; ``paths`` by label, the first with its mode and
    with MuJoCo over it.
    """
    figure = Figure(figsize=(8, 6.5), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    for i, (label, trajectory) in enumerate(paths.items()):
        h = trajectory.sample(5e-4)
        alpha = 1.0 if i == 0 else 0.45
        colour = ("#1b6ca8", "#c46210", "#2e7d32")[i % 3]
        top.plot(h.time * 1e3, h.key * 1e3, color=colour, alpha=alpha, label=f"key, {label}")
        top.plot(
            h.time * 1e3,
            h.hammer * 1e3,
            "--",
            color=colour,
            alpha=alpha,
            label=f"hammer / 5, {label}",
        )
        if i == 0:
            bottom.step(h.time * 1e3, [_MODES.index(m) for m in h.mode], where="post", color=colour)
    every = max(1, mujoco.time.size // 60)
    top.plot(mujoco.time[::every] * 1e3, mujoco.key[::every] * 1e3, "k.", ms=3, label="MuJoCo")
    top.plot(mujoco.time[::every] * 1e3, mujoco.hammer[::every] * 1e3, "k.", ms=3)
    top.axhline(parameters.key.dip * 1e3, color="0.6", lw=0.8)
    top.text(2, parameters.key.dip * 1e3 + 0.4, "front rail", color="0.4", fontsize=8)
    _mark(top, next(iter(paths.values())), parameters)
    top.set(
        ylabel="displacement at the key (mm)",
        title="2 A step (4.1 N) on the hybrid model (cf. Fig. 9)",
    )
    top.legend(fontsize=8)
    bottom.set(xlabel="time after the step (ms)", ylim=(-0.4, 3.4))
    bottom.set_yticks(range(4), _MODES, fontsize=8)
    for axis in (top, bottom):
        axis.grid(True, alpha=0.25)
    return _save(figure, path)


def _mark(axis: Axes, trajectory: Trajectory, parameters: ActionParameters) -> None:
    """Name what happens at the foot of the plot, and at its head when the paper has it."""
    foot = axis.get_xaxis_transform()
    for event in trajectory.events:
        if event.rule not in _WORDS:
            continue
        axis.axvline(event.time * 1e3, color="0.7", lw=0.8)
        side = "right" if event.rule == "bottom" else "left"
        axis.text(
            event.time * 1e3,
            0.02,
            f" {_WORDS[event.rule]} ",
            fontsize=8,
            color="0.3",
            ha=side,
            transform=foot,
        )
    paper = parameters.published
    times = [(t - paper.step_time) * 1e3 for t in (paper.bottoming, paper.landing)]
    label = f"paper: bottoms {times[0]:.0f} ms, lands {times[1]:.0f} ms"
    for i, at in enumerate(times):
        axis.axvline(at, color="#6a1b9a", lw=1.0, ls=":", label=label if i == 0 else None)


def plot_step_force(
    paths: Mapping[str, Trajectory], parameters: ActionParameters, path: Path
) -> Path:
    """As Fig. 10: the force between armature and key."""
    figure = Figure(figsize=(8, 4), layout="constrained")
    axis = figure.subplots()
    for i, (label, trajectory) in enumerate(paths.items()):
        h = trajectory.sample(2.5e-4)
        axis.plot(
            h.time * 1e3,
            h.load_cell,
            color=("#1b6ca8", "#c46210", "#2e7d32")[i % 3],
            lw=1.1,
            label=label,
        )
    _mark(axis, next(iter(paths.values())), parameters)
    axis.set(
        xlabel="time after the step (ms)",
        ylabel="force armature on key (N)",
        title="2 A step: load cell (cf. Fig. 10)",
        ylim=(0, None),
    )
    first = next(iter(paths.values()))
    when = {event.rule: event.time for event in reversed(first.events)}
    history = first.sample(2.5e-4)
    for text, start, end in (
        ("initial excursion", 0.0, when["bottom"]),
        ("bottoming", when["bottom"], when["bottom"] + 0.03),
        ("landing", when["land"], when["land"] + 0.05),
    ):
        inside = np.flatnonzero((history.time >= start) & (history.time < end))
        peak = inside[np.argmax(history.load_cell[inside])]
        where = (history.time[peak] * 1e3, history.load_cell[peak])
        axis.annotate(text, where, xytext=(6, 2), textcoords="offset points", fontsize=8)
    axis.grid(True, alpha=0.25)
    axis.legend(fontsize=8)
    return _save(figure, path)


def plot_repetition(
    paths: Mapping[str, Trajectory], parameters: ActionParameters, path: Path
) -> Path:
    """Key and hammer of a quickly repeated note; ``paths`` by label, one panel each."""
    figure = Figure(figsize=(8, 6.5), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(paths), 1, sharex=True, sharey=True))
    for axis, (label, trajectory) in zip(axes, paths.items(), strict=True):
        h = trajectory.sample(5e-4)
        axis.plot(h.time * 1e3, h.key * 1e3, color="#1b6ca8", label="key")
        axis.plot(h.time * 1e3, h.hammer * 1e3, color="#c46210", label="hammer / 5")
        axis.axhline(parameters.string.height * 1e3, color="0.6", lw=0.8)
        axis.text(
            600,
            parameters.string.height * 1e3 + 0.15,
            "string",
            color="0.4",
            fontsize=8,
            ha="right",
        )
        struck = [e.time * 1e3 for e in trajectory.events if e.rule == "string made"]
        axis.plot(
            struck,
            [parameters.string.height * 1e3] * len(struck),
            "k*",
            ms=9,
            label=f"string struck: {len(struck)}",
        )
        axis.set(ylabel="displacement (mm)", title=label)
        axis.grid(True, alpha=0.25)
        axis.legend(fontsize=8, loc="upper right")
    axes[-1].set_xlabel("time (ms)")
    return _save(figure, path)
