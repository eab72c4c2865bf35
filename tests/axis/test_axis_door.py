"""Logs as laboratories have them, read unaided: names, registers, stamps, files of one joint."""

from __future__ import annotations

from datetime import datetime, timedelta
from itertools import zip_longest

import h5py
import numpy as np
import pytest
from laboratory import SECOND, TAU, N, Q, T, U, V, check, table
from scipy.io import savemat

from pianobot_ros.axis.reading import Request, read_log, read_recordings
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.cli.app import main
from pianobot_ros.gap import GapError

DEGREES = [np.degrees(y) for y in (U, Q)]
TICKS = [2048 + np.round(y * 4096 / (2 * np.pi)) for y in (U, Q)]
TICK = 2 * np.pi / 4096


def said(log, words):
    assert any(words in n for n in log.notes), log.notes


# -- names ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("header", "role", "joint", "unit"),
    [
        ("theta1_dot", "velocity", "1", ""),
        ("q1d", "command", "1", ""),
        ("theta2ref", "command", "2", ""),
        ("current_position", "position", "", ""),
        ("current_theta", "position", "", ""),
        ("q axis current [A]", "effort", "", "A"),
        ("motor_current", "effort", "", "A"),
        ("theta_m", "position", "", ""),
        ("stage_pos_m", "position", "stage", "m"),
        ("ID3_PresentPosition", "position", "3", ""),
        ("0x6064 Position Actual Value", "position", "", ""),
        ("6064h", "position", "", ""),
        ("0x607A:00", "command", "", ""),
        ("Axis 2 6077", "effort", "2", "‰"),
        ("6078h Current actual value [mA]", "effort", "", "mA"),
        ("6041h Statusword", "other", "", ""),
        ("torque [per mille of rated torque]", "effort", "", "‰"),
        ("planned_joint_4", "command", "4", ""),
        ("follower_pos_2", "position", "2", ""),
        ("axis1.encoder.pos_estimate", "position", "1", ""),
        ("/desired_state/position", "command", "", ""),
        ("controller_state/reference/elbow_joint/position", "command", "elbow", ""),
        ("position mesur\u00e9e (deg)", "position", "", "deg"),
        ("Motor Voltage (V)", "effort", "", "V"),
        ("joint_temperatures_0", "other", "", ""),
        ("Supply Voltage (V)", "other", "", ""),
        ("Achse 2 Strom", "effort", "2", "A"),
        ("r0078 Current actual value torque-generating [Arms]", "effort", "", "A"),
        ("Axis 1 Torque generating current [A rms]", "effort", "1", "A"),
        ("I_q (Arms)", "effort", "", "A"),
        ("qtorque_2", "effort", "2", "Nm"),
        ("pos_fdb_axis1", "position", "1", ""),
        ("dq_d_3", "other", "", ""),
        ("vel_r", "velocity", "r", ""),
    ],
)
def test_what_a_header_says(header, role, joint, unit):
    found = meaning(header)
    assert (found.role, found.unit) == (role, unit)
    if role != "other":
        assert found.joint == joint


def test_a_controller_s_input_is_no_second_joint(tmp_path):
    columns = {
        "time": T,
        "axis0.controller.input_pos": U,
        "axis0.controller.pos_setpoint": U,
        "axis0.encoder.pos_estimate": Q,
        "axis0.encoder.vel_estimate": V,
        "axis0.motor.current_control.Iq_measured": TAU,
    }
    path = table(tmp_path / "a.csv", columns)
    (recording,) = read_recordings([path], Request(units={"position": "rad"}))
    assert list(recording.joints) == ["0"]
    check(recording.joints["0"], velocity=True, effort=True, tolerance=1e-4)


def test_another_name_for_the_command_is_said_and_left_out(tmp_path):
    columns = {"time": T, "goal_pan": U, "pos_pan": Q, "pos_wish": U}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    check(recording.joints["pan"])
    assert any("pos_wish is goal_pan once more" in n for n in recording.notes)


def test_directions_are_joints(tmp_path):
    columns = {"time": T, "x": Q, "y": SECOND * Q, "x_d": U, "y_d": SECOND * U}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(recording.joints) == ["x", "y"]
    check(recording.joints["x"])
    assert np.allclose(recording.joints["y"].command, SECOND * U, atol=1e-5)


