"""Traces as drives and robots' controllers export them, and signals in long lines; headers are of
files that owners of such machines published.
"""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check, table

from pianobot_ros.axis.reading import Request, read_log, read_recordings
from pianobot_ros.axis.reading.headers.meaning import meaning

EPOS = """\
Date:;2021-10-26 11:43:46
Firmware Version:;0x0150;0x6552;0x0000;0x0000
Index:;0x6064;0x6062;0x60F4;0x0000
Subindex:;0x00;0x00;0x00;0x00
Recorded samples:;300
Sampling period:;20.000
Scale:;0;False;716.800;-27,302.000;24,434.800;30,169.200
Trigger:;0;0.000000;"Parameter values";"Channel 2";"Rising above value"
TriggerAttributes:;1;4;0x6062;0x00;0.000000
;Position actual value;Position demand value;Following error actual value
ms;inc;inc;inc
"""


def test_a_clock_may_have_no_name_but_a_unit(tmp_path):
    counts = [np.round(4096 * y / (2 * np.pi)) for y in (Q, U, U - Q)]
    rows = np.column_stack([1e3 * T, *counts])
    lines = (";".join(f"{x:.3f}" if k == 0 else f"{x:.0f}" for k, x in enumerate(r)) for r in rows)
    path = tmp_path / "trace.csv"
    path.write_text(EPOS + "\n".join(lines) + "\n")
    check(read_log(path), tolerance=2e-3)


def test_increments_under_a_header_of_degrees_are_told_by_the_velocity(tmp_path):
    many = 1e6 * 180 / np.pi
    far = 40.0  # a motor's angle, which counts on
    path = table(
        tmp_path / "drive.csv",
        {
            "Zeit[sec]": T,
            "Sollposition[°]": np.round(many * far * U),
            "Istposition[°]": np.round(many * far * Q),
            "Istgeschwindigkeit[°/s]": np.degrees(far * V),
        },
        delimiter=";",
    )
    log = read_log(path)
    assert np.allclose(log.position / far, Q, atol=1e-2)
    assert log.command is not None and np.allclose(log.command / far, U, atol=1e-2)


def test_a_stated_unit_is_heard_where_it_may_be_true(tmp_path):
    columns = {"t": T, "pos[deg]": np.degrees(Q), "cmd[deg]": np.degrees(U), "vel[deg/s]": 9 * V}
    check(read_log(table(tmp_path / "a.csv", columns)), velocity=True)


def test_a_tool_s_place_and_turn_are_no_joints_beside_numbered_axes(tmp_path):
    one, two = Q, Q[::-1] + 0.4 * np.sin(3.0 * T)
    ahead = np.gradient(two, T) * 0.1 + two
    columns = {
        "Zeit[sec]": T,
        "X_Act[mm]": 300 + 90 * np.cos(one),
        "Y_Act[mm]": 90 * np.sin(one),
        "Z_Act[mm]": 500 + 50 * two,
        "A_Act[°]": np.degrees(ahead),
        "AxisPos_Act1[°]": np.degrees(one),
        "AxisPos_Act2[°]": np.degrees(two),
        "GearTorq_Act1[Nm]": TAU,
        "GearTorq_Act2[Nm]": 0.5 * TAU,
    }
    (recording,) = read_recordings([table(tmp_path / "ipo.csv", columns, delimiter=";")])
    assert {(c.joint, c.role) for c in recording.taken} == {
        (joint, role) for joint in "12" for role in ("position", "effort")
    }


def test_a_cart_is_a_joint_beside_its_pendulums(tmp_path):
    columns = {"t": T, "x": 0.1 * U, "theta1": Q, "theta2": Q[::-1], "u": TAU}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert {"x", "theta1", "theta2"} <= {c.header for c in recording.taken}


@pytest.mark.parametrize(
    "header", ["motor_data.bus_voltage[0]", "motor supply voltage", "Motor_Battery_Volt"]
)
def test_a_supply_s_voltage_is_no_effort(header):
    assert meaning(header).role == "other"
    assert meaning("motor_voltage[0]").role == "effort"


@pytest.mark.parametrize("separator", ["\t", " ", ","])
def test_signals_in_long_lines_are_laid_upright(tmp_path, separator):
    for name, y in (("leg_theta", Q), ("leg_cmd_theta", U), ("leg_torque", TAU)):
        (tmp_path / f"{name}.txt").write_text(separator.join(f"{x:.12g}" for x in y) + separator)
    (recording,) = read_recordings([*tmp_path.iterdir()], Request(rate=50.0))
    check(*recording.joints.values(), effort=True)


def test_long_lines_may_begin_with_their_names(tmp_path):
    lines = [
        ";".join([name, *(f"{x:.12g}".replace(".", ",") for x in y)])
        for name, y in (("time", T), ("position", Q), ("target", U))
    ]
    path = tmp_path / "rows.csv"
    path.write_text("\n".join(lines) + "\n")
    check(read_log(path))


@pytest.mark.parametrize(
    "heads",
    [
        ("时间", "期望位置", "实际位置", "实际转速", "电机电流"),
        ("時間[s]", "目標角度", "現在角度", "角速度", "トルク"),
    ],
    ids=["Chinese", "Japanese"],
)
def test_headers_in_languages_without_spaces(tmp_path, heads):
    path = table(tmp_path / "a.csv", dict(zip(heads, (T, U, Q, V, TAU), strict=True)))
    check(read_log(path), velocity=True, effort=True)
