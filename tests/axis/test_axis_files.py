"""Logs of several files: one for each quantity, told by the files' names; runs that a number sets
apart.
"""

from __future__ import annotations

import json
from datetime import datetime, timedelta

import numpy as np
import pytest
from laboratory import SECOND, TAU, N, Q, T, U, V, table
from scipy.io import savemat

from pianobot_ros.axis.reading import Request, read_recordings
from pianobot_ros.gap import GapError

RATE = Request(rate=50.0)
ARROW = "%H:%M:%S.%f -> "


def rows(path, y, header=""):
    both = np.column_stack([y, SECOND * y])
    np.savetxt(path, both, fmt="%.9g", delimiter=",", header=header, comments="")
    return path


def check(recording, *, velocity=True):
    assert len(recording.joints) == 2
    for share, log in zip((1.0, SECOND), recording.joints.values(), strict=True):
        assert np.allclose(log.position, share * Q, atol=1e-6)
        assert log.effort is not None and np.allclose(log.effort, share * TAU, atol=1e-6)
        assert (log.velocity is not None) == velocity


def test_a_file_for_each_quantity_without_headers(tmp_path):
    held = {"ang": Q, "vel": V, "acc": np.gradient(V), "torque": TAU, "motor": 2 * TAU}
    for name, y in held.items():
        rows(tmp_path / f"excit_{name}_record.txt", y)
    (recording,) = read_recordings([tmp_path], RATE)
    check(recording)
    assert any(
        "excit_acc_record.txt, excit_motor_record.txt: not used" in n for n in recording.notes
    )


@pytest.mark.parametrize("names", [("pos_read_data", "curr_data"), ("q_left", "tau_robot")])
def test_files_whose_headers_only_name_joints(tmp_path, names):
    """Currents are no positions, whatever the headers say."""
    place, drive = (
        rows(tmp_path / f"{n}.csv", y, "Joint_1,Joint_2")
        for n, y in zip(names, (Q, TAU), strict=True)
    )
    (recording,) = read_recordings([tmp_path], RATE)
    check(recording, velocity=False)
    with pytest.raises(GapError, match="the name says effort, and there is no file of positions"):
        read_recordings([drive], RATE)
    assert all(x.effort is None for x in read_recordings([place], RATE)[0].joints.values())


def test_a_torque_goes_before_a_current(tmp_path):
    for name, y in (("pos", Q), ("current", 3 * TAU), ("torque", TAU)):
        rows(tmp_path / f"run_{name}.csv", y)
    (recording,) = read_recordings([tmp_path], RATE)
    check(recording, velocity=False)
    assert {log.effort_unit for log in recording.joints.values()} == {"Nm"}


def test_runs_that_a_number_sets_apart_stay_apart(tmp_path):
    for k in (1, 2):
        for name, y in (("pos", Q), ("vel", V), ("torque", TAU)):
            rows(tmp_path / f"{name}_{k}.csv", y)
    recordings = read_recordings([tmp_path], RATE)
    assert len(recordings) == 2
    for recording in recordings:
        check(recording)


