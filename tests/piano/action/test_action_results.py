from __future__ import annotations

import json
from pathlib import Path

import pytest

from pianobot_ros.piano.action.results.write import write_results


@pytest.mark.long
def test_results_hold_ours_beside_the_papers(tmp_path: Path) -> None:
    page = write_results(tmp_path, 3, command="make it", duration=90.0)
    text = page.read_text(encoding="utf-8")
    assert "`make it`, seed 3" in text
    assert text.count("**contradiction**") == 4
    data = json.loads((tmp_path / "action.json").read_text(encoding="utf-8"))
    assert data["seed"] == 3
    assert len(data["table_two"]) == 11
    for row in data["table_two"].values():
        assert row["low"] < row["value"] < row["high"]
        assert abs(row["value"] / row["truth"] - 1) < 0.01
    for name in ("fig5", "fig7", "fig9", "fig10", "repetition"):
        picture = tmp_path / f"action-{name}.png"
        assert 5_000 < picture.stat().st_size < 200_000
        assert f"action-{name}.png" in text