def test_the_twist_of_a_body_is_no_joint(tmp_path):
    """A pose beside it was none already; each direction had been a position in rad."""
    tool = {f"state/twist/{kind}/{x}": SECOND * V for kind in ("linear", "angular") for x in "xyz"}
    columns = {"time": T, "state/elbow": Q, "goal/elbow": U, **tool}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(recording.joints) == ["elbow"]
    columns = {"time": T, "state/torso_twist": Q, "goal/torso_twist": U}
    (recording,) = read_recordings([table(tmp_path / "b.csv", columns)])
    assert list(recording.joints) == ["torso twist"]


def test_a_state_with_its_own_slope_has_a_velocity(tmp_path):
    held = {"ref_state[0]": U, "ref_state[1]": np.gradient(U, T), "state[0]": Q, "state[1]": V}
    (recording,) = read_recordings([table(tmp_path / "a.csv", {"time": T, **held})])
    assert list(recording.joints) == ["0"]
    check(recording.joints["0"], velocity=True, tolerance=1e-4)
    assert any("slope of state[0]" in n for n in recording.notes)


def test_current_beside_a_goal_is_a_position_by_its_numbers(tmp_path):
    log = read_log(table(tmp_path / "a.csv", {"time": T, "goal": U, "current": Q}))
    check(log)
    said(log, "current follows goal")


# -- registers -----------------------------------------------------------------------------------
def test_ticks_with_a_sign_bit_and_steps_of_a_current(tmp_path):
    load = np.round(1000 * TAU)
    speed = np.round(V / TICK)
    columns = {
        "time": T,
        "goal_position": TICKS[0],
        "present_position": TICKS[1],
        "present_speed": np.where(speed < 0, 65536 + speed, speed),
        "present_current": np.where(load < 0, 1024 - load, load),
    }
    log = read_log(table(tmp_path / "a.csv", columns))
    assert np.allclose(log.position, Q + 2048 * TICK, atol=TICK)
    assert np.allclose(log.effort, load)
    assert np.allclose(log.velocity, V, atol=2 * TICK / 0.02)
    assert log.effort_unit == "counts"
    for words in ("bit of 1024", "down from 65536", "no stated unit", "4096 a turn"):
        said(log, words)


@pytest.mark.parametrize(("header", "guess"), [("tau", True), ("tau_Nm", False), ("M [Nm]", False)])
def test_a_unit_that_only_a_name_suggests_is_said(tmp_path, header, guess):
    log = read_log(table(tmp_path / "a.csv", {"time": T, "q_rad": Q, header: TAU}))
    assert log.effort_unit == "Nm"
    assert any("effort taken as Nm" in n for n in log.notes) == guess


def test_sizes_and_amperes_stay_what_they_are(tmp_path):
    size = np.abs(np.round(1000 * TAU))
    log = read_log(table(tmp_path / "a.csv", {"time": T, "pos_rad": Q, "load": size}))
    assert np.allclose(log.effort, size)
    named = {"time": T, "pos_rad": Q, "current [mA]": np.round(1000 * TAU)}
    log = read_log(table(tmp_path / "b.csv", named))
    assert log.effort_unit == "A" and np.allclose(log.effort, np.round(1000 * TAU) / 1000)


@pytest.mark.parametrize("bits", [12, 14, 16])
def test_an_encoder_that_comes_round_tells_its_counts(tmp_path, bits):
    counts = np.round(2**bits * 3 * Q / (2 * np.pi)) % 2**bits
    log = read_log(table(tmp_path / "a.csv", {"time": T, "encoder": counts, "torque": TAU}))
    assert np.allclose(np.diff(log.position), np.diff(3 * Q), atol=2 * np.pi / 2**bits * 1.01)
    said(log, f"{2**bits} a turn")


def test_steps_of_a_motor_beside_counts_of_an_encoder_are_doubted(tmp_path):
    columns = {"time": T, "target_steps": np.round(1600 * U), "encoder_counts": np.round(640 * Q)}
    log = read_log(table(tmp_path / "a.csv", columns))
    said(log, "0.4 times as far")


