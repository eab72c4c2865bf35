"""The report: whole, self-contained, and saying what was found."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.cli.app import main
from pianobot_ros.gap import Block, Effect, Observable, Parameter, Signal, Stage, diagnose
from pianobot_ros.gap.diagnosis import Closure, Dependency, FoundEffect, UnknownDescription
from pianobot_ros.gap.explain.conclude import _rivals
from pianobot_ros.gap.explain.describe import amount
from pianobot_ros.gap.explain.sentence import of_rivals, sentence
from pianobot_ros.gap.posterior.decide import Judgement
from pianobot_ros.gap.report import render, write_report
from pianobot_ros.gap.report.sections import _told_apart, _without_common_end
from pianobot_ros.gap.report.svg import Series, alike, chart, number, ticks

NO_GAP = Closure("gap", "x floor", *[math.nan] * 7)


def left(*depends: Dependency) -> UnknownDescription:
    return UnknownDescription("out", "drive", "V", "…", depends)


def test_the_sentence_claims_no_dependency_that_the_description_does_not() -> None:
    axis = np.arange(3.0)
    some = left(Dependency("u", "V", 0.6, "grows with u", ((axis, axis),)))
    said = [sentence("unknown", (), NO_GAP, u, ()) for u in (some, left())]
    assert said[0].endswith("; the residual of out grows with u.")
    assert said[1].endswith("; the residual of out depends on none of the recorded quantities.")


def test_the_sentence_of_an_unknown_cause_says_what_comes_nearest() -> None:
    closed = replace(NO_GAP, closed_by_effect=0.78)
    text = sentence("unknown", (), closed, None, (), nearest=("friction",))
    assert text.endswith("friction comes nearest: 78 % of what refitting leaves above the floor.")
    for closes in (math.nan, 0.04):
        little = replace(NO_GAP, closed_by_effect=closes)
        assert "nearest" not in sentence("unknown", (), little, None, (), nearest=("friction",))


def test_what_is_nearly_as_likely_is_said_of_every_verdict() -> None:
    masses = {"parameters": 0.5, "unknown": 0.46, "friction": 0.04}
    for verdict, rival in (("parameters", "unknown"), ("unknown", "parameters")):
        ranked = tuple(sorted(masses.items(), key=lambda kv: kv[0] != verdict))
        judged = Judgement(verdict, masses[verdict], None, ranked, (), ())  # type: ignore[arg-type]
        assert _rivals(judged) == {rival: masses[rival]}
        assert of_rivals(_rivals(judged)).startswith(f"Nearly as likely: {rival} (")


def test_values_that_nothing_usual_has_are_told_and_leave_open_what_is_missing() -> None:
    usual, far = (diagnose(Toy(), recordings(k=k)).sentence for k in (1.2, 3.0))
    assert usual.startswith("No structure is missing")
    assert "implausible" not in usual
    assert "these data cannot tell. Their values are implausible (k by 5.5 prior" in far


@pytest.mark.parametrize(
    ("x", "unit", "said"),
    [
        (5.99e-5, "m", "59.9 µm"),
        (-9.999e-4, "s", "-1 ms"),
        (3e-13, "N", "0.0003 nN"),
        (0.25, "rad", "0.25 rad"),
        (123456.0, "Pa", "123000 Pa"),
        (5e-5, "1", "5e-05 1"),
        (0.0, "m", "0 m"),
    ],
)
def test_an_amount_has_a_unit_that_can_be_read(x: float, unit: str, said: str) -> None:
    assert amount(x, unit) == said


def test_a_gap_that_refitting_made_wider_is_closed_by_no_negative_share() -> None:
    one = (FoundEffect("lag", "wrist", 0.94, {}),)
    for share, said in ((-1.64, "widens the held-out gap by 164 %"), (-1e-3, "closes 0 % of the")):
        gap = replace(NO_GAP, closed_by_parameters=share, closed_by_effect=0.9)
        assert f"Refitting parameters alone {said}" in sentence("effect", one, gap, None, ())


def test_that_nothing_is_missing_is_said_by_whom_it_is_likely() -> None:
    assert sentence("parameters", (), NO_GAP, None, (), sure=0.9).startswith("No structure is")
    unsure = sentence("parameters", (), NO_GAP, None, (), sure=0.1)
    assert unsure.startswith("Refitting") and unsure.endswith("these data cannot tell.")


def test_of_effects_that_are_alike_the_sentence_says_how_likely_one_of_them_is() -> None:
    lag = (FoundEffect("lag", "wrist", 0.23, {}),)
    text = sentence("effect", lag, NO_GAP, None, (("lag", "delay"),), sure=0.46)
    assert text.endswith("These data cannot tell it from delay: together 46 %.")
    assert "together" not in sentence("effect", lag, NO_GAP, None, (), sure=0.23)
    assert of_rivals({"jitter": 0.46}) == "Nearly as likely: jitter (46 %)."
    assert of_rivals({}) == ""


class Line2:
    """Output follows input times a gain; the real one may have an offset or a wave on it."""

    stages = (Stage("drive"),)
    observables = (Observable("out", "drive", "out", "V"),)
    parameters = (Parameter("gain", 1.0, 0.2, 5.0, stage="drive", sd=0.1, log=True),)
    effects = (
        Effect(
            "offset",
            "drive",
            (Parameter("off", 0, -2, 2, "V", sd=0.3),),
            ({"off": 0.2}, {"off": -0.2}),
        ),
    )

    def simulate(self, blocks, values, effects):
        return [
            {
                "out": values["gain"] * b.inputs["u"].y
                + (values["off"] if "offset" in effects else 0.0)
            }
            for b in blocks
        ]


def blocks(offset=0.0, wave=0.0):
    rng = np.random.default_rng(0)
    out = []
    for i in range(10):
        t = np.arange(0, 3, 0.02)
        u = (1 + i % 2) * np.sin(2 * t)
        y = u + offset + wave * np.sin(9 * u) + 0.01 * rng.normal(size=t.size)
        out.append(
            Block(
                f"<b{i}>",
                f"c{i % 2}",
                {"u": Signal(t, u, "V")},
                {"out": Signal(t, y, "V")},
                phases={"first": (0.0, 1.5), "second": (1.5, 3.0)},
            )
        )
    return out


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.links += [v for k, v in attrs if k in ("src", "href") and v]
        if tag not in ("meta", "br", "line", "rect", "circle", "path"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        if self.open and self.open[-1] == tag:
            self.open.pop()

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def found():
    return {
        "effect": diagnose(Line2(), blocks(offset=0.1)),
        "none": diagnose(Line2(), blocks()),
        "unknown": diagnose(Line2(), blocks(wave=0.2)),
    }


@pytest.mark.parametrize("verdict", ["effect", "none", "unknown"])
def test_report_is_whole_and_needs_nothing_from_outside(found, verdict, tmp_path):
    d = found[verdict]
    assert d.verdict == verdict
    path = write_report(d, tmp_path / "deep" / "report.html")
    html = path.read_text(encoding="utf-8")
    assert len(html) < 6_000_000
    assert not re.search(r"https?://", html)
    reader = Reader()
    reader.feed(html)
    assert not reader.links
    assert not reader.open, "unclosed tags"
    text = " ".join(" ".join(reader.text).split())
    assert d.sentence in text
    assert text.index(d.sentence) < text.index("Where the gap lies")
    for title in (
        "Where the gap lies",
        "Real against twin",
        "Which effect",
        "How far it shrinks",
        "What to do next",
        "Provenance",
    ):
        assert title in text
    assert ("What is left, described" in text) == (verdict == "unknown")


def test_names_from_recordings_are_escaped(found):
    html = render(found["effect"])
    assert "<b0>" not in html
    assert "&lt;b" in html


def test_the_report_says_what_effects_and_stages_are_in_their_authors_words(found):
    class Described(Line2):
        stages = (Stage("drive", "volts <in> to volts out"),)
        effects = (replace(Line2.effects[0], description="the amplifier's zero is off"),)

    html = render(diagnose(Described(), blocks(offset=0.1)))
    assert "the amplifier&#x27;s zero is off" in html
    assert "volts &lt;in&gt; to volts out" in html
    assert "a cause that the library lacks" in render(found["unknown"])


def test_effect_is_first_and_shows_its_value(found):
    html = render(found["effect"])
    assert html.index("Missing effect: offset") < html.index("Which effect")
    assert "off</th>" in html


def test_a_verdict_that_cannot_be_written_is_said(found, tmp_path, monkeypatch, capsys):
    folder = tmp_path / "diagnosis"

    def meanwhile(bags, **_):
        folder.write_text("in the way")
        return found["effect"]

    monkeypatch.setattr("pianobot_ros.piano.gap.diagnosis.diagnose.diagnose_bag", meanwhile)
    assert main(["diagnose", "bag", "--output", str(folder)]) == 2
    said = capsys.readouterr()
    assert said.out.startswith("Missing effect: offset") and "Report:" not in said.out
    assert said.err.startswith("error: cannot write the report")


def test_json_is_written(found, tmp_path):
    path = tmp_path / "diagnosis.json"
    found["effect"].write_json(path)
    assert json.loads(path.read_text(encoding="utf-8"))["verdict"] == "effect"


def test_chart_survives_gaps_and_constants():
    x = np.arange(5.0)
    svg = chart(
        [
            Series(x, np.array([1, np.nan, np.nan, 2, 3.0]), "real"),
            Series(x, np.full(5, 2.0), "after"),
        ],
        band=0.5,
    )
    assert svg.count("M") >= 3
    assert "nan" not in svg
    assert "nan" not in chart([Series(x, np.full(5, np.nan), "real")])


def test_long_lines_keep_their_peaks():
    y = np.zeros(20_000)
    y[12_345] = 7.0
    svg = chart([Series(np.arange(20_000.0), y, "real")])
    ys = [float(v) for v in re.findall(r"[ML][\d.]+ ([\d.]+)", svg)]
    assert len(ys) < 1500
    assert min(ys) < 40


def test_ticks_are_round_and_inside():
    for low, high in [(0, 1), (-3.7, 12.2), (1e-6, 3e-6)]:
        found = ticks(low, high)
        assert 2 <= len(found) <= 12
        assert all(low - 1e-12 <= t <= high + 1e-12 for t in found)
    assert number(0.0) == "0"
    assert number(float("nan")) == "–"


def test_numbers_that_are_compared_keep_what_they_differ_by():
    assert alike(1.0696, 1.067, 1.0723) == ["1.07", "1.067", "1.072"]
    assert alike(0.5, 0.1, 0.9) == ["0.5", "0.1", "0.9"]
    assert alike(2.0, 2.0, 2.0) == ["2", "2", "2"]
    assert alike(float("nan"), 0.0, 1.0)[0] == "–"
    assert [number(x) for x in (2500.0, -50000.0, 1e7)] == ["2500", "-50000", "1.0e7"]


def test_a_share_is_given_only_where_there_is_something_to_close(found):
    nothing = replace(found["effect"].gap, closed=math.nan, closed_low=-11.59, closed_high=1.0)
    html = render(replace(found["effect"], closures={"out": nothing}))
    assert "-1159 %" not in html


def test_the_report_says_what_to_do_in_words_of_any_robot(found):
    further = {
        "name": "b7",
        "attributes": {"speed": 0.25, "cutoff": 3.0},
        "units": {"speed": "m/s"},
        "separates": ["offset", "unknown"],
        "shows_in": "out",
        "expected_gain": 0.5,
        "unit": "nats per play",
        "gain_over_median": 2.0,
    }
    html = render(replace(found["effect"], next_experiment=further), advice="turn <it> on")
    assert "values above" in html and html.index("values above") > html.index(">Values<")
    assert "<dd>speed 0.25 m/s</dd>" in html and "cutoff" not in html
    assert "turn &lt;it&gt; on" in html
    assert "strike" not in html


def test_the_title_is_the_verdict_and_units_stand_beside_their_numbers(found):
    html = render(found["effect"])
    title = re.search("<h1>(.*?)</h1>", html)
    assert title and title[1].endswith("%).") and "Refitting" not in title[1]
    heads = re.findall("<th[^>]*>([^<]*)</th>", html[html.index(">Values<") :])
    assert heads[:3] == ["parameter", "value", "unit"]


@pytest.mark.parametrize(("share", "card"), [(-1.64, "wider"), (-1e-4, "closed")])
def test_a_gap_that_grew_is_not_called_closed(found, share, card):
    d = found["effect"]
    html = render(replace(d, sentence="", gap=replace(d.gap, closed_by_parameters=share)))
    assert f"{card} by refitting" in html
    assert "-164" not in html and "−164" not in html and "−0" not in html


def test_bars_that_differ_from_the_title_say_why(found):
    """Of two effects together each bar has a part of what the title gives to both."""
    d = found["effect"]
    both = replace(d.hypotheses[0], name="offset+wave", probability=0.9)
    words = "gives each of them its share"
    assert words in render(replace(d, hypotheses=(both, *d.hypotheses[1:])))
    assert words not in render(d)


def test_directions_are_drawn_apart_however_many_points_each_has(found):
    forwards, backwards = ((np.arange(n), np.arange(n)) for n in (5.0, 3.0))
    both = Dependency("u", "V", 0.6, "depends on the direction", (forwards, backwards))
    html = render(replace(found["unknown"], unknown=left(both)))
    assert [html.count(f'<circle class="{style}"') for style in ("after", "before")] == [5, 3]


def test_labels_lose_only_what_all_of_them_share():
    assert _told_apart(["scope export 1:0", "scope export 1:10"]) == (
        "scope export 1:",
        ["0", "10"],
    )
    assert _told_apart(["soft middle", "soft thumb"]) == ("", ["soft middle", "soft thumb"])
    assert _told_apart(["scope export 1:0"]) == ("", ["scope export 1:0"])
    assert _without_common_end(["soft (middle 64)", "loud (middle 64)"]) == ["soft", "loud"]
    assert _without_common_end(["soft (middle 64)", "soft (middle 62)"]) == [
        "soft (middle 64)",
        "soft (middle 62)",
    ]
    assert _without_common_end(["alone"]) == ["alone"]


def test_a_diagnosis_under_way_says_how_far_it_is_and_who_leads():
    said = []
    diagnose(Line2(), blocks(offset=0.1), progress=lambda *words: said.append(words))
    shares = [share for _, share, _ in said]
    assert shares == sorted(shares) and shares[0] >= 0.0 and shares[-1] < 1.0
    assert said[0][0] == "refitting parameters" and not said[0][2]
    assert said[-1][2][0][0] == "offset"
    assert all(0.0 <= p <= 1.0 for _, _, leaders in said for _, p in leaders)
