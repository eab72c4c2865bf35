"""Pictures of what was identified: fit over data, profile, convergence. Drawn without a display."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.piano.identify.cell.dynamics import Played
from pianobot_ros.piano.identify.cell.held_out import ParameterFit
from pianobot_ros.piano.identify.cell.vacuum import VacuumCurve
from pianobot_ros.piano.identify.key.key_estimate import KeystrokeFit
from pianobot_ros.piano.identify.stiffness import Profile, StiffnessFit

__all__ = ["plot_dynamics", "plot_keystroke", "plot_parameters", "plot_stiffness", "plot_vacuum"]

BLUE, RED, GREY = "#1f77b4", "#d62728", "0.6"


def _figure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    return figure, axes


def _save(figure: Any, path: Path) -> Path:
    from matplotlib import pyplot

    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
    return path


def plot_keystroke(fit: KeystrokeFit, folder: Path) -> Path:
    """Measured and modelled angle of presses that were not fitted, and the residual."""
    count = len(fit.presses)
    figure, axes = _figure(2, count, (3.4 * count, 4.6))
    for column, press in enumerate(fit.presses):
        time = np.array(press["time"]) - press["time"][0]
        measured, modelled = 1e3 * np.array(press["measured"]), 1e3 * np.array(press["modelled"])
        top, bottom = axes[0, column], axes[1, column]
        top.plot(time, measured, color=GREY, lw=3, label="measured")
        top.plot(time, modelled, color=RED, lw=1, label="model")
        twin = top.twinx()
        twin.plot(time, press["force"], color=BLUE, lw=0.8)
        twin.set_ylim(top=1.35 * max(press["force"]))
        twin.set_ylabel("force [N]", color=BLUE)
        top.set_ylabel("angle [mrad]")
        bottom.plot(time, modelled - measured, color=RED, lw=1)
        bottom.set(xlabel="time [s]", ylabel="residual [mrad]")
        top.set_ylim(top=1.35 * max(measured.max(), modelled.max()))
    axes[0, 0].legend(loc="upper left", fontsize=8, ncols=2)
    return _save(figure, folder / "keystroke.png")


def _profile(axis: Any, profile: Profile, truth: float | None = None) -> None:
    axis.semilogx(
        profile.stiffness, np.array(profile.misfit) - min(profile.misfit), "o-", color=BLUE, ms=3
    )
    axis.axvspan(profile.low, profile.high, color=BLUE, alpha=0.15)
    if truth is not None:
        axis.axvline(truth, color=RED, ls="--")
    axis.set_yscale("symlog", linthresh=4)
    axis.set_ylim(bottom=-0.5)
    axis.set(xlabel="stiffness [N m/rad]", ylabel="chi-square above its minimum")


def plot_stiffness(fit: StiffnessFit, folder: Path, truth: float | None = None) -> Path:
    """Convergence, profile with its 95 % interval, and the keystrokes side by side (the paper's
    Fig. 9).
    """
    figure, axes = _figure(1, 4, (15, 3.4))
    values = np.array([h["objective"] for h in fit.history])
    axes[0, 0].semilogy(np.arange(1, len(values) + 1), values, "o", color=GREY, ms=4, label="tried")
    axes[0, 0].semilogy(
        np.arange(1, len(values) + 1), np.minimum.accumulate(values), color=RED, label="best"
    )
    axes[0, 0].set(xlabel="iteration", ylabel="objective")
    axes[0, 0].legend(fontsize=8)
    _profile(axes[0, 1], fit.profile, truth)
    shown = [k for k in fit.keystrokes if k["reference"] and k["twin"]][:12]
    place = np.arange(len(shown))
    for axis, names, unit in (
        (axes[0, 2], ("v_pre", "v_rel"), "m/s"),
        (axes[0, 3], ("t_hold", "t_idle"), "s"),
    ):
        for i, name in enumerate(names):
            for j, (who, colour) in enumerate((("reference", GREY), ("twin", RED))):
                heights = [k[who][name] for k in shown]
                axis.bar(
                    place + 0.2 * (2 * i + j) - 0.3,
                    heights,
                    0.19,
                    color=colour,
                    alpha=1 - 0.45 * i,
                    label=f"{name} {who}",
                )
        axis.set_xticks(place, [f"{k['finger'][0]}{k['note']}" for k in shown], fontsize=8)
        axis.set_ylabel(f"[{unit}]")
        axis.set_ylim(top=1.4 * axis.get_ylim()[1])
        axis.legend(fontsize=7, ncols=2, loc="upper left")
    return _save(figure, folder / "stiffness.png")


def plot_vacuum(
    curve: VacuumCurve, folder: Path, truth: Callable[[float], float] | None = None
) -> Path:
    """Stiffness against vacuum with intervals; loading and unloading apart. ``truth``: the hidden
    stiffness, N m/rad, at a pressure, Pa.
    """
    figure, axes = _figure(1, 1, (5, 3.6))
    if truth is not None:
        pressures = np.linspace(*_ends([level.pressure for level in curve.levels]), 50)
        hidden = [truth(p) for p in pressures.tolist()]
        axes[0, 0].plot(-pressures / 1e3, hidden, color=GREY, ls="--", label="hidden")
    for branch, colour, shift in (
        ("all", "black", 0.0),
        ("loading", BLUE, -0.8),
        ("unloading", RED, 0.8),
    ):
        levels = [level for level in curve.levels if level.branch == branch]
        if levels:
            x = [-level.pressure / 1e3 + shift for level in levels]
            k = np.array([level.stiffness for level in levels])
            spread = np.array(
                [[level.stiffness - level.low, level.high - level.stiffness] for level in levels]
            ).T
            axes[0, 0].errorbar(
                x, k, np.maximum(spread, 0), fmt="o", color=colour, capsize=3, label=branch
            )
    axes[0, 0].set(xlabel="vacuum [kPa]", ylabel="stiffness [N m/rad]", yscale="log")
    axes[0, 0].legend(fontsize=8)
    return _save(figure, folder / "vacuum.png")


def _ends(values: Sequence[float]) -> tuple[float, float]:
    return min(values), max(values)


def plot_parameters(fit: ParameterFit, folder: Path) -> Path:
    """Factors on the configured values with their intervals."""
    shown = [e for e in fit.estimates if e.low > 0]
    figure, axes = _figure(1, 1, (5, 0.5 * len(shown) + 1.4))
    for i, e in enumerate(shown):
        colour = BLUE if e.identifiable else GREY
        axes[0, 0].plot([e.low, e.high], [i, i], color=colour)
        axes[0, 0].plot(e.value, i, "o", color=colour)
    axes[0, 0].axvline(1.0, color=GREY, ls=":")
    axes[0, 0].set_yticks(range(len(shown)), [e.name for e in shown])
    axes[0, 0].set(xlabel="factor on the configured value", xscale="log")
    return _save(figure, folder / "parameters.png")


def plot_dynamics(played: Sequence[Played], folder: Path, heard: Sequence[float] = ()) -> Path:
    """Asked against played velocity; ``heard`` are those of a real or emulated cell."""
    figure, axes = _figure(1, 1, (4.6, 4.2))
    asked = [p.wanted.velocity for p in played]
    axes[0, 0].plot([0, 127], [0, 127], color=GREY, ls=":")
    axes[0, 0].plot(asked, [p.velocity for p in played], "o", mfc="none", color=BLUE, label="twin")
    if len(heard):
        axes[0, 0].plot(asked, heard, "x", color=RED, label="played on the cell")
    axes[0, 0].set(
        xlabel="velocity asked for", ylabel="velocity played", xlim=(0, 127), ylim=(0, 127)
    )
    axes[0, 0].legend(fontsize=8)
    return _save(figure, folder / "dynamics.png")