def test_degrees_that_come_round_for_one_sample(tmp_path):
    goal, angle = (y - y.min() + 1e-3 for y in DEGREES)
    angle[np.argmin(angle)] = -0.01
    columns = {"time": T, "goal_deg": goal % 360.0, "angle_deg": angle % 360.0}
    log = read_log(table(tmp_path / "a.csv", columns))
    assert np.isfinite(log.position).all()
    assert np.ptp(log.position) < 3.0 and np.ptp(log.command) < 3.0


def test_steps_of_half_a_degree_are_no_radians(tmp_path):
    goal, angle = (np.round(0.2 * y, 1) for y in DEGREES)
    log = read_log(table(tmp_path / "a.csv", {"time": T, "cmd": goal, "pos": angle}))
    assert np.allclose(log.position, 0.2 * Q, atol=np.radians(0.06))
    said(log, "taken as degrees")
    coarse = {"time": T, "cmd": np.round(U, 2), "pos": np.round(Q, 2)}
    assert np.allclose(read_log(table(tmp_path / "b.csv", coarse)).position, Q, atol=0.006)


def test_an_arm_whose_joints_pass_a_turn_is_in_degrees(tmp_path):
    small = [0.16 * y for y in DEGREES]
    columns = {f"{w}{k}": y for k in (1, 2, 3) for w, y in zip(("cmd", "pos"), small, strict=True)}
    (recording,) = read_recordings([table(tmp_path / "a.csv", {"time": T, **columns})])
    assert np.allclose(recording.joints["2"].position, 0.16 * Q, atol=1e-5)


# -- headers and stamps --------------------------------------------------------------------------
def test_a_preamble_whose_rows_hold_labels_and_numbers(tmp_path):
    """As scope programs export: each signal with a column of times and rows of its properties."""
    rows = ["Name\tSetPos\tName\tActPos", "SampleTime[ms]\t20\tSampleTime[ms]\t20"]
    rows += ["Data-Type\tREAL64\tData-Type\tREAL64", "Unit\tdeg\tUnit\tdeg"]
    rows += [
        f"{1e3 * t:.0f}\t{u:.7f}\t{1e3 * t:.0f}\t{q:.7f}"
        for t, u, q in zip(T, *DEGREES, strict=True)
    ]
    path = tmp_path / "scope.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    log = read_log(path)
    check(log)
    assert not any("degrees" in n for n in log.notes), "the row of units says so"


@pytest.mark.parametrize("brackets", ["{}", "[{}]", "({})"])
def test_a_row_of_units_in_upper_case_with_a_byte_order_mark(tmp_path, brackets):
    rows = [
        "TIME,REF_POS,ACT_POS,CURRENT",
        ",".join(map(brackets.format, ("ms", "deg", "deg", "mA"))),
    ]
    rows += [
        f"{1e3 * t:.3f},{u:.7f},{q:.7f},{1e3 * i:.5f}"
        for t, u, q, i in zip(T, *DEGREES, TAU, strict=True)
    ]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows), encoding="utf-8-sig")
    log = read_log(path)
    check(log, effort=True)
    assert log.effort_unit == "A" and np.allclose(log.effort, TAU, atol=1e-5)
    assert not any("taken as" in n for n in log.notes)


@pytest.mark.parametrize(
    "stamp",
    [
        lambda t: f"0 days 00:00:{t:09.6f}",
        lambda t: f"{t:.4f} sec",
        lambda t: str(timedelta(hours=1, seconds=round(t, 6))),
    ],
    ids=["pandas", "MATLAB", "Python"],
)
def test_durations_as_stamps(tmp_path, stamp):
    columns = {"time": [stamp(float(t)) for t in T], "command": U, "position": Q}
    check(read_log(table(tmp_path / "a.csv", columns)))


@pytest.mark.parametrize("bits", [16, 32])
def test_a_clock_that_overflows(tmp_path, bits):
    unit, scale = ("ms", 1e3) if bits == 16 else ("us", 1e6)
    stamps = (np.round(scale * T) + 2**bits - 3 * scale) % 2**bits
    check(read_log(table(tmp_path / "a.csv", {f"t_{unit}": stamps, "command": U, "position": Q})))


