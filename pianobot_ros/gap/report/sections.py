"""The report's sections, a function each that gives its HTML, or nothing if it has nothing to
say.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import takewhile
from typing import Any

import numpy as np

from pianobot_ros.gap.diagnosis import Closure, Diagnosis, Estimate, GapMap, Hypothesis, Trace
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.report.chooser import chooser
from pianobot_ros.gap.report.svg import Series, alike, chart, number, scale_bar

LIMIT_TRACES = 6
LONG = 6
"""Characters from which what all labels of a table begin with is said once."""
NEXT = "What to do next"
SAID = 0.003
"""Probability from which an explanation is shown."""
SHARED = (
    "An explanation of several effects gives each of them its share of its probability, so that the"
    " bars add up; the sentence at the top says how probable it is that each acts at all."
)
VERDICTS = {
    "effect": "Missing effect",
    "parameters": "Parameters only",
    "none": "No gap",
    "unknown": "Unknown cause",
}


Html = Callable[[Diagnosis], str]
"""Inner HTML of a section; empty if there is nothing to say."""


@dataclass(frozen=True)
class ReportSection:
    """A section of the report: its heading, what it shows in a sentence, and its content."""

    title: str
    lead: str
    html: Html


SECTIONS: list[ReportSection] = []
"""In the order in which the report shows them, which is that of this file."""


def _section(title: str) -> Callable[[Html], Html]:
    """Make a function a section; its docstring is the section's lead."""

    def listed(html: Html) -> Html:
        SECTIONS.append(ReportSection(title, " ".join((html.__doc__ or "").split()), html))
        return html

    return listed


def percent(x: float) -> str:
    """0.873 as "87 %"."""
    return f"{round(100 * x)} %".replace("-", "−") if math.isfinite(x) else "–"


def legend(*items: tuple[str, str]) -> str:
    """Legend of CSS class and label."""
    inner = "".join(
        f'<span><i class="swatch {style}"></i>{escape(label)}</span>' for style, label in items
    )
    return f'<p class="legend">{inner}</p>'


def _words(text: str) -> str:
    """A cell of a table that holds words, as wide as these need."""
    return f'<td class="dim{" words" if text else ""}">{escape(text)}</td>'


def _table(rows: str, head: str = "", style: str = "", caption: str = "") -> str:
    """A table that scrolls in itself where the page is too narrow for it."""
    heads = f"<caption>{escape(caption)}</caption>" if caption else ""
    heads += f"<thead><tr>{head}</tr></thead>" if head else ""
    named = f' class="{style}"' if style else ""
    return f'<div class="scroll"><table{named}>{heads}<tbody>{rows}</tbody></table></div>'


@_section("Where the gap lies")
def _gap_map(d: Diagnosis) -> str:
    """Each stage is judged alone: what was measured upstream of it is fed into the twin.
    Numbers are RMS residuals in units of the repeatability floor; at 1 and below nothing is
    claimed. Shares count wrong values of the twin too, so the stage of a missing effect need
    not have the largest.
    """
    parts = [_stages(d)]
    for name, table in (("phase", d.stage_by_phase), ("condition", d.stage_by_condition)):
        if table is not None and len(table.columns) <= 24:
            layout = "pair" if len(table.columns) <= 6 else "stack"
            parts.append(
                f'<div class="{layout}">{_heat(f"stage × {name}, before", table, table.before)}'
                f"{_heat('after', table, table.after)}</div>"
            )
    return "".join(parts)


def _stages(d: Diagnosis) -> str:
    rows = []
    for r in d.stages:
        if not math.isfinite(r.gap) and r.share < 0.005:
            continue
        gap = f"{r.gap:.1f}" if math.isfinite(r.gap) else "–"
        rows.append(
            f'<tr><th>{escape(r.name)}</th><td class="num">{gap}</td>'
            f'<td class="barcell"><i style="width:{100 * min(r.share, 1):.1f}%"></i></td>'
            f'<td class="num">{percent(r.share)}</td>{_words(r.description)}</tr>'
        )
    head = (
        '<th>stage</th><th class="num">gap × floor</th><th>share of the gap (Shapley)</th><th></th>'
        "<th></th>"
    )
    return _table("".join(rows), head)


