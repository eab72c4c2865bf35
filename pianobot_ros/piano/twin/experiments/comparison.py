"""Plots and the table *ours | paper* of the soft hand's experiments.

``pianobot reproduce`` writes them, with the other paper's.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.twin.experiments.feel import assumed, presses
from pianobot_ros.piano.twin.experiments.feel_plots import FEEL, feel_rows, plot_feel
from pianobot_ros.piano.twin.experiments.glissando import GlissandoRun, glissando
from pianobot_ros.piano.twin.experiments.motion_driven import reaction_rows
from pianobot_ros.piano.twin.experiments.repetition import Repetition, Struck, repetition
from pianobot_ros.piano.twin.experiments.single_note import SingleNote, single_note
from pianobot_ros.piano.twin.experiments.soft_hand_plots import (
    plot_glissando,
    plot_repetition,
    plot_single_note,
    plot_two_notes,
)
from pianobot_ros.piano.twin.experiments.two_notes import G_SHARP, E, TwoNotes, margins, two_notes
from pianobot_ros.piano.twin.stepping.rollout import Run

__all__ = ["action_rows", "comparison", "write_results"]

Row = dict[str, str]


def comparison(single: SingleNote, slide: GlissandoRun, two: TwoNotes) -> list[Row]:
    """Rows ``figure``, ``quantity``, ``ours``, ``paper``."""
    return [*_single_rows(single), *_glissando_rows(slide), *_two_rows(two)]


def _row(figure: str, quantity: str, ours: str, paper: str) -> Row:
    return {"figure": figure, "quantity": quantity, "ours": ours, "paper": paper}


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _single_rows(single: SingleNote) -> list[Row]:
    force = single.peak_force
    return [
        _row(
            "7(b), 8(a)",
            "peak force at k = 0.05 N m/deg over that at 2 N m/deg",
            f"{force[0] / force[-1]:.3f} (of {force[-1]:.2f} N)",
            f"{3.71 / 14.6:.3f} (its absolute unit: see docs/physics.md)",
        ),
        _row("8(a)", "force rises with every k", _yes(bool(np.all(np.diff(force) > 0))), "yes"),
        _row(
            "8(a)",
            "key angle alike (least correlation with the stiffest)",
            f"{single.likeness:.3f}",
            "“similar variations”",
        ),
        _row(
            "8(a)",
            "bulge: force rises faster from the key bed on (least, largest ratio of slopes)",
            f"{single.bulge.min():.1f}, {single.bulge.max():.1f}",
            "“transient bulges”, no figure",
        ),
    ]


def _glissando_rows(slide: GlissandoRun) -> list[Row]:
    shift, hold, velocities = slide.shifts[1:6], slide.holds, slide.velocities
    return [
        _row("8(b)", "notes sounded by the glissando", str(len(slide.presses)), "7"),
        _row(
            "8(b)",
            "time from note to note, five inner ones",
            f"{shift.mean():.3f} s ± {100 * shift.std() / shift.mean():.1f} %",
            "“stable and similar”",
        ),
        _row(
            "8(b)",
            "velocity of C, of the five inner notes",
            f"{velocities[0]}; {min(velocities[1:6])} to {max(velocities[1:6])}",
            "C differs, inner ones alike",
        ),
        _row(
            "8(b)",
            "T_hold of C, of the inner notes, of B",
            f"{hold[0]:.3f}; {hold[1:6].min():.3f} to {hold[1:6].max():.3f}; {hold[6]:.3f} s",
            "C and B differ",
        ),
    ]


def _two_rows(two: TwoNotes) -> list[Row]:
    bed = keyboard().mechanism.max_angle
    e, sharp = two.strokes(E), two.strokes(G_SHARP)
    return [
        _row(
            "8(c)",
            "E sounds twice, and does not reach the bed (slow, swift)",
            ", ".join(_yes(x < bed) for x in two.deepest(E)),
            "yes",
        ),
        _row(
            "8(c)",
            "G sharp reaches the bed (slow, swift)",
            ", ".join(_yes(x >= bed) for x in two.deepest(G_SHARP)),
            "yes",
        ),
        _row(
            "8(c)",
            "T_hold of E, slow and swift",
            f"{e[0].t_hold:.3f} s, {e[1].t_hold:.3f} s",
            "shorter when swift",
        ),
        _row(
            "8(c)",
            "T_hold of G sharp, slow and swift",
            f"{sharp[0].t_hold:.3f} s, {sharp[1].t_hold:.3f} s",
            "shorter when swift",
        ),
    ]


def margin_rows() -> list[Row]:
    """How far Fig. 8(c)'s pattern is from another one, by depth and stiffness."""
    return [
        {
            "figure": "8(c)",
            "quantity": f"margin at depth {1e3 * m.depth:.1f} mm, k = {m.stiffness:.2g} N m/deg:"
            " E short of the bed, G sharp past it",
            "ours": f"{1e3 * m.short:.1f}, {1e3 * m.pressed:.1f} mrad"
            + ("" if m.sounded else "; a note is silent"),
            "paper": "holds, no figure" if m.short > 0 else "would not hold",
        }
        for m in margins()
    ]