def test_coarse_stamps_of_an_even_rate_are_spread_evenly(tmp_path):
    t = np.arange(1000) / 250.0
    columns = {"time": np.floor(100 * t) / 100, "command": np.sin(t), "position": np.sin(t - 0.1)}
    log = read_log(table(tmp_path / "a.csv", columns))
    assert np.allclose(np.diff(log.t), 1 / 250.0, rtol=0.01)
    said(log, "coarse")


def test_decimal_commas_in_quotes_and_thousands(tmp_path):
    rows = ['"Zeit","Soll","Ist"']
    rows += [
        f'"{t:.4f}","{u:.9f}","{q:.9f}"'.replace(".", ",") for t, u, q in zip(T, U, Q, strict=True)
    ]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    check(read_log(path))
    rows = ["time,cmd_um,pos_um"]
    rows += [f'{t:.3f},"{1e7 * u:,.3f}","{1e7 * q:,.3f}"' for t, u, q in zip(T, U, Q, strict=True)]
    path.write_text("\n".join(rows), encoding="utf-8")
    assert np.allclose(read_log(path).position, 10 * Q, atol=1e-5)


def test_a_measurement_program_s_preamble_of_names_and_numbers(tmp_path):
    rows = ["Writer_Version\t2", "***End_of_Header***\t", "Channels\t2\t2\t"]
    rows += ["Samples\t300\t300\t", "X0\t0.0\t0.0\t", "***End_of_Header***\t\t\t"]
    rows += ["X_Value\tTarget\tPosition\tComment"]
    rows += [f"{t:.3f}\t{u:.9f}\t{q:.9f}\t" for t, u, q in zip(T, U, Q, strict=True)]
    path = tmp_path / "a.lvm"
    path.write_text("\n".join(rows), encoding="utf-8")
    check(read_log(path))


@pytest.mark.parametrize("line", ["# sample_rate: 50 Hz", "% fs = 0.05 kHz", "Sample Rate (Hz);50"])
def test_a_rate_above_the_numbers(tmp_path, line):
    rows = [line, "cmd;pos", *(f"{u:.9f};{q:.9f}" for u, q in zip(U, Q, strict=True))]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    log = read_log(path)
    check(log)
    said(log, "50 Hz")


def test_days_of_a_spreadsheet(tmp_path):
    days = [f"{45_123.5 + t / 86_400:.12f}" for t in T]
    log = read_log(table(tmp_path / "a.csv", {"time": days, "cmd": U, "pos": Q}))
    check(log)
    said(log, "stamps taken as d ")


def test_a_clock_of_positions_is_no_position(tmp_path):
    columns = {"time_cmd": T, "cmd": U, "time_pos": T + 0.003, "pos": Q}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(recording.joints) == [""]
    check(recording.joints[""])


# -- files ---------------------------------------------------------------------------------------
def test_a_joint_state_without_headers(tmp_path):
    """As `ros2 topic echo --csv` prints it."""
    rows = [
        f"{1700000000 + int(t)},{round(1e9 * (t % 1)):d},base,hip,knee,{q:.12g},{SECOND * q:.12g},"
        f"{v:.12g},{SECOND * v:.12g},{f:.12g},{SECOND * f:.12g}"
        for t, q, v, f in zip(T, Q, V, TAU, strict=True)
    ]
    path = tmp_path / "joint_states.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    (recording,) = read_recordings([path])
    assert list(recording.joints) == ["hip", "knee"]
    check(recording.joints["hip"], command=False, velocity=True, effort=True, tolerance=1e-4)
    assert np.allclose(recording.joints["knee"].position, SECOND * Q)
    assert any("JointState" in n for n in recording.notes)


def test_files_of_one_joint_each_are_not_runs_of_the_same(tmp_path):
    for k in (1, 2):
        columns = {"time": T, "command": k * U, "position": k * Q}
        table(tmp_path / f"joint{k}.csv", columns)
    joints = [name for r in read_recordings([tmp_path]) for name in r.joints]
    assert joints == ["1", "2"]


