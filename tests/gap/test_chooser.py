"""The report in a real browser: choose a signal and a strike, and read values under the pointer."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_report import Line2, blocks

from pianobot_ros.gap import diagnose
from pianobot_ros.gap.diagnosis import Trace
from pianobot_ros.gap.report import write_report
from pianobot_ros.gap.report.chooser import chooser

PATIENCE = 120e3  # ms, on a busy machine


def traces() -> list[Trace]:
    t = np.linspace(0.0, 1.0, 11)
    one = Trace("b0", "soft", "force", "contact", "N", 0.1, t, t, 2 * t, 3 * t, 4 * t, True)
    gap = replace(one, block="b1", real=np.where(t < 0.5, t, np.nan), typical=False)
    return [one, gap, replace(one, observable="</script><b>angle</b>", unit="rad", real=5 * t)]


def test_names_cannot_end_the_script() -> None:
    assert chooser(traces()).count("</script>") == 2


def test_signal_and_strike_are_chosen_and_read(browser: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><meta charset=utf-8>{chooser(traces())}", encoding="utf-8")
    view = browser.new_page(viewport={"width": 900, "height": 400})
    view.set_default_timeout(PATIENCE)
    errors: list[str] = []
    view.on("pageerror", lambda error: errors.append(str(error)))
    view.goto(page.as_uri())
    assert view.locator("#signal option").all_inner_texts() == ["force", "</script><b>angle</b>"]
    assert view.locator("#chosen path").count() == 4
    view.locator("#chosen svg").hover()
    assert "measured 0." in view.inner_text("#values")
    assert "refitted" in view.inner_text("#values")
    first = view.get_attribute("#chosen path.real", "d")
    view.select_option("#block", index=1)
    assert view.get_attribute("#chosen path.real", "d") != first
    view.select_option("#signal", index=1)
    assert "rad" in view.inner_text("#values")
    view.close()
    assert not errors


def test_curves_are_read_by_keys_and_by_who_does_not_see_them(browser: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><meta charset=utf-8>{chooser(traces())}", encoding="utf-8")
    view = browser.new_page(viewport={"width": 900, "height": 400})
    view.set_default_timeout(PATIENCE)
    view.goto(page.as_uri())
    curve = view.get_by_role("slider", name="force over time")
    curve.focus()
    assert curve.get_attribute("aria-valuenow") == "0"
    for key in ("ArrowRight", "ArrowRight", "ArrowLeft", "End", "ArrowRight"):
        curve.press(key)
    assert curve.get_attribute("aria-valuenow") == "1"
    assert "measured 1 N, twin after 4 N" in curve.get_attribute("aria-valuetext")
    curve.press("Home")
    assert "at 0 s" in view.inner_text("#values")
    # Both axes say what they count.
    assert {"0 N", "0 s"} <= set(view.locator("#chosen svg text").all_text_contents())
    view.close()


@pytest.fixture(scope="module")
def report(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A whole report, seen as wide as a sheet of A4."""
    found = diagnose(Line2(), blocks(offset=0.1))
    path = write_report(found, tmp_path_factory.mktemp("report") / "report.html")
    view = browser.new_page(viewport={"width": 794, "height": 1123})
    view.set_default_timeout(PATIENCE)
    view.goto(path.as_uri())
    yield view
    view.close()


SEEN = (  # element, its property, and the least contrast to the card that makes it legible
    ("h1", "color", 7.0),
    (".lead", "color", 4.5),
    ("section td", "color", 4.5),
    ("path.real", "stroke", 4.5),
    ("path.before", "stroke", 3.0),
    ("path.refit", "stroke", 3.0),
    ("path.after", "stroke", 3.0),
    (".barcell i", "backgroundColor", 3.0),
    ("summary", "color", 4.5),
)


def luminance(colour: str) -> float:
    """Relative luminance of a CSS colour, by WCAG 2."""
    channels = [int(c) / 255 for c in re.findall(r"\d+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def style(view: Any, element: str, name: str) -> str:
    script = "([e, n]) => getComputedStyle(document.querySelector(e))[n]"
    return str(view.evaluate(script, [element, name]))


def assert_legible(view: Any) -> float:
    """Every part stands out from the card; returns the card's luminance."""
    ground = luminance(style(view, ".card", "backgroundColor"))
    for element, name, least in SEEN:
        found = luminance(style(view, element, name))
        contrast = (max(found, ground) + 0.05) / (min(found, ground) + 0.05)
        assert contrast >= least, f"{element}: contrast {contrast:.1f}"
    return ground


def test_report_is_legible_in_both_themes(report: Any) -> None:
    report.emulate_media(media="screen", color_scheme="light")
    assert assert_legible(report) > 0.8
    report.emulate_media(media="screen", color_scheme="dark")
    assert assert_legible(report) < 0.05


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_report_prints_dark_on_white_whatever_the_theme(report: Any, scheme: Any) -> None:
    report.emulate_media(media="print", color_scheme=scheme)
    assert assert_legible(report) == 1.0
    # Bars and heat maps are backgrounds, which a printer leaves out unless told otherwise.
    assert style(report, ".barcell i", "printColorAdjust") == "exact"
    assert not report.locator("#signal").is_visible()
    assert report.locator("#chosen path").count() == 4
    width = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert report.evaluate(width) <= 0
    # Before and after stand side by side on a sheet too, and no heading ends one.
    assert len(style(report, ".pair", "gridTemplateColumns").split()) == 2
    assert style(report, "h3", "breakAfter") == style(report, "h2", "breakAfter") == "avoid"
    pages = re.findall(rb"/Type /Page\s", report.pdf(format="A4"))
    assert 1 < len(pages) <= 4


OUTSIDE = """() => [...document.querySelectorAll('.card')].flatMap((card) => {
  const edge = card.getBoundingClientRect().right + 1;
  return [...card.querySelectorAll('*')].filter((e) => !e.parentElement.closest('.scroll')
    && e.getBoundingClientRect().right > edge).map((e) => e.outerHTML.slice(0, 80));
})"""
SMALLEST = """() => Math.min(...[...document.querySelectorAll('svg text')].map(
  (t) => parseFloat(getComputedStyle(t).fontSize) * t.getCTM().a).filter((size) => size > 0))"""


@pytest.mark.parametrize("width", [400, 1280])
def test_the_report_fits_the_page_and_its_labels_can_be_read(report: Any, width: int) -> None:
    report.emulate_media(media="screen")
    report.set_viewport_size({"width": width, "height": 900})
    report.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    report.wait_for_function(
        "document.querySelector('#chosen svg').clientWidth ==="
        " document.querySelector('#chosen svg').viewBox.baseVal.width"
    )
    assert report.evaluate("document.documentElement.scrollWidth") == width
    assert report.evaluate(OUTSIDE) == []
    assert report.evaluate(SMALLEST) > 9.0