def bed_rows() -> list[Row]:
    """How far hard presses go past the bed."""
    return [
        {
            "quantity": f"key `{p.preset}`, k = {p.stiffness:g} N m/deg",
            "force": f"{p.force:.1f} N",
            "past": f"{1e3 * p.past:.1f} mm",
            "springs": f"{1e3 * p.past_springs:.1f} mm",
        }
        for p in presses()
    ]


def assumed_rows() -> list[Row]:
    """What each alternative of the keys' numbers changes."""
    return [
        {
            "keys": f"`{a.preset}`",
            "number": f"{a.name} {a.value:g} {a.unit}".removesuffix(" 1"),
            "configured": f"{a.configured:g}",
            "changes": " | ".join(f"{100 * x:+.1f} %" for x in a.changes),
        }
        for a in assumed()
    ]


def action_rows(again: Repetition) -> list[Row]:
    """Rows of the hand on the piano action; the right column is what is expected."""
    expected = load_parameters().expected
    strikes = again.strikes

    def each(pick: Callable[[Struck], str]) -> str:
        return "; ".join(pick(s) for s in strikes)

    def count(run: Run) -> str:
        return str(sum(e.rule == "string made" for e in run.action))

    fast, slow = 1e3 * expected.key_to_hammer_fast, 1e3 * expected.key_to_hammer_slow
    after, before = (
        1e3 * expected.bottom_after_contact_piano,
        1e3 * expected.bottom_before_contact_forte,
    )
    return [
        {"quantity": q, "ours": ours, "expected": expected}
        for q, ours, expected in (
            ("speed of the wrist", each(lambda s: f"{s.speed:g} m/s"), "-"),
            ("hammer at the string", each(lambda s: f"{s.hammer_speed:.2f} m/s"), "rises"),
            (
                "lag of hammer-string contact behind let-off",
                each(lambda s: f"{1e3 * s.lag:.1f} ms"),
                f"{slow:g} (slow) to {fast:g} ms (fast); asked of this project, no source",
            ),
            (
                "key bottom after hammer-string contact",
                each(lambda s: f"{1e3 * s.bottom:+.1f} ms"),
                f"{after:+g} (piano) to {-before:+g} ms (forte); Askenfelt and Jansson 1990",
            ),
            ("V_pre", each(lambda s: f"{s.v_pre:.3f} m/s"), "rises"),
            (
                "T_hold",
                each(lambda s: f"{s.t_hold:.3f} s"),
                "falls with speed: the motion is shorter",
            ),
            (
                "notes repeated from half-way, with the repetition lever",
                count(again.with_lever),
                "2",
            ),
            ("notes repeated from half-way, without it", count(again.without), "1"),
        )
    ]