@pytest.mark.parametrize("named", [True, False])
def test_two_topics_of_one_robot_in_a_file_each(tmp_path, named):
    """As `rostopic echo -p` writes them; the second may not name its joints."""
    both = {"field.name0": ["hip"] * N, "field.name1": ["knee"] * N}
    state = {"%time": 1e9 * T + 1.7e18, **both}
    control = {"%time": 1e9 * T + 1.7e18 + 3e6}
    if named:
        control |= {"field.joint_names0": ["hip"] * N, "field.joint_names1": ["knee"] * N}
    for k, share in enumerate((1.0, SECOND)):
        state |= {f"field.position{k}": share * Q, f"field.effort{k}": share * TAU}
        control |= {
            f"field.desired.positions{k}": share * U,
            f"field.actual.positions{k}": share * Q,
        }
    table(tmp_path / "joint_states.csv", state)
    table(tmp_path / "controller_state.csv", control)
    (recording,) = read_recordings([tmp_path])
    assert list(recording.joints) == ["hip", "knee"]
    assert named or any(
        "command matched by what follows it: 0 is hip" in n for n in recording.notes
    )
    hip, knee = recording.joints.values()
    assert hip.effort is not None and knee.effort is not None
    assert np.allclose(hip.command[1:], np.interp(T - 0.003, T, U)[1:], atol=1e-3)
    assert np.allclose(knee.command[1:], SECOND * np.interp(T - 0.003, T, U)[1:], atol=1e-3)


def test_a_nameless_array_with_a_command_and_its_position(tmp_path):
    savemat(tmp_path / "out.mat", {"tout": T, "simout": np.column_stack([U, Q, TAU])})
    log = read_log(tmp_path / "out.mat")
    check(log)
    said(log, "simout[1] follows simout[0]")


def test_arrays_of_joints_that_only_move_alike_are_no_command(tmp_path, capsys):
    late = np.interp(T - 0.4, T, Q)
    path = table(tmp_path / "a.csv", {"time": T, "q[0]": Q, "q[1]": late})
    (recording,) = read_recordings([path])
    assert all(log.command is None for log in recording.joints.values())
    assert main(["axis", "columns", str(path)]) == 0
    assert "needs a command or an effort" in capsys.readouterr().out