def _heat(title: str, table: GapMap, values: Array) -> str:
    shared, labels = _told_apart(_without_common_end(table.columns))
    title = f"{title} ({shared} …)" if shared else title
    head = "".join(f"<th>{escape(_short(c))}</th>" for c in labels)
    body = "".join(
        f"<tr><th>{escape(r)}</th>{''.join(_cell(v) for v in row)}</tr>"
        for r, row in zip(table.rows, values, strict=True)
    )
    return _table(body, f"<th></th>{head}", "heat", title)


def _without_common_end(labels: Sequence[str]) -> list[str]:
    """Labels without the words at their ends that all of them share, as " (middle 64)" where only
    one key was struck.
    """
    words = [label.split(" ") for label in labels]
    while len(words) > 1 and all(len(w) > 1 for w in words) and len({w[-1] for w in words}) == 1:
        words = [w[:-1] for w in words]
    return [" ".join(w) for w in words]


def _told_apart(labels: Sequence[str]) -> tuple[str, list[str]]:
    """What all labels begin with, up to a space or a colon, if long; and the rest of each."""
    ends = zip(min(labels, default=""), max(labels, default=""), strict=False)
    shared = "".join(a for a, _ in takewhile(lambda pair: pair[0] == pair[1], ends))
    shared = shared[: max(shared.rfind(" "), shared.rfind(":")) + 1]
    if len(labels) < 2 or len(shared) < LONG or any(label == shared for label in labels):
        return "", list(labels)
    return shared.rstrip(), [label[len(shared) :] for label in labels]


def _short(name: str) -> str:
    return name if len(name) <= 16 else "…" + name[-14:]


def _cell(v: float) -> str:
    if not np.isfinite(v):
        return '<td class="none">·</td>'
    heat = min(1.0, max(0.0, math.log(max(v, 1.0)) / math.log(12.0)))
    dark = " hot" if heat > 0.5 else ""
    return f'<td class="cell{dark}" style="--heat:{100 * heat:.0f}%">{v:.1f}</td>'


@_section("Real against twin")
def _traces(d: Diagnosis) -> str:
    """Choose a signal and a block, and point at the curves, or go along them with the arrow keys,
    to read them. Below, of each signal the block in the middle of the ranking of its gap, worst
    signal first; the grey band is ± the floor.
    """
    if not d.traces:
        return ""
    keys = legend(
        ("real", "measured"),
        ("before", "twin before"),
        ("after", "twin after"),
        ("band", "± floor"),
    )
    typical = [t for t in d.traces if t.typical][:LIMIT_TRACES]
    return chooser(d.traces) + keys + "".join(_trace(t) for t in typical)


def _trace(t: Trace) -> str:
    top = chart(
        [
            Series(t.t, t.before, "before", "twin before"),
            Series(t.t, t.after, "after", "twin after"),
            Series(t.t, t.real, "real", "measured"),
        ],
        x_label="s",
        y_label=t.unit,
        title=f"{t.observable}",
    )
    low = chart(
        [
            Series(t.t, t.real - t.before, "before", "residual before"),
            Series(t.t, t.real - t.after, "after", "residual after"),
        ],
        x_label="s",
        y_label=f"residual {t.unit}",
        band=t.floor,
        title=f"residual of {t.observable}",
    )
    return (
        f"<h3>{escape(t.observable)} <small>{escape(t.stage)} · block {escape(t.block)}</small>"
        "</h3>"
        f'<div class="pair">{top}{low}</div>'
    )