def write_results(
    out_dir: str | Path, seed: int = 0, *, command: str = "pianobot reproduce"
) -> dict[str, Any]:
    """Run the experiments; write ``hand-*.png``, ``hand.md`` and ``hand.json`` into ``out_dir``;
    return what is in the JSON.

    ``command`` is named in the files as what made them. The twin is deterministic: ``seed`` changes
    nothing and is written down for uniformity with the other results.
    """
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    single, slide, two, again = single_note(), glissando(), two_notes(), repetition()
    plot_single_note(single, out / "hand-single-note.png")
    plot_glissando(slide, out / "hand-glissando.png")
    plot_two_notes(two, out / "hand-two-notes.png")
    plot_repetition(again, out / "hand-repetition.png")
    plot_feel(out / FEEL)
    felt, impedances = feel_rows()
    rows = [*comparison(single, slide, two), *margin_rows(), *felt]
    action, answers, pressed = action_rows(again), reaction_rows(), bed_rows()
    moved = assumed_rows()
    result: dict[str, Any] = {
        "command": command,
        "seed": seed,
        "rows": rows,
        "single_note": {
            "stiffness_N_m_per_deg": list(single.stiffness),
            "peak_force_N": single.peak_force.round(4).tolist(),
            "peak_angle_rad": single.peak_angle.round(5).tolist(),
            "t_hold_s": [round(r.strokes[0].t_hold, 5) for r in single.runs],
        },
        "impedance": impedances,
        "motion_driven": answers,
        "bed": pressed,
        "assumed": moved,
        "action": action,
        "strikes": [asdict(s) for s in again.strikes],
        "glissando": {
            "shifts_s": slide.shifts.round(4).tolist(),
            "velocities": list(slide.velocities),
        },
    }
    (out / "hand.json").write_text(
        json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    (out / "hand.md").write_text(
        _markdown(rows, _contact_lines(impedances, answers, pressed, moved), action, command, seed),
        encoding="utf-8",
    )
    return result


def _markdown(
    rows: list[Row], contact: list[str], action: list[Row], command: str, seed: int
) -> str:
    lines = [
        "# The soft hand: ours beside the paper's",
        "",
        f"Made by `{command}`, seed {seed} (the twin is deterministic).",
        "",
        (
            "The paper gives neither wrist motion nor sizes nor contact parameters, so absolute"
            " forces and their ratio depend on"
        ),
        (
            "what we chose (`pianobot_ros/piano/twin/experiments/`, `config/`). What can be"
            " compared is the pattern. The keys are those of"
        ),
        f"`config/keyboard.yaml`, preset `{keyboard().preset}` (bed at"
        f" {1e3 * keyboard().mechanism.max_angle:.1f} mrad).",
        "",
        "| figure | quantity | ours | paper |",
        "|---|---|---|---|",
        *(f"| {r['figure']} | {r['quantity']} | {r['ours']} | {r['paper']} |" for r in rows),
        "",
        "![Single note with stiffness from 0.05 to 2 N m/deg](hand-single-note.png)",
        "![Glissando of the thumb](hand-glissando.png)",
        "![Two notes, slow and then swift](hand-two-notes.png)",
        "",
        *contact,
        "## The same hand on the piano action",
        "",
        (
            "The middle finger on E4 with the other paper's action mapped to the fingertip, with"
            " string, let-off, repetition lever"
        ),
        (
            'and backcheck (`TwinOptions(mechanism="action", parts=...)`); strikes from soft to'
            " loud. On the right what the"
        ),
        "sources named there and the parts' purpose let expect.",
        "",
        "| quantity | ours | expected |",
        "|---|---|---|",
        *(f"| {r['quantity']} | {r['ours']} | {r['expected']} |" for r in action),
        "",
        "![Repeated note with and without repetition lever](hand-repetition.png)",
        "",
    ]
    return "\n".join(lines)


def _contact_lines(
    impedances: list[Row], reactions: list[Row], pressed: list[Row], moved: list[Row]
) -> list[str]:
    return [
        "## What meets at the key",
        "",
        "Driving-point impedance |F/v| at 1, 5 and 20 Hz, vertical at the tip, and static"
        " stiffness. The human finger is",
        "Hajian and Howe's (1997) as the action paper quotes it: 6 g, 2 N s/m, 100 to 400 N/m.",
        "",
        "| source | stiffness | N s/m at 1; 5; 20 Hz |",
        "|---|---|---|",
        *(f"| {r['quantity']} | {r['stiffness']} | {r['impedance']} |" for r in impedances),
        "",
        f"![Tip under load, forces at the contact, impedances]({FEEL})",
        "",
        "## One motion in, the force out",
        "",
        "A half cosine of 9 mm in 0.1 s imposed on every mechanism (Thorin, Boutillon and Lozada"
        " 2014: force-driven tests flatter",
        "any model), force at the fingertip.",
        "",
        "| mechanism | largest force | RMS |",
        "|---|---|---|",
        *(f"| {r['quantity']} | {r['peak']} | {r['rms']} |" for r in reactions),
        "",
        "## Past the bed",
        "",
        "The middle finger strikes E4 at 0.3 m/s and presses 18 mm deep. `digital` and `acoustic`"
        " have felt at the bed, `paper` the",
        "linear rail of the action paper's Table 2; on the right the same strike on that rail.",
        "",
        "| key and hand | largest force | past the bed | on springs |",
        "|---|---|---|---|",
        *(f"| {r['quantity']} | {r['force']} | {r['past']} | {r['springs']} |" for r in pressed),
        "",
        "## What the assumed numbers of the keys move",
        "",
        "Each alternative of `config/keyboard.yaml`, one at a time: the middle finger strikes E4 at"
        " 0.2 m/s, 12 mm deep, k = 0.5 N m/deg.",
        "",
        "| keys | number | instead of | peak force | V_pre | V_rel | T_hold |",
        "|---|---|---|---|---|---|---|",
        *(f"| {r['keys']} | {r['number']} | {r['configured']} | {r['changes']} |" for r in moved),
        "",
    ]
