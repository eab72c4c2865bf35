"""The decoders on messages of the right shape, hostile ones, and those of rosbags."""

from __future__ import annotations

import math
from types import SimpleNamespace as Fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.errors import CommandRejectedError
from pianobot_ros.cell.host.wall_clock import AHEAD
from pianobot_ros.cell.messages.command_checks import LATE, vacuum_setpoint, wrist_setpoint
from pianobot_ros.cell.messages.events import note_event, strike
from pianobot_ros.cell.messages.poses import rotation_vectors
from pianobot_ros.cell.messages.refusals import (
    COMMAND_KEY,
    LASTING,
    LASTING_KEY,
    Refusal,
    one_sided,
    refusals,
)

ANY = st.floats(allow_nan=True, allow_infinity=True)


def xyz(*values: float) -> Fields:
    return Fields(**dict(zip("xyzw", values, strict=False)))


def header(seconds: float = 0.0, frame: str = "") -> Fields:
    whole = math.floor(seconds)
    stamp = Fields(sec=whole, nanosec=round(1e9 * (seconds - whole)))
    return Fields(stamp=stamp, frame_id=frame)


def wrist(
    position: Any = (0.0, 0.3, 0.2), quaternion: Any = (0.0, 0.0, 0.0, 1.0), frame: str = "base"
) -> Fields:
    return Fields(
        header=header(12.5, frame),
        pose=Fields(position=xyz(*position), orientation=xyz(*quaternion)),
        twist=Fields(linear=xyz(0.1, 0.2, 0.3), angular=xyz(0.4, 0.5, 0.6)),
    )


def test_a_wrist_command_becomes_a_setpoint() -> None:
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3])
    found = wrist_setpoint(wrist(quaternion=turn.as_quat().tolist()))
    assert found.position.tolist() == [0.0, 0.3, 0.2] and found.stamp == 12.5
    assert found.rotation == pytest.approx(turn.as_rotvec())
    assert found.velocity.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (wrist(frame="tool0"), "tool0"),
        (wrist(position=(math.nan, 0.0, 0.0)), "finite"),
        (wrist(quaternion=(0.0, 0.0, 0.0, 0.0)), "length 0"),
        (wrist(quaternion=(0.0, 0.0, 0.0, 1.1)), "length 1.1"),
        (wrist(quaternion=(0.0, 0.0, math.inf, 0.0)), "finite"),
    ],
)
def test_what_is_no_setpoint_is_refused(message: Fields, says: str) -> None:
    with pytest.raises(CommandRejectedError, match=says):
        wrist_setpoint(message)


def test_an_old_setpoint_is_refused_where_the_time_is_given() -> None:
    assert wrist_setpoint(wrist(), now=12.5 + LATE).stamp == 12.5
    assert wrist_setpoint(wrist(), now=12.5 - AHEAD).stamp == 12.5
    with pytest.raises(CommandRejectedError, match="old"):
        wrist_setpoint(wrist(), now=12.6 + LATE)


@given(st.floats(-100.0, 100.0), st.sampled_from(["", "base", "tool0"]))
def test_stamp_and_frame_are_judged_alike_in_every_command(age: float, frame: str) -> None:
    """But for how old each may be; without a stamp it is obeyed at once."""
    now = 1000.0

    def obeyed(kind: str, stamp: float) -> bool:
        try:
            if kind == "wrist":
                message = wrist(frame=frame)
                message.header = header(stamp, frame)
                wrist_setpoint(message, now=now)
            else:
                message = vacuum(["index"], [-5.0])
                message.header = header(stamp, frame)
                vacuum_setpoint(message, ["index"], now, LATE if kind == "vacuum" else 0.0)
        except CommandRejectedError:
            return False
        return True

    mine = frame != "tool0"
    assert obeyed("wrist", 0.0) == obeyed("vacuum", 0.0) == mine
    if min(abs(age - LATE), abs(age + AHEAD)) > 1e-6:
        assert obeyed("wrist", now - age) == (mine and -AHEAD <= age <= LATE)
        assert obeyed("vacuum", now - age) == obeyed("wrist", now - age)
        assert obeyed("of any age", now - age) == (mine and age >= -AHEAD)
    assert not obeyed("vacuum", -1.0)


@given(st.tuples(*[ANY] * 3), st.tuples(*[ANY] * 4))
def test_a_setpoint_is_finite_or_refused(position: Any, quaternion: Any) -> None:
    try:
        found = wrist_setpoint(wrist(position, quaternion))
    except CommandRejectedError:
        return
    assert np.isfinite(found.position).all() and np.linalg.norm(found.rotation) <= math.pi + 1e-9


def test_measured_quaternions_agree_with_scipy_and_the_others_are_dropped() -> None:
    turns = Rotation.random(30, random_state=1)
    vectors = rotation_vectors(turns.as_quat())
    assert vectors == pytest.approx(turns.as_rotvec(), abs=1e-12)
    bad = [[0, 0, 0, 0], [0, 0, 0, math.nan], [1e300, 1e300, 0, 0], [0, 0, 0, 0.5]]
    assert np.isnan(rotation_vectors(np.array(bad, dtype=float))).all()
    assert rotation_vectors(np.empty((0, 4))).shape == (0, 3)


