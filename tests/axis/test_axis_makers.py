"""Tables as programs of makers of drives and robots write them, in their words and code pages."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import SECOND, TAU, Q, T, U, V, check, table

from pianobot_ros.axis.reading import read_log, read_recordings
from pianobot_ros.axis.reading.request import Request
from pianobot_ros.gap import GapError


def test_beside_what_is_actual_the_same_word_is_what_was_to_be(tmp_path):
    """A PLC's axis has `Position` and `Velocity` as setpoints, its torque in a group `Status…`."""
    axis = "PositioningAxis_1."
    columns = {"Time [s]": T, axis + "Position": U, axis + "Velocity": np.gradient(U, T)}
    columns |= {axis + "ActualPosition": Q, axis + "ActualVelocity": V}
    columns |= {axis + "StatusTorqueData.ActualTorque": TAU}
    log = read_log(table(tmp_path / "trace.csv", columns, delimiter=";"))
    check(log, velocity=True, effort=True)
    assert log.effort_unit == "Nm"
    assert any("which is taken as its command" in n for n in log.notes)


def test_seconds_and_nano_seconds_are_one_clock(tmp_path):
    """As KUKA's recorder calls them."""
    whole = [f"{int(1.7e9 + t)}" for t in T]
    rest = [f"{round(t % 1 * 1e9)}" for t in T]
    columns = {"ZeitSec": whole, "ZeitNanoSec": rest, "axisQMsr": Q, "axisQCmd": U}
    (run,) = read_recordings([table(tmp_path / "rec.log", columns, delimiter=" ")])
    assert run.clock == "ZeitSec + ZeitNanoSec"
    (log,) = run.joints.values()
    check(log)


@pytest.mark.parametrize(
    "page, words",
    [
        ("cp932", ["時間[s]", "位置指令[rad]", "現在位置[rad]", "トルク[Nm]"]),
        ("gb18030", ["时间[s]", "目标位置[rad]", "实际位置[rad]", "扭矩[Nm]"]),
        ("cp1252", ["Zeit [s]", "Sollposition [°]", "Istposition [°]", "Moment [N·m]"]),
    ],
)
def test_a_code_page_is_that_in_which_words_are_known(tmp_path, page, words):
    scale = np.degrees(1.0) if "°" in words[1] else 1.0
    columns = dict(zip(words, (T, scale * U, scale * Q, TAU), strict=True))
    path = table(tmp_path / "a.csv", columns)
    path.write_bytes(path.read_text(encoding="utf-8").encode(page))
    log = read_log(path)
    check(log, effort=True)
    assert log.effort_unit == "Nm"


def test_numbers_with_their_unit_or_of_sixteen_digits(tmp_path):
    columns = {"t": [f"{t:.3f} s" for t in T], "pos": [f"{np.degrees(q):.6f} deg" for q in Q]}
    columns |= {
        "cmd": [f"{np.degrees(u):.6f} deg" for u in U],
        "torque": [f"{x:.6f}Nm" for x in TAU],
    }
    check(read_log(table(tmp_path / "a.csv", columns)), effort=True)
    counts = {k: [f"0x{round((2 + y) * 65536):X}" for y in x] for k, x in (("cmd", U), ("pos", Q))}
    path = table(tmp_path / "b.csv", {"t": T, **counts, "torque": TAU})
    (run,) = read_recordings([path], Request(units={"position": "411774.8/turn"}))
    (log,) = run.joints.values()
    assert np.allclose(log.position - log.position[0], Q - Q[0], atol=1e-4)


def test_columns_of_words_are_named_where_positions_lack(tmp_path):
    columns = {"t": T, "pos": ["on" for _ in T], "torque": TAU}
    with pytest.raises(GapError, match=r"words, which are not read: pos \(on\)"):
        read_log(table(tmp_path / "a.csv", columns))


@pytest.mark.parametrize("name", ["joint{}", "IRB: Controller: J{}"])
def test_what_only_names_a_joint_is_its_position_and_the_tool_is_none(tmp_path, name):
    """x, y and z had been the joints, and the joints' torques theirs."""
    columns = {"time": T, "x": 300 + 50 * np.sin(T), "y": 50 * np.cos(T), "z": 9 * np.sin(2 * T)}
    for k, size in enumerate((1.0, SECOND, -0.3), 1):
        own = name.format(k)
        columns |= {own: size * Q, f"{own} torque": size * TAU, f"target {own}": size * U}
    (run,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert len(run.joints) == 3
    check(next(iter(run.joints.values())), effort=True)


def test_two_angles_or_an_angle_and_x_are_two_joints(tmp_path):
    """Of a cart's pole the force had been the pole's torque, and x was left out."""
    columns = {"t": T, "x": 0.5 * Q, "x_ref": 0.5 * U, "theta": Q, "theta_ref": U, "F": TAU}
    (run,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(run.joints) == ["x", "theta"]
    check(run.joints["theta"])
    columns = {"t": T, "phi": 0.5 * Q, "phi_cmd": 0.5 * U, "theta": Q, "theta_cmd": U}
    (run,) = read_recordings([table(tmp_path / "b.csv", columns)])
    assert np.allclose(run.joints["phi"].command, 0.5 * U)
    check(run.joints["theta"])


def test_counts_of_a_motor_behind_a_gear_need_no_unit(tmp_path):
    columns = {"t": T, "motor_pos_counts": np.round(2e5 * (Q + 0.01 * TAU)), "link_pos_rad": Q}
    log = read_log(table(tmp_path / "a.csv", {**columns, "cmd_rad": U, "motor_current": TAU}))
    assert log.link is not None and np.allclose(log.link, Q)
    assert np.allclose(log.position, Q + 0.01 * TAU, atol=0.02)


def test_a_current_position_is_no_current(tmp_path):
    columns = {"t": T, "J1 current position": Q, "J1 target position": U, "J1 motor current": TAU}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log, effort=True)
    assert log.effort_unit == "A"
