"""The demo's last part: what a phrase says before and after, and which corrections are adopted."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pianobot_ros.cell.recordings.before_after import UNHEARD, Heard, heard, is_worse, share_closed
from pianobot_ros.cell.score import load_score
from pianobot_ros.cli.demo import closing_loop, requests
from pianobot_ros.cli.demo.closing_loop import adopted_lines, close_the_loop
from pianobot_ros.cli.demo.demonstration import PHRASE


def reports(rms: float, err: float, first: bool) -> list[Any]:
    """Six strikes of two conditions; nobody knows a floor before the second of each."""
    made = []
    for i in range(6):
        floor = math.nan if first and i < 2 else 0.5
        signals = [
            SimpleNamespace(signal=n, rms=rms * (1.0 + 0.1 * i), floor=floor, strikes=i)
            for n in ("fsr", "z")
        ]
        stroke = SimpleNamespace(condition=f"c{i % 2}", err=err if i else math.nan)
        made.append(SimpleNamespace(signals=signals, keystrokes=[stroke]))
    return made


def test_both_are_measured_by_the_same_floors() -> None:
    before, after = reports(2.0, 0.2, True), reports(0.5, 0.05, False)
    first, second = heard(before, after), heard(after, before)
    growth = np.sqrt(np.mean((1.0 + 0.1 * np.arange(6)) ** 2))
    assert first.gap == pytest.approx(2.0 / 0.5 * growth)
    assert second.gap == pytest.approx(0.5 / 0.5 * growth)
    assert first.low < first.gap < first.high
    assert (first.err, second.err, first.strikes) == (pytest.approx(0.2), pytest.approx(0.05), 5)
    closed = share_closed(first, second)
    assert closed == pytest.approx((first.gap - second.gap) / (first.gap - 1.0))
    text = "\n".join(
        adopted_lines(
            {
                "message": "adopts",
                "adopted": ["x=1"],
                "before": first.to_json(),
                "after": second.to_json(),
                "closed": closed,
            }
        )
    )
    assert "20.0 % (20.0 to 20.0)" in text and "5.0 %" in text and f"{100 * closed:.0f} %" in text


def test_both_take_the_floor_that_rests_on_most_strikes() -> None:
    before, after = reports(2.0, 0.2, False), reports(2.0, 0.2, False)
    for report in after:
        for s in report.signals:
            s.floor, s.strikes = 0.8, s.strikes + 6
    assert heard(before, after).gap == heard(after, before).gap == heard(after).gap


def test_nothing_heard_is_said_as_unknown() -> None:
    nothing = heard([])
    assert math.isnan(nothing.gap) and math.isnan(nothing.err)
    loop = {"message": "none", "adopted": [], "closed": None}
    unheard = nothing.to_json()
    assert "unknown" in "\n".join(adopted_lines({**loop, "before": unheard, "after": unheard}))


@pytest.mark.parametrize(
    ("before", "after", "worse"),
    [
        ((2.1, 2.3), 3.3, True),
        ((2.1, 2.3), 2.2, False),  # within the scatter of the strikes
        ((0.6, 0.7), 0.9, False),  # within the floor
        ((2.1, 2.3), 1.0, False),
        ((math.nan, math.nan), 3.0, False),
        ((2.1, 2.3), math.nan, False),
    ],
)
def test_worse_is_what_leaves_floor_and_scatter(
    before: tuple[float, float], after: float, worse: bool
) -> None:
    gap, high = before
    first, second = Heard(0.1, gap, gap, high, 12), Heard(0.1, after, after, after, 12)
    assert is_worse(first, second) == worse


@pytest.mark.parametrize(
    ("after", "interval", "worse"),
    [
        (0.07, (0.06, 0.08), True),  # although the gap shrank
        (0.07, (0.01, 0.12), False),  # two strikes of twelve, and no more
        (0.03, (0.02, 0.04), False),
        (math.nan, (math.nan, math.nan), False),
    ],
)
def test_a_growing_err_is_harm_however_the_gap_shrinks(
    after: float, interval: tuple[float, float], worse: bool
) -> None:
    first = Heard(0.05, 4.0, 3.1, 4.7, 12, 0.037, 0.061)
    assert is_worse(first, Heard(after, 1.3, 1.2, 1.4, 12, *interval)) == worse


@pytest.mark.parametrize("after", [0.5, 4.0])
def test_what_made_the_phrase_worse_is_forgotten(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, after: float
) -> None:
    played = iter([reports(2.0, 0.2, True), reports(after, 0.2, False)])
    asked: list[str] = []
    monkeypatch.setattr(closing_loop, "play_and_compare", lambda *_: (None, next(played)))

    def call(_: Any, kind: Any, service: str, request: Any) -> SimpleNamespace:
        asked.append(service)
        return SimpleNamespace(success=True)

    monkeypatch.setattr(requests, "_call", call)
    (tmp_path / "diagnosis").mkdir()
    document = {
        "verdict": "parameters",
        "parameters": {"joint_stiffness": {"value": 1.2, "unit": "1"}},
    }
    (tmp_path / "diagnosis" / "diagnosis.json").write_text(json.dumps(document))
    loop = close_the_loop(SimpleNamespace(tell=lambda _: None), tmp_path)
    text = "\n".join(adopted_lines(loop))
    left = [p.name for p in (tmp_path / "diagnosis").glob("*.yaml")]
    if after > 2.0:
        assert asked == ["/sim_twin/adopt", "/sim_twin/forget"]
        assert "forgotten" in text and left == ["rejected.yaml"]
    else:
        assert asked == ["/sim_twin/adopt"]
        assert "forgotten" not in text and left == ["corrections.yaml"]


def test_the_unheard_phrase_has_no_strike_of_the_demo() -> None:
    def numbers(name: str) -> set[tuple[float, float]]:
        return {(s.motion.speed, s.motion.depth) for s in load_score(name).strikes}

    assert not numbers(UNHEARD) & numbers(PHRASE)
    assert len({s.notes for s in load_score(UNHEARD).strikes}) == 3


def test_a_gap_that_falls_below_the_floor_is_gone_and_no_more_than_gone() -> None:
    before, after = (heard(reports(x, 0.1, False), reports(x, 0.1, False)) for x in (2.0, 0.2))
    closed = share_closed(before, after)
    loop = {"message": "", "adopted": ["x=1"], "before": before.to_json(), "closed": closed}
    text = "\n".join(adopted_lines({**loop, "after": after.to_json()}))
    assert closed > 1.0 and "All of the gap above the floor is gone." in text
