"""The report: one page for one joint; for many a page that leads to each."""

from __future__ import annotations

import html
import re
from pathlib import Path

from pianobot_ros.axis.diagnosis.lines import answer
from pianobot_ros.axis.diagnosis.robot import RobotFinding
from pianobot_ros.gap.report import write_report

__all__ = ["write_page"]

STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:70rem;padding:0 1rem}"
    "table{border-collapse:collapse;width:100%}th,td{text-align:left;padding:.4rem .6rem;"
    "border-bottom:1px solid #ccc;vertical-align:top}td.n{text-align:right;white-space:nowrap}"
)


def write_page(found: RobotFinding, path: Path) -> Path:
    """Write the report and return its (first) page: `path` itself, or index.html in it."""
    single = len(found.joints) == 1 and not found.left_out
    if single and path.suffix == ".html":
        (own,) = found.joints.values()
        return write_report(own.diagnosis, path, f"Gap diagnosis {own.joint}".strip())
    folder = path if path.suffix != ".html" else path.parent
    index = path if path.suffix == ".html" else path / "index.html"
    prefix = f"{path.stem}_" if path.suffix == ".html" else ""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name, own in found.joints.items():
        file = f"{prefix}joint_{re.sub(r'[^A-Za-z0-9]+', '_', name).strip('_') or 'one'}.html"
        write_report(own.diagnosis, folder / file, f"Gap diagnosis {name}".strip())
        sure, what = answer(own)
        gap = own.diagnosis.gap
        values = "<br>".join(
            html.escape(f"{n} = {p.value:.4g} ({p.low:.4g} to {p.high:.4g}) {p.unit}")
            for e in own.diagnosis.effects
            for n, p in e.parameters.items()
        )
        rows.append(
            f'<tr><td><a href="{file}">{html.escape(name or "(one joint)")}</a></td>'
            f'<td>{html.escape(what)}</td><td class="n">{100 * sure:.0f} %</td><td>{values}</td>'
            f'<td class="n">{gap.before:.1f} → {gap.after:.1f}</td>'
            f"<td>{html.escape(own.diagnosis.sentence)}</td></tr>"
        )
    rows += [
        f'<tr><td>{html.escape(name)}</td><td colspan="5">left out: {html.escape(why)}</td></tr>'
        for name, why in found.left_out.items()
    ]
    heads = ("joint", "effect", "sure", "values", "gap, floors", "in a sentence")
    index.write_text(
        "<!doctype html><html lang=en><meta charset=utf-8><title>Joints</title>"
        f"<style>{STYLE}</style><h1>Joints</h1><table><tr>"
        + "".join(f"<th>{h}</th>" for h in heads)
        + f"</tr>{''.join(rows)}</table></html>\n",
        encoding="utf-8",
    )
    return index
