"""The tutorial's node and its three tests run as printed, with the plugin as a user loads it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pianobot_ros.testing import Processes

pytestmark = [pytest.mark.graph, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
def test_the_tutorials_tests_pass(processes: Processes, tmp_path: Path) -> None:
    text = (ROOT / "docs" / "tutorial-testing.md").read_text(encoding="utf-8")
    node, *tests = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "loudness.py").write_text(node, encoding="utf-8")
    (tmp_path / "test_loudness.py").write_text("\n\n".join(tests), encoding="utf-8")
    words = ("-p", "pianobot_ros.testing", "-p", "no:cacheprovider", "test_loudness.py")
    run = processes.python("pytest", "-rA", *words, log="pytest", cwd=tmp_path)
    assert run.wait(900.0) == 0, run.output()
    assert "3 passed" in run.output(), run.output()
