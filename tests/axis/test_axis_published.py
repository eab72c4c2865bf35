"""Small logs in the forms of some that others publish."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check
from scipy.io import savemat

from pianobot_ros.axis.reading import read_recordings
from pianobot_ros.axis.reading.names import meaning
from pianobot_ros.gap import GapError


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


@pytest.mark.parametrize("resting", [0.0, 1e-4])
def test_one_joint_that_moves_alone_tells_the_blocks_of_a_table(tmp_path, resting):
    noise = np.random.default_rng(4).normal(size=(4, T.size)) * resting
    q = np.degrees(Q) + 90.0
    rpm = np.gradient(q, T) / 6.0
    rows = [T, noise[0], q, noise[1] + 2.0, noise[2], rpm, noise[3], TAU * 0.1, TAU, TAU * 0.2]
    np.savetxt(tmp_path / "arm.txt", np.stack(rows, 1))
    (run,) = read_recordings([tmp_path / "arm.txt"])
    log = run.joints["2"]
    check(
        replace(log, position=log.position - np.radians(90.0)),
        command=False,
        velocity=True,
        effort=True,
    )


def test_what_rests_is_no_slope_of_what_moves(tmp_path):
    leaning = 0.9 + 1e-4 * np.gradient(Q, T)
    columns = [T, Q, 0.3 + 1e-6 * TAU, leaning, 2.0 - 1e-6 * TAU, TAU, TAU**2]
    np.savetxt(tmp_path / "arm.txt", np.stack(columns, 1))
    with pytest.raises(GapError, match="no column of positions"):
        read_recordings([tmp_path / "arm.txt"])


def test_arrays_of_other_lengths_in_one_file_are_not_called_files(tmp_path):
    savemat(tmp_path / "run.mat", {"opt": np.stack([Q, V, TAU]), "solved": np.linspace(0, 1, 31)})
    with pytest.raises(GapError, match="holds arrays of 300 and of 31 rows"):
        read_recordings([tmp_path / "run.mat"])


@pytest.mark.parametrize("owner", ["data set", "file", "group", "positions", "text"])
def test_names_of_joints_in_hdf5(tmp_path, owner):
    names = ["shoulder", "elbow"]
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["time"] = T
        of = {"joint_positions": Q, "joint_targets": U, "joint_torques": TAU}
        for key, y in of.items():
            file[f"arm/{key}"] = np.stack([y, 2 * y], 1)
        if owner == "data set":
            file["joint_names"] = names
        at = {"file": file, "group": file["arm"], "positions": file["arm/joint_positions"]}
        if owner != "data set":
            at.get(owner, file).attrs["joint_names"] = (
                "shoulder, elbow" if owner == "text" else names
            )
    (run,) = read_recordings([tmp_path / "run.h5"])
    assert list(run.joints) == names
    check(run.joints["shoulder"], effort=True)
