"""Logs in the words of buses and drives: decoded messages, Sercos parameters, second encoders."""

from __future__ import annotations

import json

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check, table

from pianobot_ros.axis.reading import read_log, read_recordings
from pianobot_ros.gap import GapError

TURN = 180.0 / np.pi


def decoded(path, on_one_line):
    rows = []
    for k, t in enumerate(T):
        said = {
            "181   [8]  00 00 :: HIP_LEFT_TPDO1": [
                f"ActualPosition: {TURN * Q[k]:.9f} deg",
                f"DemandPosition: {TURN * U[k]:.9f} deg",
            ],
            "281   [8]  FD FF :: HIP_LEFT_TPDO2": [
                f"ActualCurrent: {1e3 * TAU[k]:.6f} mA",
                "Statusword: 'OpEnabled'",
            ],
            "182   [4]  0A :: HIP_RIGHT_TPDO1": [
                f"ActualPosition: {TURN * (Q[k] + 0.1):.9f} deg",
                f"DemandPosition: {TURN * (U[k] + 0.1):.9f} deg",
            ],
            "701   [1]  05 :: HIP_LEFT_HB": ["NmtState: 'Operational'"],
        }
        for frame, signals in said.items():
            stamp = f" ({1.7e9 + t:.6f})  can0  {frame}("
            between = ", " if on_one_line else ",\n    "
            rows.append(stamp + ("" if on_one_line else "\n    ") + between.join(signals) + ")")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("on_one_line", [True, False])
def test_messages_of_a_bus_as_cantools_decodes_them(tmp_path, on_one_line):
    (run,) = read_recordings([decoded(tmp_path / "exo.log", on_one_line)])
    assert list(run.joints) == ["hip left", "hip right"]
    left = run.joints["hip left"]
    check(left, effort=True)
    assert left.effort_unit == "A"
    assert np.allclose(run.joints["hip right"].position, Q + 0.1, atol=1e-5)


def test_messages_without_numbers_are_refused_in_one_line(tmp_path):
    row = " (1.5)  can0  701   [1]  05 :: HIP_HB(NmtState: 'Operational')\n"
    (tmp_path / "quiet.log").write_text(500 * row, encoding="utf-8")
    with pytest.raises(GapError, match=r"quiet\.log"):
        read_log(tmp_path / "quiet.log")


def test_a_table_may_say_of_messages_in_its_preamble(tmp_path):
    path = table(tmp_path / "log.csv", {"time": T, "cmd": U, "pos": Q})
    said = "# made by robot::Arm(rate: 50 Hz)\n# and robot::Hand(rate: 50 Hz)\n"
    path.write_text(said + path.read_text(encoding="utf-8"), encoding="utf-8")
    check(read_log(path))


@pytest.mark.parametrize("axis", ["", "X: "])
def test_sercos_parameters_say_what_they_are(tmp_path, axis):
    of = {"S-0-0047, Lage-Sollwert": U, "S-0-0051, Lage-Istwert Geber 1": 1e-3 * TAU + Q}
    of |= {"S-0-0053, Lage-Istwert Geber 2": Q, "S-0-0040, Geschwindigkeits-Istwert": V}
    of |= {"S-0-0084, Drehmoment/Kraft-Istwert": TAU, "P-0-0141, Ausgangsstrom Peak": abs(TAU)}
    columns = {"Zeit": T} | {axis + h.replace(",", ""): y for h, y in of.items()}
    (run,) = read_recordings([table(tmp_path / "scope.csv", columns)])
    (log,) = run.joints.values()
    assert log.link is not None
    taken = {c.role: c.header.removeprefix(axis)[:8] for c in run.taken}
    assert taken["motor"] == "S-0-0051"
    assert taken["position"] == "S-0-0053"
    assert taken["effort"] == "S-0-0084"
    assert taken["velocity"] == "S-0-0040"


def test_a_second_encoder_is_the_joint_s_own(tmp_path):
    columns = {"Sys.Time": T}
    for k, way in ((1, 1.0), (2, -1.0)):
        of = {"DesPos": U, "ActPos": Q + 1e-3 * TAU, "ActPos2": Q, "IqMeas": TAU}
        columns |= {f"Motor[{k}].{name}": way * y for name, y in of.items()}
    (run,) = read_recordings([table(tmp_path / "gather.txt", columns, "\t")])
    assert list(run.joints) == ["1", "2"]
    assert all(log.link is not None for log in run.joints.values())


@pytest.mark.parametrize("name", ["abs_position", "absolute_position", "secondary_position"])
def test_a_second_encoder_may_be_called_so(tmp_path, name):
    columns = {"time": T, "control_position": U, "position": Q + 1e-3 * TAU, "torque": TAU}
    (run,) = read_recordings([table(tmp_path / "drive.csv", columns | {name: Q})])
    (log,) = run.joints.values()
    assert log.link is not None and np.allclose(log.link, Q)


def test_two_joints_of_which_one_is_driven_are_no_two_encoders(tmp_path):
    columns = {"t": T, "cmd": U, "q": Q, "q2": np.cos(3.0 * T), "tau": TAU}
    (run,) = read_recordings([table(tmp_path / "pendulum.csv", columns)])
    assert all(log.link is None for log in run.joints.values())


def test_the_root_of_a_model_and_what_is_requested(tmp_path):
    names = ("Cmd/RWA_AngleReq[rad]", "RWA/PinionAngle[rad]", "RWA/MotorCurrent[A]")
    columns = {f"Model Root/{n}": y for n, y in zip(names, (U, Q, TAU), strict=True)}
    check(read_log(table(tmp_path / "rig.csv", {"time[s]": T, **columns})), effort=True)


def test_an_active_current_is_an_effort_and_a_reactive_one_is_none(tmp_path):
    columns = {"Time [s]": T}
    for k in (1, 2):
        of = {"Position Command [rad]": U, "Position [rad]": Q, "Active Current [A]": TAU}
        of["Reactive Current [A]"] = 0.1 + 0 * T
        columns |= {f"a0{k}.{name}": k * y for name, y in of.items()}
    (run,) = read_recordings([table(tmp_path / "recording.csv", columns)])
    check(run.joints["1"], effort=True)
    assert np.allclose(run.joints["2"].effort, 2 * TAU)


def test_a_folder_of_arrays_has_the_names_of_a_file_beside_them(tmp_path):
    folder = tmp_path / "hand"
    folder.mkdir()
    joints = ("rh_WRJ2", "rh_WRJ1", "rh_FFJ4")
    of = {"joint_position": Q, "joint_position_command": U, "joint_velocity": V}
    of["joint_effort"] = TAU
    for name, y in of.items():
        np.save(folder / f"{name}.npy", np.outer(y, [1.0, 2.0, 3.0]))
    np.save(folder / "timestamp.npy", T)
    told = {"joint_names": joints, "rate_hz": 50}
    (folder / "metadata.json").write_text(json.dumps(told), encoding="utf-8")
    (run,) = read_recordings([folder])
    assert tuple(run.joints) == joints
    check(run.joints["rh_WRJ2"], velocity=True, effort=True)
    assert np.allclose(run.joints["rh_FFJ4"].position, 3 * Q)
