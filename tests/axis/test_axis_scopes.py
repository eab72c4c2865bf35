"""Exports of scopes: rows of properties above channels, whose names may say nothing. Headers are of
files that owners of such scopes published.
"""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, check

from pianobot_ros.axis.reading import read_log, read_recordings

TEKTRONIX = """\
Model,MSO58
Firmware Version,2.0.3

Waveform Type,ANALOG,ANALOG,ANALOG
Point Format,Y,Y,Y
Horizontal Units,s,s,s
Sample Interval,2e-02,2e-02,2e-02
Record Length,300,300,300
Vertical Units,V,V,A
Label,pos_cmd,pos,current
,,,
Time,CH1,CH2,CH3,
"""
RIGOL = """\
X,CH1,CH2,CH3,Start,Increment,
Sequence,Volt,Volt,Volt,-1.200000e-03,2.000000e-02
"""
KEYSIGHT = "x-axis,1,2,3\nsecond,Volt,Volt,Ampere\n"
SIGLENT = """\
Record Length,Analog:300
Sample Interval,Analog:0.02
Vertical Units,CH1:V,CH2:V,CH3:A
Model Number,SDS1104X-E
Source,CH1,CH2,CH3
Second,Volt,Volt,Ampere
"""
SIGNALS = np.column_stack([U, Q, TAU])


def written(path, header, first):
    rows = (
        f"{a:.9g},{u:.9f},{q:.9f},{i:.9f}," for a, (u, q, i) in zip(first, SIGNALS, strict=True)
    )
    path.write_text(header + "\n".join(rows) + "\n")
    return path


def test_labels_of_a_scope_are_the_names_and_vertical_units_the_units(tmp_path):
    """Tektronix: the row below has the channels' numbers, and every row of numbers a comma more."""
    log = read_log(written(tmp_path / "tek.csv", TEKTRONIX, T))
    check(log, effort=True)
    assert log.effort_unit == "A"


@pytest.mark.parametrize("header", [KEYSIGHT, SIGLENT, "TIME,CH1,CH2,CH3\n", RIGOL])
def test_channels_by_number_are_told_by_their_numbers(tmp_path, header):
    """They had been a joint's position each. Rigol counts rows, and says the time between two."""
    first = np.arange(T.size) if header == RIGOL else T
    (run,) = read_recordings([written(tmp_path / "scope.csv", header, first)])
    (log,) = run.joints.values()
    check(log, effort=True)


@pytest.mark.parametrize("mark", [".", ","])
def test_a_clock_s_unit_may_have_another_decimal_mark(tmp_path, mark):
    """TwinCAT's scope writes its periods with a comma, also above numbers with points; a time of
    0.2 ms a row was taken as seconds.
    """
    rows = [
        "Name\taxis",
        "",
        "Name\tActPos\tSetPos\tName\tActTorque",
        "SampleTime[ms]\t0,2\t0,2\tSampleTime[ms]\t0,4",
        "Unit\tmm (Length)\tmm (Length)\tUnit\t(None)",
        "ScaleFactor\t1\t1\tScaleFactor\t1",
        "",
    ]
    for k, (q, u) in enumerate(zip(Q, U, strict=True)):
        slow = f"\t{0.4 * k:.1f}\t{TAU[2 * k]:.9f}" if 2 * k < T.size else "\t\t"
        rows.append(f"{0.2 * k:.1f}\t{1e3 * q:.7f}\t{1e3 * u:.7f}{slow}".replace(".", mark))
    (tmp_path / "scope.csv").write_text("\n".join(rows))
    log = read_log(tmp_path / "scope.csv")
    assert log.unit == "m" and np.allclose(log.position, Q, atol=1e-6)
    assert np.allclose(np.diff(log.t), 2e-4, rtol=1e-3)
    assert log.effort is not None and np.allclose(log.effort[::2], TAU[::2], atol=1e-6)