def test_files_of_other_lengths_are_not_laid_beside_each_other(tmp_path):
    rows(tmp_path / "pos.csv", Q)
    rows(tmp_path / "torque.csv", TAU[: N // 2])
    with pytest.raises(GapError, match="pos.csv has 300 rows and torque.csv 150, and neither has"):
        read_recordings([tmp_path], RATE)


@pytest.mark.parametrize("end", ["csv", "csv.gz"])
def test_runs_that_only_a_decimal_sets_apart(tmp_path, end):
    """The point of a number in a name is not where its ending begins."""
    for k in (1, 5):
        y = np.column_stack([T, U, k * Q])
        np.savetxt(tmp_path / f"one_0.{k}.{end}", y, delimiter=",", header="time,u,q", comments="")
    recordings = read_recordings([tmp_path])
    assert [r.name for r in recordings] == ["one_0.1", "one_0.5"]
    for k, recording in zip((1, 5), recordings, strict=True):
        (log,) = recording.joints.values()
        assert log.t.size == N and np.allclose(log.position, k * Q, atol=1e-6)


def test_variables_that_no_name_calls_a_position_are_refused(tmp_path):
    """Currents are none, whatever the file is called."""
    held = {"time": T, "Iz1": 2 * TAU, "Im": TAU, "data": np.column_stack([Q, np.cos(9 * T), V])}
    savemat(tmp_path / "pos_1.mat", held)
    with pytest.raises(GapError, match=r"no column of positions \(there is effort = Im\).*Iz1, Im"):
        read_recordings([tmp_path / "pos_1.mat"])
    named = Request({"position": "data[0]", "effort": "Im"})
    (recording,) = read_recordings([tmp_path / "pos_1.mat"], named)
    (log,) = recording.joints.values()
    assert np.allclose(log.position, Q) and np.allclose(log.effort, TAU)
    assert log.effort_unit == "A"


def test_variables_called_as_joints_are_their_positions(tmp_path):
    np.savez(tmp_path / "a.npz", time=T, left_elbow=Q, left_wrist=SECOND * Q)
    (recording,) = read_recordings([tmp_path / "a.npz"])
    assert list(recording.joints) == ["left elbow", "left wrist"]


@pytest.mark.parametrize("request_", [Request(), Request({"position": "nothing"}), RATE])
def test_a_list_of_columns_says_how_many_more_there_are(tmp_path, request_):
    held = {f"digital bits {k}": np.cos(T * k) for k in range(33)}
    path = table(tmp_path / "a.csv", held)
    with pytest.raises(GapError, match=r"digital bits 19, … and 13 more"):
        read_recordings([path], request_)


@pytest.mark.parametrize(
    "line",
    [
        "Time: {0:.3f} Position: {1:.6f} Current: {2:.6f}",
        "time={0:.3f}, position={1:.6f} rad, current={2:.6f} A",
        "t1: {0:.3f} s; position: {1:.6f} rad; current: {2:.6f} mA;",
    ],
)
def test_labels_before_each_number(tmp_path, line):
    rows_ = [line.format(*x) for x in zip(T, Q, TAU, strict=True)]
    path = tmp_path / "a.txt"
    path.write_text("\n".join(["# a servo", *rows_, rows_[-1][:20]]), encoding="utf-8")
    (recording,) = read_recordings([path])
    (log,) = recording.joints.values()
    assert log.t.size == N and np.allclose(log.position, Q, atol=2e-6)
    assert np.allclose(log.effort, TAU * (1e-3 if "mA" in line else 1.0), atol=2e-6)
    assert log.effort_unit == "A"


@pytest.mark.parametrize("colon", [": ", "："])
def test_labels_are_words_of_any_script(tmp_path, colon):
    line = "{0:.3f},编码器角度" + colon + "{1:.6f} 度, 目标角度" + colon + "{2:.6f} 度"
    rows_ = [line.format(*x) for x in zip(T, np.degrees(Q), np.degrees(U), strict=True)]
    (tmp_path / "a.txt").write_text("\n".join(rows_), encoding="utf-8")
    (recording,) = read_recordings([tmp_path / "a.txt"])
    (log,) = recording.joints.values()
    assert np.allclose(log.t, T, atol=2e-6) and np.allclose(log.position, Q, atol=2e-6)
    assert np.allclose(log.command, U, atol=2e-6)


def stamps(form):
    """What a program writes before each line that it receives at `T`."""
    when = [datetime(2024, 3, 5, 14, 3, 8) + timedelta(seconds=float(t)) for t in T]
    return [w.strftime(form) for w in when]


@pytest.mark.parametrize("form", [ARROW, "[%H:%M:%S.%f] ", "%Y-%m-%d %H:%M:%S.%f "])
@pytest.mark.parametrize("own", ["", "t: {3:.3f} "])
def test_stamps_before_labels(tmp_path, form, own):
    """The clock of who wrote the labels goes before that of who received them."""
    line = "{0}" + own + "pos: {1:.6f} rad cmd: {2:.6f} rad"
    rows_ = [line.format(*x) for x in zip(stamps(form), Q, U, T, strict=True)]
    (tmp_path / "a.txt").write_text("\n".join(["14:03:07.9 -> homing... done", *rows_]))
    (recording,) = read_recordings([tmp_path / "a.txt"])
    (log,) = recording.joints.values()
    assert np.allclose(log.t, T, atol=2e-6) and np.allclose(log.position, Q, atol=2e-6)
    assert np.allclose(log.command, U, atol=2e-6)
    assert recording.clock == ("t" if own else "time_received")


@pytest.mark.parametrize("separator", [",", "\t", " "])
def test_stamps_with_an_arrow_before_rows(tmp_path, separator):
    made = [f"{s}{q:.6f}{separator}{u:.6f}" for s, q, u in zip(stamps(ARROW), Q, U, strict=True)]
    head = f"14:03:08.000000 -> pos1{separator}cmd1"
    (tmp_path / "a.txt").write_text("\n".join([head, *made]))
    (recording,) = read_recordings([tmp_path / "a.txt"])
    (log,) = recording.joints.values()
    assert np.allclose(log.t, T, atol=2e-6) and np.allclose(log.position, Q, atol=2e-6)
    assert np.allclose(log.command, U, atol=2e-6)


@pytest.mark.parametrize("turns", [False, True])
def test_an_element_in_each_line(tmp_path, turns):
    """What a robot sends, with what it is sent in between; a last line may be cut off."""
    sent = "<Sen><IPOC>{3:.0f}</IPOC></Sen>"
    line = (
        '<Rob Type="KUKA"><RIst X="{0:.4f}" Y="1"/><AIPos A1="{0:.6f}" A2="{1:.6f}"/>'
        '<ASPos A1="{2:.6f}" A2="{1:.6f}"/><IPOC>{3:.0f}</IPOC></Rob>'
    )
    both = f"{line}\n{sent}" if turns else line
    values = zip(*np.degrees((Q, SECOND * Q, U)), 4208121340 + 1e3 * T, strict=True)
    text = "\n".join(both.format(*x) for x in values)
    (tmp_path / "packets.log").write_text(f"{text}\n<Rob Type=")
    (recording,) = read_recordings([tmp_path / "packets.log"])
    first, second = recording.joints.values()
    assert np.allclose(first.t, T) and np.allclose(first.position, Q, atol=1e-6)
    assert np.allclose(first.command, U, atol=1e-6)
    assert np.allclose(second.position, SECOND * Q, atol=1e-6)


def test_entities_of_an_element_are_not_followed(tmp_path):
    line = '<!DOCTYPE a [<!ENTITY b "1">]><a t="1" position="&b;" effort="2"/>'
    (tmp_path / "a.log").write_text("\n".join([line] * 50))
    with pytest.raises(GapError):
        read_recordings([tmp_path / "a.log"])


@pytest.mark.parametrize("flow", [False, True])
def test_messages_as_an_echo_prints_them(tmp_path, flow):
    def listed(key, values):
        if flow:
            return f"{key}: [{', '.join(values)}]"
        return "\n".join([f"{key}:", *(f"- {v}" for v in values)])

    sec, nanosec = ("secs", "nsecs") if flow else ("sec", "nanosec")
    made = []
    for t, *y in zip(T, Q, SECOND * Q, TAU, SECOND * TAU, strict=True):
        when = round(1e9 * (1589000123 + t))
        stamp = f"  stamp:\n    {sec}: {when // 10**9}\n    {nanosec}: {when % 10**9}"
        words = [f"{x:.9f}" for x in y]
        lists = [listed("name", ["'elbow'", "'lift'"]), listed("position", words[:2])]
        lists += ["velocity: []", listed("effort", words[2:])]
        made.append("\n".join(["header:", stamp, "  frame_id: ''", *lists]))
    (tmp_path / "joints.yaml").write_text("\n---\n".join([*made, made[0][:70]]))
    (recording,) = read_recordings([tmp_path / "joints.yaml"])
    assert list(recording.joints) == ["elbow", "lift"]
    check(recording, velocity=False)


def test_what_a_data_set_says_of_its_logs_is_no_log(tmp_path):
    for name in ("meta", "data"):
        (tmp_path / name).mkdir()
    lines = [json.dumps({"episode_index": k, "length": 450}) for k in range(4)]
    (tmp_path / "meta" / "episodes.jsonl").write_text("\n".join(lines))
    table(tmp_path / "data" / "run.csv", {"t": T, "q": Q, "tau": TAU})
    (recording,) = read_recordings([tmp_path])
    assert not any("left out" in n for n in recording.notes)


def test_commands_and_states_of_a_folder_are_one_run(tmp_path):
    """Topics of one robot, written to a file each under names that have nothing else in common."""
    table(tmp_path / "robot_joint_states.csv", {"time": T, "position0": Q, "effort0": TAU})
    table(tmp_path / "robot_limb_right_joint_command.csv", {"time": T, "position0": U})
    (recording,) = read_recordings([tmp_path])
    (log,) = recording.joints.values()
    assert log.command is not None and np.allclose(log.command, U, atol=1e-6)
    assert np.allclose(log.position, Q, atol=1e-6)


def test_whole_logs_stay_apart_whatever_their_names_say(tmp_path):
    for name in ("reference_run", "with_load"):
        table(tmp_path / f"{name}.csv", {"time": T, "q_cmd": U, "q": Q})
    assert len(read_recordings([tmp_path])) == 2


def test_yaml_of_messages_is_a_log_and_of_settings_none(tmp_path):
    def document(t, q):
        return f"header:\n  stamp:\n    sec: {int(t)}\n    nanosec: {round(t % 1 * 1e9)}\n" + (
            f"name:\n- a\n- b\nposition:\n- {q:.9f}\n- {SECOND * q:.9f}\n---\n"
        )

    for name, y in (("joint_states", Q), ("joint_commands", U)):
        text = "".join(document(t, q) for t, q in zip(T, y, strict=True))
        (tmp_path / f"{name}.yaml").write_text(text)
    (tmp_path / "controllers.yaml").write_text("gains:\n  p: 3.0\n  d: 0.1\n")
    (recording,) = read_recordings([tmp_path])
    assert list(recording.joints) == ["a", "b"]
    assert not any("controllers" in n for n in recording.notes)
    assert all(x.command is not None for x in recording.joints.values())


def test_a_store_that_is_not_read_says_how_to_save_it(tmp_path):
    store = tmp_path / "replay.zarr"
    (store / "data").mkdir(parents=True)
    with pytest.raises(GapError, match=r"Zarr stores are not read; save .* numpy\.savez"):
        read_recordings([store])


def test_the_letter_that_headers_begin_with_is_the_axis(tmp_path):
    """S, L, U, R, B, T are axes, though U is a voltage, R a reference and T a time elsewhere."""
    axes = "SLURBT"
    columns = {"Time[ms]": 1e3 * T} | {f"{a} CmdPulse[pulse]": np.round(1e4 * U) for a in axes}
    columns |= {f"{a} FbPulse[pulse]": np.round(1e4 * Q) for a in axes}
    columns |= {f"{a} Torque[%]": TAU for a in axes}
    (recording,) = read_recordings([table(tmp_path / "log.csv", columns)])
    assert list(recording.joints) == list(axes.lower())
    assert all(x.command is not None and x.effort is not None for x in recording.joints.values())


def test_a_motor_s_angle_stands_beside_its_link_s(tmp_path):
    """Names as in exercises of flexible joints; a current goes before the voltage beside it."""
    motor = Q + 0.01 * np.sin(3 * T)
    columns = {
        "time": T,
        "Desired angle theta_d (deg)": np.degrees(U),
        "Motor angle theta_m (deg)": np.degrees(motor),
        "Link angle theta_l (deg)": np.degrees(Q),
        "Motor current I_m (A)": TAU,
        "Motor voltage V_m (V)": 2.0 * TAU,
        "Tachometer omega_m (deg/s)": np.degrees(np.gradient(motor, T)),
    }
    (recording,) = read_recordings([table(tmp_path / "log.csv", columns)])
    (log,) = recording.joints.values()
    assert log.link is not None and np.allclose(log.link, Q, atol=1e-6)
    assert np.allclose(log.position, motor, atol=1e-3) and log.velocity is not None
    assert np.allclose(log.effort, TAU) and log.effort_unit == "A"
