"""Recordings on a grid: what was asked of the devices, and when."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.piano.twin.reduced.splicing import STEP, open_session

TIME = np.arange(0.0, 1.0, 0.01)  # s, the regulators' reports


def recording(
    commands: dict[float, float], reported_from: float, *, reports: bool = True
) -> Recording:
    """A setpoint of -50 kPa that the regulators report from a time on; `commands`: Pa by time."""
    still = np.zeros((TIME.size, 3))
    signals = {"command/wrist.position": TimeSeries(TIME, still, "m")}
    if commands:
        values = np.repeat(np.array(list(commands.values()))[:, None], 3, axis=1)
        signals["command/vacuum.pressure"] = TimeSeries(np.array(list(commands)), values, "Pa")
    if reports:
        steps = np.where(TIME[:, None] >= reported_from - 1e-9, -50e3, 0.0) * np.ones(3)
        signals["real/vacuum/state.setpoint"] = TimeSeries(TIME, steps, "Pa")
    return Recording(signals)


def first_below(found: Recording) -> float:
    session = open_session(found)
    assert session.setpoint is not None
    return float(session.time[np.argmax(session.setpoint[:, 0] < -25e3)])


@pytest.mark.parametrize("commanded", [0.4915, 0.495, 0.4985])
def test_a_setpoint_holds_from_its_command_on(commanded: float) -> None:
    assert first_below(recording({0.0: 0.0, commanded: -50e3}, 0.5)) == pytest.approx(
        commanded, abs=STEP
    )


@pytest.mark.parametrize("commanded", [0.47, 0.4999])
def test_reports_are_never_contradicted(commanded: float) -> None:
    found = recording({0.0: 0.0, commanded: -50e3}, 0.5)
    session, reported = open_session(found), found.signals["real/vacuum/state.setpoint"]
    assert session.setpoint is not None
    seen = np.interp(reported.time, session.time, session.setpoint[:, 0])
    assert seen == pytest.approx(reported.value[:, 0])


def test_without_commands_the_report_tells_and_without_reports_the_command() -> None:
    assert first_below(recording({}, 0.5)) == pytest.approx(0.5 - STEP)
    assert first_below(recording({0.0: 0.0, 0.4915: -50e3}, 0.5, reports=False)) == pytest.approx(
        0.4915, abs=STEP
    )


def test_a_command_that_the_regulators_did_not_take_dates_nothing() -> None:
    assert first_below(recording({0.0: 0.0, 0.4915: -80e3}, 0.5)) == pytest.approx(0.5 - STEP)
