"""Units as headers and files state them: parts and multiples of a unit, moments of other countries,
attributes of a data set.
"""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest
from cascade import drive
from laboratory import TAU, Q, T, U, V, check, table

from pianobot_ros.axis.diagnosis.joint import prepared
from pianobot_ros.axis.reading import Request, read_log
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.unit_words import unit_of
from pianobot_ros.gap import GapError

ANGLES = {
    "mrad": 1e3,
    "urad": 1e6,
    "mdeg": 1e3 * 180 / np.pi,
    "0.1deg": 10 * 180 / np.pi,
    "0.01 deg": 100 * 180 / np.pi,
    "10^-4 °": 1e4 * 180 / np.pi,
    "arcsec": 3600 * 180 / np.pi,
    "gon": 200 / np.pi,
}
LENGTHS = {"in": 1 / 0.0254, "nm": 1e9, "0.1 µm": 1e7}
MOMENTS = {
    "mN·m": 1e3,
    "Ncm": 1e2,
    "cNm": 1e2,
    "N.mm": 1e3,
    "kNm": 1e-3,
    "kgf.cm": 1 / 0.0980665,
    "oz-in": 1 / 0.00706155,
    "0.01 Nm": 1e2,
}


@pytest.mark.parametrize("unit", ANGLES)
def test_parts_and_multiples_of_an_angle(tmp_path, unit):
    k = ANGLES[unit]
    columns = {"t [s]": T, f"actual pos [{unit}]": k * Q, f"target pos [{unit}]": k * U}
    check(read_log(table(tmp_path / "a.csv", columns)))


@pytest.mark.parametrize("unit", ["mrad", "mdeg", "arcsec"])
def test_parts_of_an_angle_behind_a_name(tmp_path, unit):
    k = ANGLES[unit]
    columns = {"t": T, f"pos_{unit}": k * Q, f"cmd_{unit}": k * U}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log)
    assert log.joint == ""


@pytest.mark.parametrize("unit", LENGTHS)
def test_lengths(tmp_path, unit):
    k = LENGTHS[unit]
    columns = {"t": T, f"position [{unit}]": k * Q, f"target position [{unit}]": k * U}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log)
    assert log.unit == "m"


@pytest.mark.parametrize("unit", MOMENTS)
def test_moments(tmp_path, unit):
    columns = {"t": T, "q [rad]": Q, "q_cmd [rad]": U, f"torque [{unit}]": MOMENTS[unit] * TAU}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log, effort=True)
    assert log.effort_unit == "Nm"
    assert np.allclose(log.effort, TAU, atol=1e-5)


@pytest.mark.parametrize(("unit", "factor"), [("0.1rpm", 10), ("r/min", 1), ("10 rpm", 0.1)])
def test_a_speed_in_parts_of_a_unit_tells_the_turns(tmp_path, unit, factor):
    speed = factor * V * 60 / (2 * np.pi)
    columns = {"t": T, "actual pos": 7 * Q, "target pos": 7 * U, f"speed [{unit}]": speed}
    check(read_log(table(tmp_path / "a.csv", columns)), velocity=True, tolerance=0.01)


@pytest.mark.parametrize(("unit", "per"), [("min", 1 / 60), ("0.1ms", 1e4), ("100 ns", 1e7)])
def test_a_clock_in_other_units(tmp_path, unit, per):
    columns = {f"Time [{unit}]": T * per, "q [rad]": Q, "q_cmd [rad]": U}
    check(read_log(table(tmp_path / "a.csv", columns)))


def test_what_is_said_may_be_a_part_of_a_unit(tmp_path):
    path = table(tmp_path / "a.csv", {"t": T, "q": 1e3 * Q, "q_cmd": 1e3 * U, "tau": 1e2 * TAU})
    (log,) = (read_log(path, units={"position": "mrad", "effort": "Ncm"}),)
    check(log, effort=True)
    assert np.allclose(log.effort, TAU, atol=1e-5)
    with pytest.raises(GapError, match="unknown unit of position 'mNm'"):
        Request(units={"position": "mNm"})


def test_a_hole_in_a_record_does_not_change_the_unit_of_its_speeds(tmp_path):
    """Its velocities at either end, held over the hole, outweighed all that were measured."""
    kept = np.r_[0:50, 100:125, 175:199, 249 : T.size]  # without where it is fast
    columns = {"t [s]": T, "actual_q": Q, "target_q": U, "actual_qd": V}
    log = read_log(table(tmp_path / "a.csv", {k: y[kept] for k, y in columns.items()}))
    assert np.allclose(log.velocity, V[kept])
    assert not any("velocity multiplied" in n for n in log.notes)


def test_a_length_is_no_unit_of_a_current():
    assert meaning("Motor Current (in)").unit in {"", "A"}
    assert unit_of("0 deg") == unit_of("deg 0.1") == unit_of("of") == ""


def test_attributes_of_a_data_set_state_its_unit(tmp_path):
    signals = {"t": (1e3 * T, "ms"), "q": (np.degrees(Q), "deg"), "q_cmd": (np.degrees(U), "deg")}
    signals["torque"] = (1e3 * TAU, b"mNm")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, (y, unit) in signals.items():
            file[name] = y
            file[name].attrs["Units" if name == "q" else "unit"] = unit
    log = read_log(tmp_path / "a.h5")
    check(log, effort=True)
    assert np.allclose(log.effort, TAU)
    assert not any("taken as" in note for note in log.notes)


def test_a_linear_joint_is_compared_in_its_own_unit():
    """The engine says where a signal's unit is not the twin's: of a lift nothing is to be said."""
    turning = drive(1, seconds=8.0)
    slope = np.gradient(turning.position, turning.t)
    log = replace(turning, velocity=slope, unit="m")
    twin, blocks, _ = prepared([log], None, None)
    units = {o.signal: o.unit for o in twin.observables}
    assert {"position", "velocity", "effort"} <= set(units)
    assert all(b.outputs[n].unit == units[n] for b in blocks for n in units)


@pytest.mark.parametrize("name", ["ankle_angle", "winkel"])
def test_what_is_called_an_angle_is_no_length_whatever_pulls_at_it(tmp_path, name):
    degrees = {"time": T, name: np.degrees(Q), "cable force [N]": TAU}
    log = read_log(table(tmp_path / "log.csv", degrees))
    assert log.unit == "rad" and log.effort_unit == "N"
    assert np.allclose(log.position, Q, atol=1e-5)
    slides = {"time": T, "position": 1e3 * Q, "cable force [N]": TAU}
    assert read_log(table(tmp_path / "slide.csv", slides)).unit == "m"
