"""The joint fit of a straight line, whose intervals follow from what it leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from pianobot_ros.piano.identify.cell.joint import Data, Joint, fit_joint

GROUPS, EACH, FLOOR, USUAL = 12, 20, 0.01, 0.02


@dataclass(frozen=True)
class Line:
    """A channel of ``value`` (n,) = x times a known shape; one effect that changes nothing."""

    data: Data
    shape: np.ndarray
    tolerance: np.ndarray

    def predict(self, x: np.ndarray) -> np.ndarray:
        return x[0] * self.shape

    def slopes(self, x: np.ndarray) -> np.ndarray:
        return self.shape[:, None]

    def signatures(self, x: np.ndarray) -> np.ndarray:
        return np.zeros((self.shape.size, 1))


def fitted(left: float, usual: float = USUAL) -> Joint:
    """A fit that leaves a wave of ``left`` root mean square, orthogonal to the line."""
    n = GROUPS * EACH
    shape = np.tile(np.linspace(-1, 1, EACH), GROUPS)
    wave = left * np.sqrt(2) * np.cos(2 * np.pi * (np.arange(n) % EACH + 0.5) / EACH)
    data = Data(
        0.3 * shape + wave,
        np.zeros(n, dtype=np.int64),
        np.repeat(np.arange(GROUPS), EACH),
        np.ones(n),
        np.array([FLOOR]),
        np.array([usual]),
        np.array([False]),
    )
    return fit_joint(Line(data, shape, np.array([0.05])), np.zeros(1))


def test_what_is_usual_widens_nothing_and_what_goes_beyond_widens_all_by_as_much() -> None:
    along = np.ones(1)
    usual, beyond = fitted(0.9 * USUAL), fitted(4 * USUAL)
    assert usual.birge == 1.0 and beyond.birge == pytest.approx(4.0, rel=0.03)
    assert usual.half(along) >= 1.6 * 0.05
    assert beyond.half(along) > 3.8 * usual.half(along)
    assert abs(beyond.x[0] - 0.3) < usual.half(along)


def test_where_nothing_is_known_to_be_usual_nothing_widens() -> None:
    assert fitted(4 * USUAL, usual=np.inf).birge == 1.0
