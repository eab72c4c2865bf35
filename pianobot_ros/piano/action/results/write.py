"""The action's results beside the paper's: figures, a Markdown table and JSON, all from one
seed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from scipy.optimize import brentq

from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.mujoco.mujoco_hybrid import simulate_mujoco
from pianobot_ros.piano.action.parameters import ActionParameters, load_parameters
from pianobot_ros.piano.action.results.action_plots import (
    plot_bode,
    plot_fits,
    plot_repetition,
    plot_step,
    plot_step_force,
)
from pianobot_ros.piano.action.results.features import (
    StepFeatures,
    StrikeTiming,
    repeated_note,
    step_features,
    step_response,
)
from pianobot_ros.piano.action.results.paper_tables import (
    STEP_END,
    TableRow,
    beyond_rows,
    felt_strikes,
    felt_table,
    linear_rows,
    mujoco_rows,
    parts_rows,
    step_rows,
    strike_series,
    strike_table,
    sweep_table,
    table_rows,
    truth_of,
)
from pianobot_ros.piano.action.results.rig_rows import plot_rig, rig_results, rig_rows
from pianobot_ros.piano.action.rig.transfer_fit import identify_rig

__all__ = ["write_results"]


def write_results(
    out_dir: str | Path, seed: int, *, command: str | None = None, duration: float | None = None
) -> Path:
    """Run rig, hybrid model and MuJoCo, and write ``action-*.png``, ``action.md`` and
    ``action.json`` into ``out_dir``.

    ``command`` is named in the files as what made them; ``duration`` [s] shortens the rig's trials.
    Returns the Markdown file. Deterministic in ``seed``. Raises
    :class:`~pianobot_ros.cell.errors.PianobotError`.
    """
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    p = load_parameters()
    table = identify_rig(p, seed=seed, duration=duration)
    plot_bode(table.responses, out / "action-fig5.png")
    plot_fits(table, out / "action-fig7.png")

    rig = rig_results(p, seed, duration)
    plot_rig(p, rig, out / "action-rig.png")

    force = p.armature.motor_constant * p.rig.step_current
    features, matched_weight, late = _steps(p, force, out)
    repeats = {
        "with repetition lever": repeated_note(p, lever=True),
        "without repetition lever": repeated_note(p, lever=False),
    }
    plot_repetition(repeats, p, out / "action-repetition.png")
    strikes = strike_series(p)

    made = command or f"write_results(out_dir, seed={seed}) of pianobot_ros.piano.action.results"
    sections = {
        "Linear models: text of the paper against its own Table 2": linear_rows(p),
        "Table 2 recovered from the simulated rig (95 % intervals)": table_rows(p, table),
        "Load cell, rail and linearisation": rig_rows(p, rig),
        "Step of 2 A: Figs. 9 and 10": step_rows(p, features, matched_weight, late),
        "MuJoCo against the exact reference (RMS over RMS)": mujoco_rows(p, force),
        "Beyond the paper: let-off, repetition, timing": beyond_rows(p, repeats, strikes),
        "Beyond the paper in MuJoCo (rk4, 0.1 ms), against the exact reference": parts_rows(p),
    }
    text = _page(p, made, seed, sections, strikes)
    page = out / "action.md"
    page.write_text(text, encoding="utf-8")
    data = {
        "command": made,
        "seed": seed,
        "tables": {title: [asdict(r) for r in rows] for title, rows in sections.items()},
        "step": asdict(features),
        "table_two": {
            ".".join(n): asdict(e) | {"truth": truth_of(p, n)} for n, e in table.estimates.items()
        },
        "strikes": [{"force": f, "rise": r, **asdict(t)} for (f, r), t in strikes],
    }
    (out / "action.json").write_text(
        json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    return page


def _steps(
    p: ActionParameters, force: float, out: Path
) -> tuple[StepFeatures, float, StepFeatures]:
    """Draw Figs. 9 and 10; features of the step, the weight that lands the hammer as in the paper,
    and the step's features with it.
    """
    step = step_response(p, STEP_END)
    weight = _weight_for_landing(p)
    late = step_response(p.vary("hammer", weight=weight), STEP_END)
    paths = {
        f"hammer weight {p.hammer.weight:.3f} N": step,
        f"{weight:.3f} N (lands at 0.45 s)": late,
    }
    mujoco = simulate_mujoco(p, ForceProfile.step(force), STEP_END)
    plot_step(paths, mujoco, p, out / "action-fig9.png")
    plot_step_force(paths, p, out / "action-fig10.png")
    return step_features(step), weight, step_features(late)


def _page(
    p: ActionParameters,
    made: str,
    seed: int,
    sections: Mapping[str, Sequence[TableRow]],
    strikes: list[tuple[tuple[float, float], StrikeTiming]],
) -> str:
    """The Markdown page."""
    text = [f"# The piano action: ours | paper\n\nMade by `{made}`, seed {seed}.\n"]
    for title, rows in sections.items():
        text.append(f"## {title}\n\n| quantity | ours | paper | remark |\n|---|---|---|---|")
        text += [f"| {r.quantity} | {r.ours} | {r.paper} | {r.remark} |" for r in rows]
        text.append("")
    text += [
        "## What the free parameters move\n",
        sweep_table(p),
        "",
        "## Strikes from soft to loud\n",
        strike_table(strikes),
        "",
        "The same with felt at coupler, rail and string (Hunt and Crossley), without let-off:\n",
        felt_table(felt_strikes(p)),
        "",
    ]
    text += [
        f"![{name}](action-{name}.png)"
        for name in ("fig5", "fig7", "rig", "fig9", "fig10", "repetition")
    ]
    return "\n".join(text) + "\n"


def _weight_for_landing(p: ActionParameters) -> float:
    """Hammer weight [N] that lands the hammer when the paper's does."""
    wanted = p.published.landing - p.published.step_time

    def late(weight: float) -> float:
        return step_features(step_response(p.vary("hammer", weight=weight), 1.5)).lands - wanted

    return float(brentq(late, 0.08, 0.6, xtol=1e-5))