@_section("Which effect")
def _candidates(d: Diagnosis) -> str:
    """All parameters were refitted together with every candidate, and candidates were compared
    on blocks they were not fitted to. Filled bars are the 95 % credible set.
    """
    shown = [c for c in d.candidates if c.probability >= SAID or c.name in d.credible_set][:10]
    rows = "".join(
        f'<tr class="{"in" if c.name in d.credible_set else "out"}"><th>{escape(c.name)}</th>'
        f'<td class="dim">{escape(c.stage)}</td>'
        f'<td class="barcell"><i style="width:{100 * c.probability:.1f}%"></i></td>'
        f'<td class="num">{percent(c.probability)}</td>{_words(c.description)}</tr>'
        for c in shown
    )
    out = _table(rows, style="bars")
    if any("+" in h.name for h in d.hypotheses if h.probability >= SAID):
        out += f'<p class="lead">{SHARED}</p>'
    for group in d.inseparable:
        names = escape(", ".join(group))
        out += f'<p class="callout">These data cannot tell apart: <b>{names}</b>.</p>'
    out += _hypotheses(d)
    return out


def _hypotheses(d: Diagnosis) -> str:
    rows = "".join(
        f'<tr><th>{escape(h.name)}</th><td class="num">{percent(h.probability)}</td>'
        f'<td class="num">{h.score:+.0f} ± {h.score_se:.0f}</td>'
        f'<td class="num">{h.gap:.2f}</td>'
        f"{_words(_own_values(d, h))}</tr>"
        for h in d.hypotheses[:12]
    )
    head = (
        '<th>hypothesis</th><th class="num">weight</th>'
        '<th class="num">held-out score against “parameters”</th>'
        """<th class="num">gap × floor</th><th>its effects' own values</th>"""
    )
    return (
        "<details><summary>All hypotheses that were fitted in full</summary>"
        f"{_table(rows, head)}</details>"
    )


def _own_values(d: Diagnosis, h: Hypothesis) -> str:
    """Values of a hypothesis' effects, without the twin's own parameters."""
    return ", ".join(f"{n} = {v:.3g}" for n, v in h.values.items() if n not in d.parameters)


@_section("How far it shrinks")
def _closures(d: Diagnosis) -> str:
    """Measured on blocks that were not used for fitting, with a bootstrap over blocks."""
    g = d.gap
    summary = (
        f"<p>Closed: <b>{percent(g.closed)}</b> of the gap above the floor (95 %:"
        f" {percent(g.closed_low)} to {percent(g.closed_high)})."
        f" {escape(g.metric[0].upper() + g.metric[1:])}.</p>"
    )
    rows = "".join(
        f'<tr><th>{escape(n)}</th><td class="num">{c.before:.2f}</td>'
        f'<td class="num">{c.refit:.2f}</td><td class="num">{c.after:.2f}</td>'
        f'<td class="num">{percent(c.closed)}</td>'
        f'<td class="num dim">{_interval_closed(c)}</td></tr>'
        for n, c in sorted(d.closures.items(), key=lambda kv: -kv[1].before)
    )
    head = (
        '<th>signal</th><th class="num">before</th><th class="num">parameters refitted</th>'
        '<th class="num">after</th><th class="num">closed</th><th class="num">95 %</th>'
    )
    keys = legend(
        ("band", f"floor {g.floor:.2f}"),
        ("before", f"before {g.before:.2f}"),
        ("refit", f"parameters refitted {g.refit:.2f}"),
        ("after", f"after {g.after:.2f}"),
    )
    bar = scale_bar(g.floor, g.before, g.refit, g.after)
    return bar + keys + summary + _table(rows, head)


def _interval_closed(c: Closure) -> str:
    """Interval of the share that is closed; none where there is nothing to close."""
    if not math.isfinite(c.closed):
        return "–"
    return f"{percent(c.closed_low)} … {percent(c.closed_high)}"


@_section("Values")
def _parameters(d: Diagnosis) -> str:
    """Intervals hold what noise leaves open, how much the value moves when blocks are left out,
    and what the twin and its laws may be wrong by.
    """
    rows = [_row(n, p, e.name) for e in d.effects for n, p in e.parameters.items()]
    rows += [_row(n, p, "") for n, p in d.parameters.items()]
    if not rows:
        return ""
    head = (
        '<th>parameter</th><th class="num">value</th><th>unit</th><th class="num">95 %</th>'
        '<th class="num">twin had</th><th>of</th>'
    )
    return _table("".join(rows), head)


