"""Times as programs write them: names of months and zones, dates without anything between, spans,
fractions behind a colon, two columns of one time.
"""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
import pytest
from laboratory import Q, T, U, check, table

from pianobot_ros.axis.reading import read_log
from pianobot_ros.axis.reading.formats.lines.values import number, stamp
from pianobot_ros.gap import GapError

START = datetime(2024, 3, 5, 10, 0, 57)  # a minute ends within the log


def milliseconds(form):
    return lambda when: when.strftime(form)[:-3]


FORMS = {
    "zone": lambda when: milliseconds("%Y-%m-%d %H:%M:%S.%f")(when) + " UTC",
    "place": lambda when: milliseconds("%Y-%m-%d %H:%M:%S.%f")(when) + " Europe/Berlin",
    "brackets": milliseconds("[%Y-%m-%d %H:%M:%S.%f"),
    "month": milliseconds("%d-%b-%Y %H:%M:%S.%f"),
    "month first": milliseconds("%b %d, %Y %H:%M:%S.%f"),
    "digits": milliseconds("%Y%m%d%H%M%S%f"),
    "digits with lines": milliseconds("%Y%m%d_%H%M%S_%f"),
    "digits and point": milliseconds("%Y%m%d%H%M%S.%f"),
    "lines": milliseconds("%Y-%m-%d-%H-%M-%S.%f"),
    "colon": milliseconds("%H:%M:%S:%f"),
    "date and colon": milliseconds("%d.%m.%Y %H:%M:%S:%f"),
    "plc": milliseconds("DT#%Y-%m-%d-%H:%M:%S.%f"),
    "span": lambda when: f"T#{(when - START).seconds}s{when.microsecond // 1000}ms",
    "iso span": lambda when: f"PT{(when - START).total_seconds():.3f}S",
}


@pytest.mark.parametrize("form", FORMS)
def test_times_as_programs_write_them(tmp_path, form):
    ends = "]" if form == "brackets" else ""
    whens = [START + timedelta(milliseconds=round(1e3 * t)) for t in T]
    if form == "span":
        whens = [w + timedelta(0) for w in whens]
    stamps = [FORMS[form](w) + ends for w in whens]
    log = read_log(table(tmp_path / "a.csv", {"Time": stamps, "q": Q, "q_cmd": U}, delimiter=";"))
    check(log)
    assert np.allclose(log.t, T, atol=1e-4)


def test_spans_and_dates_of_a_calendar():
    assert stamp("PT1H2M3.5S") == stamp("T#1h2m3s500ms") == stamp("01:02:03:500") == 3723.5
    assert (
        stamp("20240305_100057") == stamp("05-Mar-2024 10:00:57") == stamp("5. Mär 2024 10:00:57")
    )
    assert (
        stamp("20241305100057") is stamp("99-Foo-2024 10:00") is stamp("P") is stamp("T#") is None
    )
    assert number("1_000") is None


def test_a_semicolon_in_a_time_separates_nothing(tmp_path):
    whens = [START + timedelta(milliseconds=round(1e3 * t)) for t in T]
    columns = {
        "Date": ["03/05/2024"] * T.size,
        "Time": [f"{w:%H:%M:%S};{w:%f}"[:-3] for w in whens],
    }
    check(read_log(table(tmp_path / "a.csv", columns | {"q": Q, "q_cmd": U})))


@pytest.mark.parametrize(
    ("names", "per"),
    [(("tv_sec", "tv_usec"), 1e6), (("sec", "msec"), 1e3), (("second", "microsecond"), 1e6)],
)
def test_whole_seconds_and_their_rest(tmp_path, names, per):
    """A hole in the rows is one in time: stamps are not spread evenly."""
    whole, kept = np.floor(T + 1e-9), np.r_[0:60, 90 : T.size]
    rest = np.round((T - whole) * per).astype(int)
    columns = {names[0]: whole + 7, names[1]: rest, "q": Q, "q_cmd": U}
    log = read_log(table(tmp_path / "a.csv", {k: y[kept] for k, y in columns.items()}))
    assert np.allclose(log.t, T[kept], atol=1e-6)


def test_how_long_a_cycle_took_is_no_rest_of_a_second(tmp_path):
    took = 8 + (np.arange(T.size) * 7 % 5) / 10
    columns = {"time [s]": np.floor(10 * T), "cycle time [ms]": took, "q": Q, "q_cmd": U}
    log = read_log(table(tmp_path / "a.csv", columns))
    assert np.all(np.diff(log.t) > 0) and not np.allclose(log.t, T)


def test_a_clock_that_stands_is_named(tmp_path):
    path = table(tmp_path / "a.csv", {"time": 0 * T + 5.0, "q": Q, "q_cmd": U})
    with pytest.raises(GapError, match="time never changes; say --columns time=HEADER, or --rate"):
        read_log(path)
