"""The guard of the arm: what it rejects, what it clamps, and what it leaves alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from examples import fewer
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.config import config_file
from pianobot_ros.devices.base import CommandRejectedError
from pianobot_ros.devices.wrist.config import UrConfig, WorkspaceConfig
from pianobot_ros.devices.wrist.frames import MountFrames
from pianobot_ros.devices.wrist.limits.limiter import SetpointLimiter
from pianobot_ros.devices.wrist.wrist_reading import WristSetpoint

CONFIG = UrConfig.load()
PERIOD = 0.008
HOME = np.array(CONFIG.mount.home)
BEGIN = 100.0  # s, of both clocks


def limiter() -> SetpointLimiter:
    guard = SetpointLimiter(CONFIG.limits, CONFIG.workspace, PERIOD)
    guard.restart(HOME, np.zeros(3), BEGIN)
    return guard


def setpoint(
    offset: object, rotation: object = (0.0, 0.0, 0.0), stamp: float = 0.0
) -> WristSetpoint:
    return WristSetpoint(
        HOME + np.array(offset, dtype=float), np.array(rotation, dtype=float), np.zeros(6), stamp
    )


def follow(offsets: np.ndarray, arrival_jitter: float = 0.0) -> tuple[np.ndarray, int]:
    """Positions sent for a stream at the controller's rate, and how many of them were clamped."""
    guard, random = limiter(), np.random.default_rng(1)
    sent, clamped = [HOME], 0
    for cycle, offset in enumerate(offsets):
        stamp = BEGIN + (cycle + 1) * PERIOD
        limited = guard.limit(
            setpoint(offset, stamp=stamp), stamp + random.uniform(0.0, arrival_jitter)
        )
        clamped += bool(limited.clamped)
        sent.append(limited.setpoint.position)
    return np.array(sent), clamped


def test_a_strike_within_the_limits_passes_unchanged_however_it_arrives() -> None:
    time = np.arange(1, 150) * PERIOD
    offsets = np.outer(-0.015 * (1.0 - np.cos(2 * np.pi * 4.0 * time)), [0.0, 0.0, 1.0])
    sent, clamped = follow(offsets, arrival_jitter=0.006)
    assert clamped == 0
    assert sent[1:] == pytest.approx(HOME + offsets)


@fewer(0.3)
@given(
    st.tuples(st.floats(-0.15, 0.15), st.floats(-0.08, 0.15), st.floats(-0.1, 0.12)),
    st.floats(0.0, 0.006),
)
def test_a_jump_is_followed_within_the_limits_and_reached_without_overshoot(
    jump: tuple[float, float, float], jitter: float
) -> None:
    sent, _ = follow(np.tile(jump, (150, 1)), jitter)
    velocity = np.diff(sent, axis=0) / PERIOD
    assert np.max(np.linalg.norm(velocity, axis=1)) <= CONFIG.limits.speed * 1.03
    acceleration = np.diff(np.vstack([np.zeros(3), velocity]), axis=0) / PERIOD
    assert np.max(np.linalg.norm(acceleration, axis=1)) <= CONFIG.limits.acceleration * 1.05
    assert sent[-1] == pytest.approx(HOME + np.array(jump), abs=1e-9)
    along = (sent - HOME) @ np.array(jump)
    assert np.max(along) <= float(np.dot(jump, jump)) + 1e-9


BOX = list(zip(CONFIG.workspace.low, CONFIG.workspace.high, strict=True))
PLACES = st.tuples(*(st.floats(low, high) for low, high in BOX))
TILTS = st.tuples(*(st.floats(-0.57, 0.57) for _ in range(3))).map(
    lambda r: np.array(r) * CONFIG.limits.tilt
)
TWISTS = st.lists(st.sampled_from([0.0, 0.3, -0.3, 0.9, -0.9, 5.0, -5.0, 1e300]), min_size=6)
STREAMS = st.lists(
    st.tuples(PLACES, TILTS, TWISTS.map(lambda x: x[:6]), st.booleans()), min_size=1, max_size=3
)


@fewer(0.4)
@given(STREAMS, st.sampled_from([0.0003, 0.002, PERIOD]))
def test_whatever_streams_fight_the_arm_stays_in_the_workspace(
    streams: list[tuple[object, np.ndarray, list[float], bool]], apart: float
) -> None:
    """Each is a pose in the workspace; together, or by the velocity that they give, they say that
    they move fast.
    """
    guard, limits = limiter(), CONFIG.limits
    low, high = np.array(BOX).T
    last = HOME
    for cycle in range(120):
        for k, (place, tilt, twist, stamped) in enumerate(streams):
            now = BEGIN + cycle * PERIOD + k * apart
            asked = WristSetpoint(np.array(place), tilt, np.array(twist), now if stamped else 0.0)
            passed = guard.limit(asked, now).setpoint
            assert np.all(passed.position >= low - 1e-12)
            assert np.all(passed.position <= high + 1e-12)
            assert np.linalg.norm(passed.rotation) <= limits.tilt + 1e-9
            assert np.linalg.norm(passed.velocity[:3]) <= 1.03 * limits.speed
        moved = np.linalg.norm(passed.position - last)
        assert moved <= 1.03 * limits.speed * (len(streams) * PERIOD + 0.05)
        last = passed.position