def _row(name: str, p: Estimate, effect: str) -> str:
    flag = ' <span class="flag">on its bound</span>' if p.at_bound else ""
    style = ' class="in"' if effect else ""
    value, low, high = alike(p.value, p.low, p.high)
    unit = "" if p.unit == "1" else p.unit  # where it counts or is a ratio
    return (
        f"<tr{style}><th>{escape(name)}{flag}</th>"
        f'<td class="num">{value}</td><td>{escape(unit)}</td>'
        f'<td class="num dim">{low} … {high}</td><td class="num">{number(p.nominal)}</td>'
        f'<td class="dim">{escape(effect or p.stage)}</td></tr>'
    )


@_section("What is left, described")
def _unknown(d: Diagnosis) -> str:
    """The residual that the best hypothesis leaves, against whatever explains most of it on
    blocks that were left out.
    """
    u = d.unknown
    if u is None:
        return ""
    plots = []
    for dep in u.dependencies:
        if sum(x.size for x, _ in dep.curves) < 2:
            continue
        both = len(dep.curves) > 1
        names = (("after", "forwards" if both else "mean"), ("before", "backwards"))
        drawn = chart(
            [Series(*curve, *name) for curve, name in zip(dep.curves, names, strict=False)],
            x_label=f"{dep.feature} {dep.unit}",
            y_label=f"residual {u.unit}",
            points=True,
        )
        plots.append(
            f"<figure>{drawn}"
            f"<figcaption>{percent(max(dep.explained, 0))} of the residual, held out:"
            f" {escape(dep.text)}"
            f"{' (two colours: the two directions)' if both else ''}</figcaption>"
            "</figure>"
        )
    return f'<p class="callout">{escape(u.text)}</p><div class="pair">{"".join(plots)}</div>'


@_section(NEXT)
def _next_steps(d: Diagnosis) -> str:
    steps = {
        "effect": "Add the named effect to the twin with the values above, then diagnose again:"
        " what is left is judged anew.",
        "parameters": "Take over the fitted values; no new term is needed for what these data"
        " show.",
        "none": "Nothing: on these data the twin is as good as the robot's own repeatability."
        " Harder motions may still show a gap.",
        "unknown": "Add a term of the described shape to the library, or record the quantity the"
        " residual hints at.",
    }
    out = [f"<p>{steps[d.verdict]}</p>"]
    if len(d.credible_set) > 1 or d.inseparable:
        out.append(
            "<p>Several causes remain possible; the experiment that separates them is worth more"
            " than more of the same data.</p>"
        )
    if d.next_experiment:
        out.append(_experiment(d.next_experiment))
    return "".join(out)


def _experiment(n: Mapping[str, Any]) -> str:
    """What to play next. Where its block has ``units`` of attributes, those are shown, and
    others are none of the reader's business.
    """
    units = n.get("units") or dict.fromkeys(n["attributes"], "")
    what = [f"{k} {number(float(n['attributes'][k]))} {unit}".strip() for k, unit in units.items()]
    rows = {
        "experiment": str(n["name"]),
        "with": ", ".join(what),
        "tells apart": " and ".join(n["separates"]),
        "shows in": str(n["shows_in"]),
        "expected to tell": f"{number(n['expected_gain'])} {n['unit']},"
        f" {number(n['gain_over_median'])} × the median of what is on offer",
    }
    listed = "".join(f"<dt>{k}</dt><dd>{escape(v)}</dd>" for k, v in rows.items() if v)
    return f"<dl>{listed}</dl>"


@_section("Provenance and warnings")
def _provenance(d: Diagnosis) -> str:
    warnings = "".join(f"<li>{escape(w)}</li>" for w in d.warnings)
    items = {**d.provenance, "runtime": f"{d.runtime_s:.1f} s"}
    said = {k: ", ".join(map(str, v)) if isinstance(v, list) else str(v) for k, v in items.items()}
    rows = "".join(
        f"<dt>{escape(k.replace('_', ' '))}</dt><dd>{escape(v)}</dd>" for k, v in said.items()
    )
    return (
        f'<ul class="warnings">{warnings}</ul>' if warnings else "<p>No warnings.</p>"
    ) + f"<dl>{rows}</dl>"
