"""A diagnosis as one self-contained HTML file."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path

from jinja2 import Environment, PackageLoader, select_autoescape

from pianobot_ros.gap.diagnosis import Diagnosis
from pianobot_ros.gap.report.sections import NEXT, SECTIONS, VERDICTS, percent


def render(diagnosis: Diagnosis, title: str = "Gap diagnosis", advice: str = "") -> str:
    """The report as HTML text; it refers to nothing outside itself. ``advice`` is what its
    application has to say of what to do next.
    """
    environment = Environment(
        loader=PackageLoader("pianobot_ros.gap.report"),
        autoescape=select_autoescape(["html", "j2"]),
    )
    parts = []
    for section in SECTIONS:
        body = section.html(diagnosis)
        if section.title == NEXT and advice:
            body += f"<p>{escape(advice)}</p>"
        if body:
            parts.append({"title": section.title, "lead": section.lead, "body": body})
    verdict, *rest = re.split(r"(?<=\.) (?=[A-Z])", diagnosis.sentence, maxsplit=1)
    g = diagnosis.gap
    figures = [
        ("gap before", f"{g.before:.1f}", "× floor"),
        ("parameters refitted", f"{g.refit:.1f}", "× floor"),
        ("after", f"{g.after:.1f}", "× floor"),
        (
            "wider by refitting" if g.widened else "closed by refitting",
            percent(abs(g.closed_by_parameters)),
            "",
        ),
        ("closed by the effect, of the rest", percent(g.closed_by_effect), ""),
    ]
    return environment.get_template("report.html.j2").render(
        title=title,
        d=diagnosis,
        verdict=verdict,
        rest=" ".join(rest),
        kind=VERDICTS[diagnosis.verdict],
        sections=parts,
        figures=figures,
    )


def write_report(
    diagnosis: Diagnosis, path: str | Path, title: str = "Gap diagnosis", advice: str = ""
) -> Path:
    """Write the report, as :func:`render` makes it, to `path` (made with its folders) and return
    it.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(render(diagnosis, title, advice), encoding="utf-8")
    return path
