"""Numbers that no sensor gives, found by the fuzzer: they count as missing, and nothing fails."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pianobot_ros.axis.reading import read_log
from pianobot_ros.gap import GapError

TIME = np.arange(300) * 0.02
HEADS = ("time", "command", "position", "velocity", "effort")


def rows() -> list[list[str]]:
    columns = (TIME, np.sin(TIME), np.sin(TIME - 0.1), np.cos(TIME), 0.0 * TIME + 0.1)
    return [[f"{x:.5f}" for x in row] for row in zip(*columns, strict=True)]


@pytest.mark.parametrize("number", ["1e999", "-1e999", "1e300", "3.4e38"])
@pytest.mark.parametrize("column", [1, 2, 3, 4])
@pytest.mark.filterwarnings("error")
def test_a_number_beyond_any_reading_is_a_missing_one(
    tmp_path: Path, number: str, column: int
) -> None:
    cells = rows()
    cells[40][column] = number
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(row) for row in [list(HEADS), *cells]))
    log = read_log(path)
    held = (log.command, log.position, log.velocity, log.effort)[column - 1]
    assert held is not None
    assert not np.isinf(held).any()
    assert np.nanmax(np.abs(held)) < 2.0


def test_stamps_that_are_no_time_apart_are_one(tmp_path: Path) -> None:
    cells = rows()
    cells[0][0], cells[1][0], cells[2][0] = "-0.04", "0.0", "5e-324"
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(row) for row in [list(HEADS), *cells]))
    assert np.all(np.diff(read_log(path).t) > 0)


@pytest.mark.parametrize("lines", [True, False])
def test_an_integer_beyond_floats_in_json_is_a_missing_one(tmp_path: Path, lines: bool) -> None:
    entries = [dict(zip(HEADS, map(float, row), strict=True)) for row in rows()]
    texts = [json.dumps(entry) for entry in entries]
    texts[40] = texts[40].replace('"position": 0.', f'"position": {"1" * 1300}0.')
    texts[41] = json.dumps(entries[41] | {"position": 10**1300})
    path = tmp_path / "log.json"
    path.write_text("\n".join(texts) if lines else f"[{', '.join(texts)}]")
    assert np.nanmax(np.abs(read_log(path).position)) < 2.0


def test_json_nested_without_end_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text("[" * 100_000)
    with pytest.raises(GapError, match="nested too deeply"):
        read_log(path)
