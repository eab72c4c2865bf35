"""The tutorial's program runs as printed and finds what was put in."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]


def test_the_third_robot_of_the_tutorial(tmp_path):
    text = (ROOT / "docs" / "tutorial-your-robot.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(code.splitlines()) < 100
    (tmp_path / "nozzle.py").write_text(code, encoding="utf-8")
    rng = np.random.default_rng(0)
    t = np.arange(0, 900, 0.5)
    levels = np.array([0.3, 0.7, 0.5])
    duty = levels[(t // 20).astype(int) % 3]
    hot, seen, rows = 150.0, 150.0, []
    for x, u in zip(
        t, duty, strict=True
    ):  # a second implementation: sensor of second order, gain 8 % off
        hot += 0.5 * (270 * u - (hot - 22)) / 21
        seen += 0.5 * (hot - seen) / 4.0
        rows.append(f"{x},{u},{seen + 0.1 * rng.normal():.3f}")
    (tmp_path / "log.csv").write_text(
        "time,duty,temperature\n" + "\n".join(rows) + "\n", encoding="utf-8"
    )
    done = subprocess.run(
        [sys.executable, "nozzle.py", "log.csv"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=900,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "sensor_lag" in done.stdout.splitlines()[0]
    assert (tmp_path / "report.html").stat().st_size > 10_000
