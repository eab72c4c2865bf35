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

from pianobot_ros.action import load_parameters
from pianobot_ros.cell.geometry import keyboard
from pianobot_ros.twin.experiments.glissando import Glissando, glissando
from pianobot_ros.twin.experiments.plots import plot_glissando, plot_repetition, plot_single_note, plot_two_notes
from pianobot_ros.twin.experiments.repetition import Repetition, Struck, repetition
from pianobot_ros.twin.experiments.single_note import SingleNote, single_note
from pianobot_ros.twin.experiments.two_notes import G_SHARP, E, TwoNotes, two_notes
from pianobot_ros.twin.rollout import Run

__all__ = ["action_rows", "comparison", "write_results"]

Row = dict[str, str]


def comparison(single: SingleNote, slide: Glissando, two: TwoNotes) -> list[Row]:
    """Rows ``figure``, ``quantity``, ``ours``, ``paper``."""
    force = single.peak_force
    shift, hold = slide.shifts[1:6], slide.holds
    t = {(n, r): two.stroke(getattr(two, r), n).t_hold for n in (E, G_SHARP) for r in ("slow", "fast")}

    def row(figure: str, quantity: str, ours: str, paper: str) -> Row:
        return {"figure": figure, "quantity": quantity, "ours": ours, "paper": paper}

    def yes(value: bool) -> str:
        return "yes" if value else "no"

    velocities = slide.velocities
    return [
        row("7(b), 8(a)", "peak force at k = 0.05 N m/deg", f"{force[0]:.2f} N", "3.71 mN (unit: see docs/physics.md)"),
        row("7(b), 8(a)", "peak force at k = 2 N m/deg", f"{force[-1]:.2f} N", "14.6 mN"),
        row("7(b), 8(a)", "ratio of the two", f"{force[-1] / force[0]:.2f}", "3.94"),
        row("8(a)", "force rises with every k", yes(bool(np.all(np.diff(force) > 0))), "yes"),
        row("8(a)", "key angle alike (least correlation with the stiffest)", f"{single.likeness:.3f}", "“similar variations”"),
        row("8(a)", "bulge: force rises faster from the key bed on (least, largest ratio of slopes)",
            f"{single.bulge.min():.1f}, {single.bulge.max():.1f}", "“transient bulges”, no figure"),
        row("8(b)", "notes sounded by the glissando", str(len(slide.presses)), "7"),
        row("8(b)", "time from note to note, five inner ones", f"{shift.mean():.3f} s ± {100 * shift.std() / shift.mean():.1f} %",
            "“stable and similar”"),
        row("8(b)", "velocity of C, of the five inner notes",
            f"{velocities[0]}; {min(velocities[1:6])} to {max(velocities[1:6])}", "C differs, inner ones alike"),
        row("8(b)", "T_hold of C, of the inner notes, of B",
            f"{hold[0]:.3f}; {hold[1:6].min():.3f} to {hold[1:6].max():.3f}; {hold[6]:.3f} s", "C and B differ"),
        row("8(c)", "E sounds, and does not reach the bed (slow, fast)",
            f"{yes(not two.bedded(two.slow, E))}, {yes(not two.bedded(two.fast, E))}", "yes"),
        row("8(c)", "G sharp reaches the bed (slow, fast)",
            f"{yes(two.bedded(two.slow, G_SHARP))}, {yes(two.bedded(two.fast, G_SHARP))}", "yes"),
        row("8(c)", "T_hold of E, slow and fast", f"{t[E, 'slow']:.3f} s, {t[E, 'fast']:.3f} s", "shorter when fast"),
        row("8(c)", "T_hold of G sharp, slow and fast",
            f"{t[G_SHARP, 'slow']:.3f} s, {t[G_SHARP, 'fast']:.3f} s", "shorter when fast"),
    ]  # fmt: skip


