from __future__ import annotations

from pathlib import Path

import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.config import (
    Section,
    config_dir,
    load_provenance,
    load_section,
    quantity,
)


class Limits(Section):
    speed: float = quantity("m/s", low=0, high=1)
    box: tuple[float, float] = quantity("m")


class Arm(Section):
    name: str
    limits: Limits
    axes: dict[str, Limits]


GOOD = """
name: ur5
limits: &l
  speed: {value: 0.5, unit: m/s, source: data sheet}
  box: {value: [0, 1], unit: m, source: cell drawing}
axes: {base: *l}
"""


def load(tmp_path: Path, text: str) -> Arm:
    file = tmp_path / "wrist_model.yaml"
    file.write_text(text, encoding="utf-8")
    return load_section(file, Arm)


def test_numbers_come_out_plain(tmp_path: Path) -> None:
    arm = load(tmp_path, GOOD)
    assert arm.limits.speed == 0.5
    assert arm.axes["base"].box == (0, 1)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("speed:", "sped:", "unknown name 'sped' (did you mean 'speed'?)"),
        ("unit: m/s", "unit: mm/s", "must be in 'm/s'"),
        ("value: 0.5, unit: m/s, source: data sheet", "value: 0.5, unit: m/s", "has no source"),
        ("{value: 0.5, unit: m/s, source: data sheet}", "0.5", "needs value, unit and source"),
        ("value: 0.5", "value: 5", "less than or equal to 1"),
        ("value: 0.5", "value: fast", 'speed is "fast": give a number'),
        ("name: ur5", "name: [", "not valid YAML"),
    ],
)
def test_each_mistake_is_one_clear_line(tmp_path: Path, old: str, new: str, says: str) -> None:
    with pytest.raises(ConfigError) as error:
        load(tmp_path, GOOD.replace(old, new))
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(ConfigError, match="nowhere"):
        load_section("nowhere.yaml", Arm)


def test_every_number_in_config_has_unit_and_source() -> None:
    checked = 0
    for file in sorted(config_dir().rglob("*.yaml")):
        if "phrases" in file.parts:
            continue  # scores are music, not parameters
        for name, entry in load_provenance(file).items():
            assert str(entry.get("unit", "")).strip(), f"{file.name}: {name} has no unit"
            assert str(entry.get("source", "")).strip(), f"{file.name}: {name} has no source"
            checked += 1
    assert checked > 50