def vacuum(fingers: Any, pressure: Any, seconds: float = 0.0) -> Fields:
    return Fields(header=header(seconds), fingers=fingers, pressure=pressure)


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (vacuum(["thumb"], []), "1 fingers but 0"),
        (vacuum([], []), "0 fingers"),
        (vacuum(["pinky"], [-1.0]), "unknown finger"),
        (vacuum(["thumb", "thumb"], [-1.0, -2.0]), "twice"),
        (vacuum(["thumb"], [math.nan]), "finite"),
        (vacuum(["thumb"], [-1.0], seconds=90.0), "10.00 s old"),
    ],
)
def test_what_is_no_vacuum_is_refused(message: Fields, says: str) -> None:
    with pytest.raises(CommandRejectedError, match=says):
        vacuum_setpoint(message, ["thumb", "index"], now=100.0)


def test_a_vacuum_command_names_what_it_changes() -> None:
    assert vacuum_setpoint(vacuum(["index"], [-5.0], 99.9), ["thumb", "index"], 100.0) == {
        "index": -5.0
    }
    assert vacuum_setpoint(vacuum(["index"], [-5.0], 1.0), ["index"], 100.0, stale=0.0)


def test_notes_and_strikes() -> None:
    def midi(status: int, velocity: int, note: int = 60) -> Fields:
        return Fields(status=status, note=note, velocity=velocity)

    on, silent, off = (note_event(midi(*m), 1.0) for m in ((0x93, 64), (0x90, 0), (0x80, 3)))
    assert on is not None and on.on and silent is not None and not silent.on
    assert off is not None and not off.on
    assert note_event(midi(0xF8, 0), 1.0) is None and note_event(midi(0x90, 1, 200), 1.0) is None
    names = "index phrase condition finger note speed depth hold pressure note_length"
    mark = Fields(**dict.fromkeys(names.split(), 1), end=Fields(sec=12, nanosec=0))
    found = strike(mark, start=1.5, epoch=10.0)
    assert found is not None and (found.start, found.end) == (1.5, 2.0)
    assert strike(mark, start=2.5, epoch=10.0) is None
    mark.speed = math.nan
    assert strike(mark, start=1.5, epoch=10.0) is None


def refusal(time: float, command: int = 0, topic: str = "/command/wrist") -> Refusal:
    return Refusal(time, topic, command, "why")


@pytest.mark.parametrize(
    ("real", "sim", "alone"),
    [
        ([], [], None),
        ([refusal(10.0, 5)], [refusal(10.1, 5)], None),
        ([refusal(10.0, 5)], [refusal(10.1, 6)], "real"),
        ([], [refusal(10.1, 6)], "sim"),
        ([refusal(10.0)], [refusal(10.1)], None),
        ([refusal(10.0), refusal(10.1)], [refusal(10.1)], "real"),
        ([refusal(10.0, 5)], [refusal(10.0, 5, "/command/vacuum")], "real"),
        ([refusal(9.9 - LASTING)], [], None),
        ([refusal(11.1)], [], None),
        ([Refusal(9.5, "/command/wrist", 5, "40 ms late", 0.4)], [], None),
        ([Refusal(9.5, "/command/wrist", 5, "200 ms late", 0.6)], [], "real"),
    ],
)
def test_cells_are_apart_after_what_one_of_them_refused(
    real: list[Refusal], sim: list[Refusal], alone: str | None
) -> None:
    found = one_sided(real, sim, 10.0, 11.0)
    assert (found[0] if found else None) == alone


def test_word_of_a_refusal_is_read_and_what_is_none_is_left_out() -> None:
    def status(name: str, *values: str, lasting: str = "") -> Fields:
        pairs = [Fields(key=COMMAND_KEY, value=v) for v in values]
        pairs += [Fields(key=LASTING_KEY, value=lasting)] if lasting else []
        return Fields(name=name, message="too low", values=pairs)

    array = Fields(
        header=header(3.0),
        status=[
            status("ur5_wrist: /command/wrist", "1234"),
            status("ur5_wrist", "1234"),
            status("ur5_wrist: /command/wrist"),
            status("ur5_wrist: /command/wrist", "-1"),
            status("ur5_wrist: /command/wrist", "9" * 400),
            status("ur5_wrist: /command/wrist", "2500000000", lasting="0.25"),
            *(
                status("ur5_wrist: /command/wrist", "6", lasting=wrong)
                for wrong in ("nan", "-1", "inf", "long")
            ),
        ],
    )
    assert refusals(array) == [
        Refusal(3.0, "/command/wrist", 1234, "too low"),
        Refusal(2.5, "/command/wrist", 2_500_000_000, "too low", 0.25),
        *[Refusal(3.0, "/command/wrist", 6, "too low", LASTING)] * 4,
    ]