def action_rows(again: Repetition) -> list[Row]:
    """Rows of the hand on the piano action; the right column is the literature's."""
    literature = load_parameters().literature
    strikes = again.strikes

    def each(pick: Callable[[Struck], str]) -> str:
        return "; ".join(pick(s) for s in strikes)

    def count(run: Run) -> str:
        return str(sum(e.rule == "string made" for e in run.action))

    fast, slow = 1e3 * literature.key_to_hammer_fast, 1e3 * literature.key_to_hammer_slow
    after, before = 1e3 * literature.bottom_after_contact_piano, 1e3 * literature.bottom_before_contact_forte
    return [
        {"quantity": q, "ours": ours, "expected": expected}
        for q, ours, expected in (
            ("speed of the wrist", each(lambda s: f"{s.speed:g} m/s"), "-"),
            ("hammer at the string", each(lambda s: f"{s.hammer_speed:.2f} m/s"), "rises"),
            ("lag of hammer-string contact behind let-off", each(lambda s: f"{1e3 * s.lag:.1f} ms"),
             f"{slow:g} (slow) to {fast:g} ms (fast)"),
            ("key bottom after hammer-string contact", each(lambda s: f"{1e3 * s.bottom:+.1f} ms"),
             f"{after:+g} (piano) to {-before:+g} ms (forte)"),
            ("V_pre", each(lambda s: f"{s.v_pre:.3f} m/s"), "rises"),
            ("T_hold", each(lambda s: f"{s.t_hold:.3f} s"), "falls with speed: the motion is shorter"),
            ("notes repeated from half-way, with the repetition lever", count(again.with_lever), "2"),
            ("notes repeated from half-way, without it", count(again.without), "1"),
        )
    ]  # fmt: skip


def write_results(out_dir: str | Path, seed: int = 0, *, command: str = "pianobot reproduce") -> dict[str, Any]:
    """Run the experiments; write ``hand-*.png``, ``hand.md`` and ``hand.json`` into ``out_dir``; return what is in the JSON.

    ``command`` is named in the files as what made them. The twin is deterministic: ``seed`` changes nothing and is written
    down for uniformity with the other results.
    """
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    single, slide, two, again = single_note(), glissando(), two_notes(), repetition()
    plot_single_note(single, out / "hand-single-note.png")
    plot_glissando(slide, out / "hand-glissando.png")
    plot_two_notes(two, out / "hand-two-notes.png")
    plot_repetition(again, out / "hand-repetition.png")
    rows, action = comparison(single, slide, two), action_rows(again)
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
        "action": action,
        "strikes": [asdict(s) for s in again.strikes],
        "glissando": {"shifts_s": slide.shifts.round(4).tolist(), "velocities": list(slide.velocities)},
    }
    (out / "hand.json").write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    (out / "hand.md").write_text(_markdown(rows, action, command, seed), encoding="utf-8")
    return result


def _markdown(rows: list[Row], action: list[Row], command: str, seed: int) -> str:
    lines = [
        "# The soft hand: ours beside the paper's", "",
        f"Made by `{command}`, seed {seed} (the twin is deterministic).", "",
        "The paper gives neither wrist motion nor sizes nor contact parameters, so absolute forces and their ratio depend on",
        "what we chose (`pianobot_ros/twin/experiments/`, `config/`). What can be compared is the pattern. The keys are those of",
        f"`config/keyboard.yaml` (bed at {1e3 * keyboard().mechanism.max_angle:.1f} mrad).", "",
        "| figure | quantity | ours | paper |", "|---|---|---|---|",
        *(f"| {r['figure']} | {r['quantity']} | {r['ours']} | {r['paper']} |" for r in rows), "",
        "![Single note with stiffness from 0.05 to 2 N m/deg](hand-single-note.png)",
        "![Glissando of the thumb](hand-glissando.png)",
        "![Two notes, slow and fast](hand-two-notes.png)", "",
        "## The same hand on the piano action", "",
        "The middle finger on E4 with the other paper's action mapped to the fingertip, with string, let-off, repetition lever",
        "and backcheck (`TwinOptions(mechanism=\"action\", parts=...)`); strikes from soft to loud. On the right what the",
        "literature and the parts' purpose let expect.", "",
        "| quantity | ours | expected |", "|---|---|---|",
        *(f"| {r['quantity']} | {r['ours']} | {r['expected']} |" for r in action), "",
        "![Repeated note with and without repetition lever](hand-repetition.png)", "",
    ]  # fmt: skip
    return "\n".join(lines)
