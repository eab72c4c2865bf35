"""Small logs in the forms of some that others publish."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import TAU, Q, T, V, check
from scipy.io import savemat

from pianobot_ros.axis.reading import read_recordings
from pianobot_ros.axis.reading.names import meaning


@pytest.mark.parametrize("word", ["q_ddot", "theta_ddot", "q_dot_dot", "thetaddot", "xddot"])
def test_a_second_derivative_is_no_position(word):
    assert meaning(f"{word}_filtered[2]").role == "acceleration"
    assert meaning(f"{word.replace('ddot', 'dot').replace('dot_dot', 'dot')}[2]").role == "velocity"


@pytest.mark.parametrize(
    ("word", "role"),
    [
        ("jointacttorque", "effort"),
        ("measuredjointpos1", "position"),
        ("jointtargetpos1", "command"),
        ("positioncontroller", "position"),
    ],
)
def test_three_words_may_be_written_as_one(word, role):
    assert meaning(word).role == role


def test_arrays_of_a_filter_are_the_joints_they_are_of(tmp_path):
    of = {"q_filtered": Q, "q_dot_filtered": V, "jointacttorque_filtered": TAU}
    of |= {"q_ddot_filtered": np.gradient(V, T)}
    savemat(tmp_path / "run.mat", {"t": T} | {h: np.stack([y, 2 * y], 1) for h, y in of.items()})
    (run,) = read_recordings([tmp_path / "run.mat"])
    assert list(run.joints) == ["0", "1"]
    check(run.joints["0"], command=False, velocity=True, effort=True)
