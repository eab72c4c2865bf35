"""Pictures and rows of what key and finger feel of each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pianobot_ros.piano.twin.experiments.feel import (
    FRICTION_STIFFNESS,
    JAMMED,
    LOADS,
    STIFFNESSES,
    FeelSource,
    Friction,
    contact_friction,
    sources,
    tip_displacement,
)
from pianobot_ros.piano.twin.experiments.single_note import DEGREE
from pianobot_ros.piano.twin.experiments.soft_hand_plots import BLUE, RED, shared_figure

__all__ = ["FEEL", "feel_rows", "plot_feel"]

FEEL = "hand-feel.png"
FREQUENCY = np.geomspace(0.5, 60.0, 200)  # Hz
TABLE = (1.0, 5.0, 20.0)  # Hz
LIGHT = 1.0  # N: load of the table


def feel_rows() -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """Rows of the comparison with the soft-hand paper, and rows of the impedances at the key."""
    friction = contact_friction()
    moved = [1e3 * float(tip_displacement(k * DEGREE, [LIGHT])[0]) for k in STIFFNESSES]
    rows = [
        {
            "figure": "7(a)",
            "quantity": f"tip displacement under {LIGHT:g} N at k = "
            + ", ".join(f"{k:g}" for k in STIFFNESSES)
            + " N m/deg",
            "ours": ", ".join(f"{d:.2f}" for d in moved) + " mm",
            "paper": "falls with the vacuum; axes without numbers in the text",
        },
        {
            "figure": "II-B",
            "quantity": f"friction at the contact, k = {FRICTION_STIFFNESS:g} N m/deg: "
            "largest, share of the normal force there, share of the contact in which it slips",
            "ours": _friction(friction),
            "paper": "measured, not shown",
        },
    ]
    lowest, highest = JAMMED[0][1:]
    rows.append(
        {
            "figure": "8",
            "quantity": f"k, {STIFFNESSES[0]:g} to {STIFFNESSES[-1]:g} N m/deg, in N m/rad; against"
            " a jammed finger joint that was measured",
            "ours": f"{JAMMED[1][1]:.2g} to {JAMMED[1][2]:.3g}; {JAMMED[1][1] / highest:.1f} to"
            f" {JAMMED[1][2] / highest:.0f} times the stiffest",
            "paper": f"{lowest:g} to {highest:g} N m/rad ({JAMMED[0][0]})",
        }
    )
    at = np.array(TABLE)
    by_source = [
        {
            "quantity": s.name,
            "stiffness": f"{s.stiffness:.0f} N/m" if s.stiffness else "-",
            "impedance": "; ".join(f"{abs(z):.1f}" for z in s.impedance),
        }
        for s in sources(at)
    ]
    return rows, by_source


def _friction(found: Friction) -> str:
    i = int(np.argmax(np.abs(found.friction)))
    share = abs(found.friction[i]) / found.normal[i]
    return (
        f"{abs(found.friction[i]):.2f} N, {share:.2f} (limit {found.coefficient:g}),"
        f" {100 * found.slipping:.0f} %"
    )


def plot_feel(path: Path) -> None:
    """Tip displacement against load, both forces of the contact, impedances at the key."""
    figure, (tip, contact, impedance) = shared_figure(3, 13.5, 4.2)
    for k in STIFFNESSES:
        tip.plot(LOADS, 1e3 * tip_displacement(k * DEGREE), label=f"{k:g}", linewidth=1.3)
    tip.set(
        xlabel="load (N)", ylabel="displacement of the tip (mm)", title="Tip under load, Fig. 7(a)"
    )
    tip.legend(title="k (N m/deg)", fontsize=8, title_fontsize=8, frameon=False, loc="upper left")
    found = contact_friction()
    contact.plot(found.time, found.normal, color=BLUE, linewidth=1.3, label="normal")
    contact.plot(
        found.time,
        found.friction,
        color=RED,
        linewidth=1.3,
        label="friction on the tip, to the hinge",
    )
    contact.fill_between(
        found.time,
        -found.coefficient * found.normal,
        found.coefficient * found.normal,
        color="#777777",
        alpha=0.2,
        label="limit of friction",
        linewidth=0.0,
    )
    contact.set(
        xlabel="time (s)",
        ylabel="force (N)",
        title="Forces at the contact",
        ylim=(-1.1 * found.coefficient * found.normal.max(), 1.45 * found.normal.max()),
    )
    contact.legend(fontsize=8, frameon=False, loc="upper left")
    for source in sources(FREQUENCY):
        _line(impedance, source)
    impedance.set(
        xlabel="frequency (Hz)",
        ylabel="|F / v| (N s/m)",
        title="What meets at the key",
        ylim=(1.0, 3e4),
    )
    impedance.legend(fontsize=7, frameon=False, loc="upper right", ncols=2)
    figure.savefig(path)


def _line(axis: object, source: FeelSource) -> None:
    own = "action" in source.name
    style = "-" if own or "soft" in source.name else "--"
    axis.loglog(  # type: ignore[attr-defined]
        FREQUENCY,
        np.abs(source.impedance),
        style,
        color="black" if own else None,
        linewidth=2.0 if own else 1.2,
        label=source.name,
    )
