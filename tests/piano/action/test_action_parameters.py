from __future__ import annotations

from pathlib import Path

import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.config import config_file, load_provenance
from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.parameters import load_parameters


def test_table_two_is_the_papers(parameters: ActionParameters) -> None:
    p = parameters
    assert (p.armature.mass, p.armature.damping, p.armature.stiffness) == (0.122, 3.793, 266.5)
    assert (p.key.mass, p.key.damping) == (0.0205, 2.46)
    h = p.hammer
    assert (h.mass, h.coupler_damping, h.coupler_stiffness, h.bushing_damping) == (
        0.1865,
        5.33,
        1892.1,
        2.932,
    )
    assert (p.front_rail.stiffness, p.front_rail.damping) == (2255.0, 4.1)
    assert p.armature.motor_constant * p.rig.step_current == pytest.approx(4.1)


def test_numbers_the_paper_leaves_open_are_declared_with_alternatives() -> None:
    entries = load_provenance("action.yaml")
    for name in ("hammer.weight", "key.dip", "initial_state.start", "initial_state.flexure_home"):
        assert entries[name]["source"].startswith("free"), name
        assert entries[name]["alternatives"], name


def test_default_hammer_weight_follows_from_the_advantage(parameters: ActionParameters) -> None:
    h = parameters.hammer
    assert h.weight == pytest.approx(h.mass * 9.81 / h.advantage, rel=1e-3)


def test_a_number_without_source_is_refused(tmp_path: Path) -> None:
    text = config_file("action.yaml").read_text(encoding="utf-8")
    broken = tmp_path / "action.yaml"
    broken.write_text(text.replace('source: "paper, Table 2, m_A"', 'source: ""'), encoding="utf-8")
    with pytest.raises(ConfigError, match="mass has no source"):
        load_parameters(str(broken))


def test_vary_checks_bounds(parameters: ActionParameters) -> None:
    assert parameters.vary("hammer", weight=0.2).hammer.weight == 0.2
    with pytest.raises(ValueError, match="weight"):
        parameters.vary("hammer", weight=-1.0)