def test_a_pose_that_does_not_move_is_reached_whatever_velocity_it_gives() -> None:
    guard = limiter()
    pose = HOME + np.array([0.0, 0.0, -0.05])
    for cycle in range(250):
        asked = WristSetpoint(pose, np.zeros(3), np.array([0.0, 0.0, -0.8, 0.0, 0.0, 0.0]), 0.0)
        passed = guard.limit(asked, BEGIN + cycle * PERIOD).setpoint
    assert passed.position == pytest.approx(pose)


def test_stamps_that_run_fast_do_not_buy_speed() -> None:
    guard, position = limiter(), HOME
    for cycle in range(1, 100):  # stamps claim 40 ms a step, the clock says 8 ms
        asked = setpoint([0.02 * cycle % 0.1, 0.0, 0.0], stamp=BEGIN + 0.04 * cycle)
        position = guard.limit(asked, BEGIN + PERIOD * cycle).setpoint.position
    elapsed = 99 * PERIOD
    assert position[0] - HOME[0] <= CONFIG.limits.speed * (elapsed + PERIOD)


def test_rotation_is_clamped_too() -> None:
    guard = limiter()
    limited = guard.limit(
        setpoint([0.0, 0.0, 0.0], [0.0, 0.5, 0.0], BEGIN + PERIOD), BEGIN + PERIOD
    )
    assert "angular" in limited.clamped
    assert 0.0 < limited.setpoint.rotation[1] <= CONFIG.limits.angular_speed * PERIOD * 1.03


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (setpoint([np.nan, 0.0, 0.0]), "not finite"),
        (setpoint([0.0, 0.0, 0.0], [np.inf, 0.0, 0.0]), "not finite"),
        (WristSetpoint(HOME, np.zeros(3), np.full(6, np.nan)), "not finite"),
        (setpoint([0.0, 0.0, 1.0]), r"outside the workspace: z = 1\.2400 m"),
        (setpoint([0.0, -0.2, 0.0]), "outside the workspace: y"),
        (setpoint([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]), "tilted by 1.00 rad"),
        (WristSetpoint(HOME[:2], np.zeros(3), np.zeros(6)), "shapes"),
    ],
)
def test_what_must_not_be_followed_is_rejected_with_one_clear_line(
    bad: WristSetpoint, why: str
) -> None:
    with pytest.raises(CommandRejectedError, match=why) as caught:
        limiter().limit(bad, BEGIN + PERIOD)
    assert "\n" not in str(caught.value)


def test_a_rejected_setpoint_leaves_the_stream_as_it_was() -> None:
    guard = limiter()
    guard.limit(setpoint([0.001, 0.0, 0.0], stamp=BEGIN + PERIOD), BEGIN + PERIOD)
    with pytest.raises(CommandRejectedError):
        guard.limit(setpoint([np.nan, 0.0, 0.0], stamp=BEGIN + 2 * PERIOD), BEGIN + 2 * PERIOD)
    limited = guard.limit(setpoint([0.002, 0.0, 0.0], stamp=BEGIN + 3 * PERIOD), BEGIN + 3 * PERIOD)
    assert not limited.clamped
    assert limited.setpoint.position == pytest.approx(HOME + np.array([0.002, 0.0, 0.0]))


def test_mount_turns_the_wrist_into_the_tool_and_back() -> None:
    frames = MountFrames(CONFIG.mount)
    tool = frames.tool(HOME, np.zeros(3))
    assert tool[:3] == pytest.approx(HOME)
    assert np.abs(tool[3:]) == pytest.approx(np.abs(CONFIG.mount.rotation))
    for rotation in ([0.1, -0.2, 0.3], [0.0, 0.0, 0.0], [-0.4, 0.0, 0.1]):
        position, back = frames.wrist(frames.tool(HOME, np.array(rotation)))
        assert position == pytest.approx(HOME)
        assert back == pytest.approx(rotation, abs=1e-9)


def test_a_workspace_turned_inside_out_is_refused() -> None:
    with pytest.raises(ValueError, match="below high"):
        WorkspaceConfig(low=(0.0, 0.0, 0.3), high=(0.1, 0.1, 0.2))


def test_a_misspelt_name_in_the_file_is_named(tmp_path: Path) -> None:
    text = config_file("wrist.yaml").read_text().replace("lookahead:", "lookahed:")
    path = tmp_path / "wrist.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="lookahed"):
        UrConfig.load(path)
