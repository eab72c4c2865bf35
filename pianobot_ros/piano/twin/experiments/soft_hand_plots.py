"""The plots of the soft hand's experiments, after Figs. 7 and 8 of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.piano.twin.experiments.glissando import GlissandoRun
from pianobot_ros.piano.twin.experiments.repetition import Repetition
from pianobot_ros.piano.twin.experiments.single_note import NOTE, SingleNote
from pianobot_ros.piano.twin.experiments.two_notes import G_SHARP, E, TwoNotes

__all__ = [
    "plot_glissando",
    "plot_repetition",
    "plot_single_note",
    "plot_two_notes",
    "shared_figure",
]

NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
PAPER_PEAK = (3.71, 14.6)  # its unit, at 0.05 and 2 N m/deg
BLUE, RED, GREY = "#1f5f99", "#b8432f", "#777777"
_SIDES = (
    ("jack out", "let-off", "right"),
    ("hammer checked", "checked", "left"),
    ("jack back", "jack back", "left"),
)


def shared_figure(columns: int, width: float, height: float) -> tuple[Any, Any]:
    """A figure without a display, with so many axes side by side."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, columns, squeeze=False)[0]
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.25, linewidth=0.6)
    return figure, axes


def _levels(axis: Any) -> None:
    board = keyboard()
    for level, text in ((board.midi.trigger_on, "trigger"), (board.mechanism.max_angle, "bed")):
        axis.axhline(1e3 * level, color=GREY, linewidth=0.8, linestyle="--")
        axis.annotate(
            text,
            (0.995, 1e3 * level),
            xycoords=("axes fraction", "data"),
            ha="right",
            va="bottom",
            color=GREY,
            fontsize=8,
        )


def plot_single_note(single: SingleNote, path: Path) -> None:
    """Key angle and contact force against time, peak force against stiffness."""
    from matplotlib import colormaps

    figure, (angle, force, peak) = shared_figure(3, 12.5, 3.7)
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(single.runs)))
    for k, run, shade in zip(single.stiffness, single.runs, shades, strict=True):
        theta, _, newton = run.key(NOTE)
        angle.plot(run.time, 1e3 * theta, color=shade, linewidth=1.3, label=f"{k:g}")
        force.plot(run.time, newton, color=shade, linewidth=1.3)
    _levels(angle)
    angle.set(xlabel="time (s)", ylabel="key angle (mrad)", title="The key moves alike")
    angle.set_ylim(-2, 92)
    angle.legend(
        title="k (N m/deg)", fontsize=8, title_fontsize=8, frameon=False, loc="upper left", ncols=3
    )
    force.set(
        xlabel="time (s)", ylabel="contact force (N)", title="The force rises, from the key bed on"
    )
    theta, _, newton = single.runs[-1].key(NOTE)
    met = int(np.argmax(theta >= keyboard().mechanism.max_angle))
    force.annotate(
        "bulge: key\nat its bed",
        (single.runs[-1].time[met], newton[met]),
        xytext=(0.05, 0.55),
        textcoords="axes fraction",
        arrowprops={"arrowstyle": "->", "color": GREY},
        color=GREY,
        fontsize=8,
    )
    share = single.peak_force / single.peak_force[-1]
    peak.plot(single.stiffness, share, "o-", color=BLUE, label=f"ours, of {newton.max():.1f} N")
    peak.plot([0.05, 2.0], np.array(PAPER_PEAK) / PAPER_PEAK[1], "s--", color=RED, label="paper")
    peak.set(
        xscale="log",
        xlabel="joint stiffness k (N m/deg)",
        ylabel="peak force over that at 2 N m/deg",
        title="Peak force, normalised",
        ylim=(0, 1.1),
    )
    peak.legend(fontsize=8, frameon=False, loc="lower right")
    figure.savefig(path)