def test_tables_without_headers_name_their_file(tmp_path, capsys):
    """The clock of a second file is no signal of it."""
    for name, y in (("q_meas", Q), ("q_des", U)):
        rows = np.column_stack([T, y, SECOND * y])
        np.savetxt(tmp_path / f"{name}.txt", rows, fmt="%.12g")
    assert main(["axis", "columns", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "q_des: column1" in out and "q_meas: column1" in out
    assert "degrees" not in out


def test_objects_that_only_matlab_opens_are_named(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "objects.h5", "w") as file:
        file["#refs#/a"] = np.column_stack([T, Q])
        file["#subsystem#/MCOS"] = np.arange(9.0)
    with pytest.raises(GapError, match="save their Time and Data"):
        read_log(tmp_path / "objects.h5")
    path = tmp_path / "objects.mat"
    savemat(path, {"note": "text"})
    held = {"__function_workspace__": np.zeros((1, 9), np.uint8), "note": "text"}
    monkeypatch.setattr("scipy.io.loadmat", lambda *a, **k: held)
    with pytest.raises(GapError, match="save their Time and Data"):
        read_log(path)


@pytest.mark.parametrize(
    "rows",
    [
        [f"{t:.2f},[{q:.4f} {u:.4f}],ok" for t, q, u in zip(T, Q, U, strict=True)],
        ["# sampling: . Hz", "a,b", *(f"{u},{q}" for u, q in zip(U, Q, strict=True))],
        ["time,encoder,torque", *(f"{t:.2f},{k},1e300" for k, t in enumerate(T)), "9,1e300,2"],
        ["[s],[deg]", "[s],[deg]", "1,2"],
        ["0x,1", "0x6064,id1", "-,-"],
    ],
    ids=["lists without headers", "no rate", "huge counts", "units only", "nothing"],
)
def test_odd_tables_are_read_or_refused_in_one_line(tmp_path, rows):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    assert main(["axis", "columns", str(path)]) in {0, 2}


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(GapError, match="no column of positions.*velocity = velocity"):
        read_log(table(tmp_path / "a.csv", {"time": T, "velocity": V, "current": TAU}))
    with pytest.raises(GapError, match="--rate HZ"):
        read_log(table(tmp_path / "b.csv", {"sample": np.arange(N), "ref": U, "pos": Q}))


SCOPE = (("Data-Type", "REAL64"), ("SampleTime[ms]", "1"))
"""What stands above the headers of every channel."""


@pytest.mark.parametrize("every", [1, 4])
def test_a_scope_writes_the_time_before_each_channel(tmp_path, every):
    """Channels may have rates of their own; the shorter ones end before, and a word ends it all."""
    t, q = np.arange(2000), 40 * np.sin(np.arange(2000) / 200)
    channels = {
        "SetPos": (t, q),
        "ActPos": (t, 0.9 * q),
        "ActTorque": (t[::every], 0.1 * q[::every]),
    }
    above = ["Name\tscope", "", *("\t".join(f"{w}\t{v}" for _ in channels) for w, v in SCOPE)]
    above.append("\t".join(f"SymbolName\tAxis 1.{name}" for name in channels))
    cells = [[f"{a}\t{b:.4f}" for a, b in zip(x, y, strict=True)] for x, y in channels.values()]
    rows = ["\t".join(row) for row in zip_longest(*cells, fillvalue="\t")]
    text = "\n".join(rows).replace(".", ",")
    (tmp_path / "scope.csv").write_text("\n".join([*above, "", text, "EOF"]))
    (recording,) = read_recordings([tmp_path / "scope.csv"])
    (log,) = recording.joints.values()
    assert np.allclose(log.t, t * 1e-3)
    for y, share in ((log.position, 0.9), (log.command, 1.0)):
        assert np.allclose(np.degrees(y), share * q, atol=1e-3)
    assert np.allclose(log.effort, 0.1 * q, atol=0.1)


@pytest.mark.parametrize("word", ["rev", "Revolutions", "turns", "rot", "rotation"])
def test_turns_have_many_names(tmp_path, word):
    path = table(tmp_path / "a.csv", {"time": T, "ref": U / (2 * np.pi), "pos": Q / (2 * np.pi)})
    (log,) = read_recordings([path], Request(units={"position": word}))[0].joints.values()
    check(log)


@pytest.mark.parametrize(
    ("said_", "valid"),
    [("position=furlong", "rad, deg, turn"), ("velocity=deg", "deg/s"), ("effort=lbs", "Nm, mNm")],
)
def test_a_unit_that_is_none_of_the_role_s_is_refused_with_those_that_are(said_, valid):
    role, unit = said_.split("=")
    with pytest.raises(GapError, match=f"unknown unit of {role} {unit!r}; valid: .*{valid}"):
        Request(units={f"elbow:{role}": unit})


@pytest.mark.parametrize("units", [{}, {"position": "rad"}])
def test_positions_of_odrive_are_turns_if_nobody_says_otherwise(tmp_path, units):
    scale = 1 if units else 2 * np.pi
    columns = {"pos_estimate": Q, "vel_estimate": V, "controller.input_pos": U}
    columns = {f"axis0.{name}": y / scale for name, y in columns.items()}
    path = table(tmp_path / "odrive.csv", {"time": T} | columns)
    (recording,) = read_recordings([path], Request(units=units))
    (log,) = recording.joints.values()
    check(log, velocity=True)
    assert any("ODrive" in note for note in log.notes) != bool(units)


@pytest.mark.parametrize("form", ["{:X}h {}", "0x{:04X}", "{:X}:00", "{:X}"])
def test_objects_of_a_drive_say_what_they_are(tmp_path, form):
    objects = {0x6062: U, 0x6064: Q, 0x606C: V, 0x6077: np.round(400 * TAU)}
    names = [form.format(index, "Demand value") for index in objects]
    rows = [["Time", *names], ["[s]", "[rad]", "[rad]", "[rad/s]", "[per mille]"]]
    rows += [[f"{x:.9g}" for x in row] for row in zip(T, *objects.values(), strict=True)]
    path = tmp_path / "trace.csv"
    path.write_text("\n".join(";".join(row) for row in rows), encoding="utf-8")
    (recording,) = read_recordings([path])
    assert list(recording.joints) == [""]
    log = recording.joints[""]
    check(log, velocity=True, effort=True)
    assert log.effort_unit == "%" and np.allclose(log.effort, 0.1 * np.round(400 * TAU))
    assert not any("no stated unit" in note for note in log.notes)


def test_what_comes_round_at_360_is_in_degrees(tmp_path):
    """Also where an effort fits the sine of the numbers by chance, as of what is wrapped."""
    columns = {"time": T}
    for k, (at, size) in enumerate(((0.0, 1.0), (90.0, 0.0), (180.0, 0.0))):
        columns |= {f"set_{k}": (at + size * DEGREES[0]) % 360.0}
        columns |= {f"act_{k}": (at + size * DEGREES[1]) % 360.0}
        columns |= {f"torque_{k}": size * np.sin(DEGREES[1] % 360.0)}
    (run,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert np.ptp(run.joints["0"].position) == pytest.approx(np.ptp(Q), abs=1e-3)
    assert any("come round at 360" in note for note in run.notes)


def test_joints_that_stand_still_are_no_copies_of_each_other(tmp_path):
    """Their variance is that of rounding, and so was what one left of the other."""
    columns = {"time": T, "q_cmd_0": U, "q_0": Q, "tau_0": TAU}
    for k, at in ((1, 57.2958), (2, 114.592)):
        columns |= {f"q_cmd_{k}": at + 0 * T, f"q_{k}": at + 0 * T, f"tau_{k}": TAU}
    (run,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(run.joints) == ["0", "1", "2"]
    assert not any("once more" in note for note in run.notes)


def test_the_newest_row_may_stand_first(tmp_path):
    columns = {"angle": Q[::-1], "target": U[::-1], "tau": TAU[::-1], "ts_ns": 1e9 * T[::-1]}
    check(read_log(table(tmp_path / "a.csv", columns)), effort=True)


def test_where_hours_go_up_to_twelve_months_stand_before_days(tmp_path):
    """A log that passes midnight lasted a month."""
    start = datetime(2026, 3, 1, 23, 59, 58)
    times = [start + timedelta(seconds=float(t)) for t in T]
    said_ = [t.strftime("%m/%d/%Y %I:%M:%S.%f %p") for t in times]
    check(read_log(table(tmp_path / "a.csv", {"time": said_, "target": U, "angle": Q})))


def test_a_value_in_a_file_of_its_own_is_of_the_joint_that_the_file_names(tmp_path):
    """Two axes had been two runs of one joint that is called "value"."""
    for k, size in ((1, 1.0), (2, SECOND)):
        for name, y in (("pos", Q), ("cmd", U), ("trq", TAU)):
            table(tmp_path / f"axis{k}_{name}.csv", {"t": T, "value": size * y})
    logs = {j: log for run in read_recordings([tmp_path]) for j, log in run.joints.items()}
    assert sorted(logs) == ["1", "2"]
    check(logs["1"], effort=True)


@pytest.mark.parametrize("ending", ["zip", "db3.zstd", "tar"])
def test_what_is_packed_is_to_be_unpacked(tmp_path, ending):
    path = tmp_path / f"run.{ending}"
    path.write_bytes(b"PK\3\4")
    with pytest.raises(GapError, match="unpack it"):
        read_recordings([path])


@pytest.mark.parametrize("gear", [101.0, 2.5, 0.01])
def test_where_a_gear_is_between_command_and_position_both_are_the_joint_s(tmp_path, gear):
    """A joint's command beside its motor's angle had been a spring and a stop, each at 94 %."""
    columns = {"time": T, "cmd_deg": DEGREES[0], "pos_deg": gear * DEGREES[1]}
    columns |= {"speed_rpm": gear * V * 30.0 / np.pi, "current_mA": 1e3 * TAU}
    log = read_log(table(tmp_path / "a.csv", columns))
    said(log, "gear")
    less = min(gear, 1.0)
    assert np.allclose(log.position, less * Q, atol=0.02 * less)
    assert np.allclose(log.command, less * U, atol=0.02 * less)
    assert np.allclose(log.velocity, less * V, atol=0.05 * less)
