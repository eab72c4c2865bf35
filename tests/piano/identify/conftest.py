"""Load tests of a key whose parameters are known exactly."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

RADIUS = 0.195  # m, contact point of a white key
Writer = Callable[..., Path]


def _swing(
    time: np.ndarray, force: np.ndarray, stiffness: float, damping: float, inertia: float
) -> np.ndarray:
    """Angle of a key with a rigid rest stop under a force, by small explicit steps: another solver
    than the twin's.
    """
    fine = np.arange(time[0], time[-1], 2e-5)
    push = np.interp(fine, time, force) * RADIUS
    angle, rate, out = 0.0, 0.0, np.zeros_like(fine)
    for i in range(len(fine)):
        rate += 2e-5 * (push[i] - stiffness * angle - damping * rate) / inertia
        angle += 2e-5 * rate
        if angle < 0:
            angle, rate = 0.0, 0.0
        out[i] = angle
    return np.interp(time, fine, out)


@pytest.fixture
def write_csv(tmp_path: Path) -> Writer:
    """Writes a CSV of columns given by name."""

    def write(header: str = "time,force,angle", **columns: np.ndarray) -> Path:
        path = tmp_path / "load.csv"
        rows = np.column_stack([columns[name.strip().lower()] for name in header.split(",")])
        np.savetxt(path, rows, delimiter=",", header=header, comments="")
        return path

    return write


@pytest.fixture(scope="session")
def presses() -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, float]]:
    """Six presses with abrupt release at 500 Hz, with sensor noise: time, force, angle, truth."""
    truth = {"stiffness": 2.4, "damping": 0.02, "inertia": 9e-4}
    time = np.arange(0.0, 6.0, 2e-3)
    force = np.zeros_like(time)
    for i in range(6):
        inside = (time >= i + 0.2) & (time < i + 0.6)
        force[inside] = (0.2 + 0.04 * i) * (
            1 - np.cos(np.pi * np.minimum((time[inside] - i - 0.2) / 0.2, 1))
        )
    angle = _swing(time, force, **truth)
    random = np.random.default_rng(1)
    return (
        time,
        force + 0.003 * random.standard_normal(time.size),
        angle + 5e-5 * random.standard_normal(time.size),
        truth,
    )


@pytest.fixture(name="swing")
def _swing_fixture() -> Callable[..., np.ndarray]:
    return _swing