def plot_glissando(slide: GlissandoRun, path: Path) -> None:
    """Notes as a piano roll, and their velocities."""
    figure, (roll, keys) = shared_figure(2, 11, 3.6)
    velocity = {e.note: e.velocity for e in slide.presses}
    for stroke in slide.run.strokes:
        inner = slide.notes[0] < stroke.note < slide.notes[-1]
        roll.barh(
            slide.notes.index(stroke.note),
            stroke.t_hold,
            left=stroke.onset,
            height=0.6,
            color=BLUE if inner else RED,
        )
        centre = (stroke.onset + stroke.t_hold / 2, slide.notes.index(stroke.note))
        roll.annotate(
            str(velocity[stroke.note]), centre, ha="center", va="center", color="white", fontsize=8
        )
    roll.set_yticks(range(len(slide.notes)), [NAMES[n % 12] for n in slide.notes])
    roll.set(
        xlabel="time (s)", title="Notes with their MIDI velocities", xlim=(0.0, slide.run.time[-1])
    )
    for note in slide.notes:
        theta = slide.run.key(note)[0]
        keys.plot(
            slide.run.time,
            1e3 * theta,
            linewidth=1.2,
            color=BLUE if slide.notes[0] < note < slide.notes[-1] else RED,
        )
    _levels(keys)
    keys.set(xlabel="time (s)", ylabel="key angle (mrad)", title="The thumb passes the white keys")
    figure.savefig(path)


def plot_two_notes(two: TwoNotes, path: Path) -> None:
    """Both keys' angles, each struck slowly and then swiftly."""
    figure, (axis,) = shared_figure(1, 9, 3.5)
    for note, colour, who in ((E, BLUE, "E, thumb"), (G_SHARP, RED, "G#, middle finger")):
        slow, swift = (1e3 * s.t_hold for s in two.strokes(note))
        axis.plot(
            two.run.time,
            1e3 * two.run.key(note)[0],
            color=colour,
            linewidth=1.4,
            label=f"{who}: T_hold {slow:.0f} ms, then {swift:.0f} ms",
        )
    _levels(axis)
    axis.set(
        xlabel="time (s)",
        ylabel="key angle (mrad)",
        title="Two-note stretch, slow and then swift",
        ylim=(-2, 72),
    )
    axis.legend(fontsize=8, frameon=False, loc="upper left", ncols=2)
    figure.savefig(path)


def plot_repetition(again: Repetition, path: Path) -> None:
    """Key angle and contact force of the repeated note, with and without the repetition lever."""
    figure, _ = shared_figure(1, 11, 5)
    figure.clear()
    grid = figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=[3, 2])
    for (angle, force), run, name in zip(
        grid.T, (again.with_lever, again.without), ("with", "without"), strict=True
    ):
        theta, _, newton = run.key(NOTE)
        struck = [e.time for e in run.action if e.rule == "string made"]
        angle.plot(run.time, 1e3 * theta, color=BLUE, linewidth=1.4, label="key")
        at = 1e3 * np.interp(struck, run.time, theta)
        angle.plot(
            struck, at, "*", color=RED, markersize=11, label=f"hammer meets string: {len(struck)}"
        )
        for rule, text, side in _SIDES:
            for event in run.action:
                if event.rule.startswith(rule):
                    angle.axvline(event.time, color=GREY, linewidth=0.6, linestyle=":")
                    angle.annotate(
                        text,
                        (event.time, 1.0),
                        rotation=90,
                        ha=side,
                        va="bottom",
                        fontsize=7,
                        color=GREY,
                    )
        angle.set(title=f"Piano action, {name} repetition lever")
        angle.legend(fontsize=8, frameon=False, loc="upper left")
        force.plot(run.time, newton, color=BLUE, linewidth=1.2)
        force.set(xlabel="time (s)")
        for axis in (angle, force):
            axis.spines[["top", "right"]].set_visible(False)
            axis.grid(alpha=0.25, linewidth=0.6)
    grid[0, 0].set(ylabel="key angle (mrad)", ylim=(-3, 82))
    grid[1, 0].set(ylabel="contact force (N)")
    figure.savefig(path)
