"""Tables with a row for each time and signal, in the forms that databases and programs export."""

from __future__ import annotations

import json
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, check

from pianobot_ros.axis.reading import read_recordings

START = datetime(2024, 1, 1, tzinfo=timezone.utc)
INFLUX = """\
#group,false,false,true,true,false,false,true,true,true
#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string,string
#default,mean,,,,,,,,
,result,table,_start,_stop,_time,_value,_field,_measurement,joint
"""


def when(t, form="%Y-%m-%dT%H:%M:%S.%fZ"):
    return (START + timedelta(seconds=float(t))).strftime(form)


def rows(form, names, values=(U, Q, TAU), by_signal=False, late=0.0):
    """A line of this form for each sample of each signal; `late` are the stamps of the next one."""
    own = [
        [form(t + k * late, name, y) for t, y in zip(T, column, strict=True)]
        for k, (name, column) in enumerate(zip(names, values, strict=True))
    ]
    each = own if by_signal else zip(*own, strict=True)
    return "".join(f"{line}\n" for lines in each for line in lines)


FORMS = {
    "plain": "time,signal,value\n"
    + rows(
        lambda t, n, y: f"{t:.3f},{n},{y:.9f}", ["position_command", "position", "motor_voltage"]
    ),
    "german": "Zeit;Name;Wert\n"
    + rows(
        lambda t, n, y: f"{t:.3f};Achse1:{n};{y:.9f}".replace(".", ","),
        ["SollPosition", "IstPosition", "Drehmoment"],
    ),
    "foxglove": "elapsed time,receive time,header.stamp,topic,value\n"
    + rows(
        lambda t, n, y: f"{t:.9f},{1.7e9 + t + 0.003:.9f},{1.7e9 + t:.9f},{n},{y:.9f}",
        ["/command.position[0]", "/joint_states.position[0]", "/joint_states.effort[0]"],
        by_signal=True,
    ),
    "historian": "[Data]\nTagname,TimeStamp,Value,DataQuality\n"
    + rows(
        lambda t, n, y: f"AXIS1.{n},{when(t, '%Y-%m-%d %H:%M:%S.%f')},{y:.9f},Good",
        ["position_command", "position", "torque"],
    ),
    "wincc": '"VarName";"TimeString";"VarValue";"Validity";"Time_ms"\n'
    + rows(
        lambda t, n, y: (
            f'"Achse1_{n}";"{when(t, "%d.%m.%Y %H:%M:%S")}";'
            + f"{y:.9f};1;{(45292 + t / 86400) * 1e6:.5f}".replace(".", ",")
        ),
        ["Sollposition", "Istposition", "Moment"],
    ),
    "trace with units": "Time,Signal,Value,Unit\n"
    + rows(
        lambda t, n, y: f"{t:.3f},{n},{y:.9f},{'Nm' if 'torque' in n else 'deg'}",
        ["joint1.pos_cmd", "joint1.pos", "joint1.torque"],
        [np.degrees(U), np.degrees(Q), TAU],
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_rows_of_one_signal_each_are_laid_side_by_side(tmp_path, form):
    path = tmp_path / "trace.csv"
    path.write_text(FORMS[form], encoding="utf-8")
    (run,) = read_recordings([path])
    (log,) = run.joints.values()
    check(log, effort=True)
    assert np.allclose(log.effort, TAU, atol=1e-6)
    assert any("3 signals laid side by side" in note for note in run.notes)


def test_tags_of_a_database_tell_the_joint(tmp_path):
    """InfluxDB's annotated CSV: a table after the other, what all rows share says nothing."""
    lines, number = [INFLUX], 0
    for joint, sign in (("shoulder", -1.0), ("elbow", 1.0)):
        for field, column in (("position", sign * Q), ("command", sign * U), ("effort", TAU)):
            for t, y in zip(T, column, strict=True):
                stamps = f"{when(0)},{when(9)},{when(t)}"
                lines.append(f",,{number},{stamps},{y:.9f},{field},joint_states,{joint}\n")
            number += 1
    (tmp_path / "query.csv").write_text("".join(lines))
    (run,) = read_recordings([tmp_path / "query.csv"])
    assert list(run.joints) == ["shoulder", "elbow"]
    check(run.joints["elbow"], effort=True)
    assert np.allclose(run.joints["shoulder"].position, -Q, atol=1e-6)


def test_signals_that_come_one_after_the_other_have_the_position_s_clock(tmp_path):
    """As messages of a bus, whose stamps are never the same."""
    form = rows(
        lambda t, n, y: f"{t:.4f},{n},{y:.9f}",
        ["torque", "position", "command"],
        [TAU, Q, U],
        late=0.004,
    )
    (tmp_path / "bus.csv").write_text("timestamp,name,value\n" + form)
    (run,) = read_recordings([tmp_path / "bus.csv"])
    (log,) = run.joints.values()
    assert log.t.size == T.size and log.start == pytest.approx(0.004)
    assert np.allclose(log.position, Q, atol=1e-6)
    inside = slice(1, -1)  # at the ends there is nothing beside it
    later, earlier = np.interp(T - 0.004, T, U), np.interp(T + 0.004, T, TAU)
    assert np.allclose(log.command[inside], later[inside], atol=1e-6)
    assert np.allclose(log.effort[inside], earlier[inside], atol=1e-6)


def test_objects_of_json_may_be_of_one_signal_each(tmp_path):
    names = ("position_command", "position", "torque")
    each = [
        {"time": float(t), "signal": n, "value": float(y)}
        for t, *values in zip(T, U, Q, TAU, strict=True)
        for n, y in zip(names, values, strict=True)
    ]
    (tmp_path / "long.json").write_text(json.dumps(each))
    (run,) = read_recordings([tmp_path / "long.json"])
    (log,) = run.joints.values()
    check(log, effort=True)


def test_words_beside_a_table_of_signals_tell_nothing(tmp_path):
    """A column called value beside a position is another reading, no long table."""
    lines = ["time,position,command,value,name"]
    lines += [f"{t:.3f},{q:.9f},{u:.9f},1.5,arm" for t, q, u in zip(T, Q, U, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    (run,) = read_recordings([tmp_path / "log.csv"])
    (log,) = run.joints.values()
    check(log)
