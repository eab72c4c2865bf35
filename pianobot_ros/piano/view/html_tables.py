"""The page's tables and small drawings as HTML text; colours work on light and dark ground."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from pianobot_ros.cell.recordings.keystroke import Keystroke, NoteEvent
from pianobot_ros.piano.view.tape.tape import GapTable, Job, StrikeRow

__all__ = [
    "REAL",
    "SIM",
    "clock",
    "fingers",
    "gap_table",
    "job_text",
    "legend",
    "note_name",
    "piano_roll",
    "streams",
    "strike_table",
    "verdict_text",
]

REAL, SIM, QUIET = "#e8590c", "#0a7cff", "#9a9da3"
STYLE = (
    "<style>.pb{font-size:12px;line-height:1.35;padding:0 .6em .2em}.pb table{border-collapse:"
    "collapse;width:100%}.pb td,.pb th{padding:1px 4px;text-align:right;font-weight:400;"
    "font-variant-numeric:tabular-nums}.pb th:first-child,.pb td:first-child{text-align:left}"
    ".pb tr.on{background:rgba(232,89,12,.13)}.pb .dim{opacity:.6}.pb .real{color:#e8590c}"
    ".pb .sim{color:#0a7cff}.pb .dot{display:inline-block;width:.65em;height:.65em;border-radius:"
    "50%;margin-right:.35em}.pb .silent{color:#9a9da3}.pb .bar{height:.55em;background:"
    "rgba(128,128,128,.25);border-radius:.3em;overflow:hidden}.pb .bar i{display:block;height:100%;"
    "background:#0a7cff}.pb h4{margin:.2em 0;font-size:12px}.pb p{margin:.25em 0}</style>"
)
NAMES = ("C", "C♯", "D", "D♯", "E", "F", "F♯", "G", "G♯", "A", "A♯", "B")


def note_name(note: int) -> str:
    """64 as E4."""
    return f"{NAMES[note % 12]}{note // 12 - 1}"


def clock(seconds: float) -> str:
    """Wall time of a moment, s since the epoch."""
    return time.strftime("%H:%M:%S", time.localtime(seconds))


def _box(inner: str, name: str) -> str:
    return f'{STYLE}<div class="pb" data-part="{name}">{inner}</div>'


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def legend(estimated: bool, factor: float) -> str:
    """What the colours mean, and what is estimated rather than measured."""
    words = (
        '<p><span class="dot" style="background:#e8590c"></span><b class="real">real</b> solid'
        ' &nbsp; <span class="dot" style="background:#0a7cff"></span><b class="sim">twin</b>'
        " ghost, dashed</p>"
    )
    if factor != 1.0:
        words += f'<p data-part="magnified">The ghost’s distance is shown × {factor:g}.</p>'
    note = "Finger joints are <b>estimated</b>: nobody measures them"
    if estimated:
        note += "; so are keys without an encoder, and forces without a sensor (pale arrow)"
    return _box(words + f'<p class="dim" data-part="estimated">{note}.</p>', "legend")


def fingers(colours: Mapping[str, str]) -> str:
    """Whose curve is whose, below the chart of all of them."""
    words = " &nbsp; ".join(
        f'<span class="dot" style="background:{colour}"></span>{escape(name)}'
        for name, colour in colours.items()
    )
    return _box(f'<p class="dim" style="text-align:center">{words}; dashed: twin</p>', "fingers")


def streams(silent: Mapping[tuple[str, str], float | None], epoch: float) -> str:
    """Which streams speak: ``silent`` since when (s), None while speaking, -inf if never heard."""
    rows = []
    for stream in dict.fromkeys(name for _, name in silent):
        cells = ""
        for cell, colour in (("real", REAL), ("sim", SIM)):
            since = silent[cell, stream]
            speaks = since is None
            text = "live"
            if since is not None:
                text = f"silent since {clock(epoch + since)}" if math.isfinite(since) else "–"
            cells += (
                f'<td class="{"" if speaks else "silent"}" data-stream="{cell}/{stream}"'
                f' data-state="{"live" if speaks else "silent"}"><span class="dot" '
                f'style="background:{colour if speaks else QUIET}"></span>{text}</td>'
            )
        rows.append(f"<tr><td>{escape(stream)}</td>{cells}</tr>")
    head = '<tr class="dim"><th></th><th>real</th><th>twin</th></tr>'
    return _box(f"<table>{head}{''.join(rows)}</table>", "streams")


def strike_table(rows: Sequence[StrikeRow], shown: int = 6) -> str:
    """The latest strikes, newest first; every pair is real over twin."""
    if not rows:
        return _box('<p class="dim">No strike compared yet.</p>', "strikes")
    body = ""
    for row in list(rows)[: -shown - 1 : -1]:
        on = ' class="on"' if row is rows[-1] else ""
        pairs = "".join(
            f"<td>{_pair(row.real, row.sim, name, digits, scale)}</td>"
            for name, digits, scale in (
                ("v_pre", 0, 1e3),
                ("v_rel", 0, 1e3),
                ("t_hold", 0, 1e3),
                ("peak_force", 1, 1.0),
            )
        )
        err = f"{100 * row.err:.1f} %" if math.isfinite(row.err) else _missing(row)
        body += (
            f'<tr{on} data-strike="{row.index}"><td>{row.index + 1}</td><td>{note_name(row.note)}'
            f"</td>{pairs}<td><b>{err}</b></td></tr>"
        )
    head = "".join(f"<th>{h}</th>" for h in ("#", "key", "V_pre", "V_rel", "T_hold", "peak", "Err"))
    units = "".join(f"<th>{u}</th>" for u in ("", "", "mm/s", "mm/s", "ms", "N", "Eq. 5"))
    return _box(f'<table><tr>{head}</tr><tr class="dim">{units}</tr>{body}</table>', "strikes")


def _pair(
    real: Keystroke | None, sim: Keystroke | None, name: str, digits: int, scale: float
) -> str:
    def one(stroke: Keystroke | None) -> str:
        return "–" if stroke is None else _number(scale * getattr(stroke, name), digits)

    return f'<span class="real">{one(real)}</span>&thinsp;<span class="sim">{one(sim)}</span>'


def _missing(row: StrikeRow) -> str:
    lost = [word for word, s in (("real", row.real), ("twin", row.sim)) if s is None]
    said = " and ".join(lost) + " silent" if lost else "not comparable"
    return f'<span class="silent">{said}</span>'


def gap_table(table: GapTable | None) -> str:
    """The map stage × phase in floors."""
    if table is None or not table.rows:
        return _box(
            '<h4>Stage × phase</h4><p class="dim">After two strikes of one condition.</p>', "map"
        )
    head = "".join(f"<th>{escape(c)}</th>" for c in table.columns)
    body = "".join(
        f"<tr><td>{escape(name)}</td>{''.join(_heat(v) for v in values)}</tr>"
        for name, values in zip(table.rows, table.values.tolist(), strict=True)
        if any(math.isfinite(v) for v in values)
    )
    return _box(
        '<h4>Stage × phase, last eight strikes <span class="dim">(× floor)</span></h4>'
        f"<table><tr><th></th>{head}</tr>{body}</table>",
        "map",
    )


def _heat(value: float) -> str:
    if not math.isfinite(value):
        return '<td class="dim">·</td>'
    share = min(1.0, max(0.0, math.log(max(value, 1.0)) / math.log(12.0)))
    return f'<td style="background:rgba(232,89,12,{0.75 * share:.2f})">{value:.1f}</td>'


def job_text(job: Job | None) -> str:
    """What a diagnosis under way does, and who leads."""
    if job is None:
        return ""
    bars = _bars(job.leading[:4])
    return _box(
        f"<h4>{escape(job.doing)}</h4>"
        f'<div class="bar"><i style="width:{100 * min(1.0, job.progress):.0f}%"></i></div>{bars}',
        "job",
    )


def _bars(named: Sequence[tuple[str, float]]) -> str:
    rows = "".join(
        f'<tr><td>{escape(name)}</td><td style="width:45%"><div class="bar"><i '
        f'style="width:{100 * p:.0f}%"></i></div></td><td>{100 * p:.0f} %</td></tr>'
        for name, p in named
    )
    return f"<table>{rows}</table>" if rows else ""


def verdict_text(document: Mapping[str, Any] | None, report: str, said: str = "") -> str:
    """The verdict with its sentence, the likeliest causes, and where the report is."""
    if document is None:
        text = said or "Not diagnosed yet."
        return _box(f'<h4>Verdict</h4><p class="dim">{escape(text)}</p>', "verdict")
    named = [
        (str(c["name"]), float(c["probability"] or 0.0))
        for c in document.get("candidates", ())
        if (c["probability"] or 0.0) >= 0.005
    ][:4]
    link = f'<p class="dim">Report: <code>{escape(report)}</code></p>' if report else ""
    return _box(
        f"<h4>Verdict: {escape(str(document.get('verdict', '')))}</h4>"
        f"<p><b>{escape(str(document.get('sentence', '')))}</b></p>{_bars(named)}{link}",
        "verdict",
    )


def piano_roll(
    notes: Mapping[str, Sequence[NoteEvent]], start: float, end: float, keys: Sequence[int]
) -> str:
    """Notes of both cells from ``start`` to ``end`` s: real above, twin below, each as long as it
    sounds, with its velocity; the onset is the left edge.
    """
    width, height, left = 360.0, 96.0, 26.0
    heard = sorted({e.note for events in notes.values() for e in events} & set(keys)) or [keys[0]]
    pitch = min((height - 16) / len(heard), 34.0)
    scale = (width - left - 4) / (end - start)
    parts = []
    for k, note in enumerate(heard):
        y = height - 14 - (k + 1) * pitch
        parts.append(
            f'<line x1="{left}" x2="{width}" y1="{y + pitch:.1f}" y2="{y + pitch:.1f}" stroke='
            f'"currentColor" opacity=".15"/><text x="2" y="{y + pitch / 2 + 4:.1f}" font-size="10"'
            f' fill="currentColor">{note_name(note)}</text>'
        )
        for cell, colour, lane in (("real", REAL, 0.08), ("sim", SIM, 0.52)):
            for on, off, velocity in _bars_of(notes.get(cell, ()), note, start, end):
                x, w = left + scale * (on - start), max(scale * (off - on), 2.0)
                h = 0.4 * pitch
                label = (
                    f'<text x="{x + w + 2:.1f}" y="{y + lane * pitch + h - 1:.1f}" font-size="9" '
                    f'fill="{colour}">{velocity}</text>'
                )
                parts.append(
                    f'<rect x="{x:.1f}" y="{y + lane * pitch:.1f}" width="{w:.1f}" '
                    f'height="{h:.1f}" rx="1.5" fill="{colour}" opacity='
                    f'"{0.35 + 0.65 * velocity / 127:.2f}"/>{label}'
                )
    drawing = (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="100%" role="img">{"".join(parts)}'
        f'<text x="{left}" y="{height - 2}" font-size="9" fill="currentColor" opacity=".6">'
        f"{end - start:.0f} s; numbers are MIDI velocities</text></svg>"
    )
    return _box(f"<h4>Notes</h4>{drawing}", "roll")


def _bars_of(
    events: Sequence[NoteEvent], note: int, start: float, end: float
) -> list[tuple[float, float, int]]:
    bars, since = [], None
    for event in events:
        if event.note != note:
            continue
        if since is not None and event.time > start:
            bars.append((max(since.time, start), min(event.time, end), since.velocity))
        since = event if event.on else None
    if since is not None and since.time < end:
        bars.append((max(since.time, start), end, since.velocity))
    return [b for b in bars if b[1] >= b[0]]
