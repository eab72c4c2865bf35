"""Whose fault an ended program is, and when a restarted one counts as recovered."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.devices.wrist.rtde.recovery import Recovery, RecoveryOutcome
from pianobot_ros.devices.wrist.rtde.watchdog import WatchdogFeed

TIMEOUT = 0.2
PLAYING = {"playing": True, "stopped": False}
STOPPED = {"playing": False, "stopped": True}
PAUSED = {"playing": False, "stopped": False}


def running(until: float = 1.0) -> WatchdogFeed:
    """A program that was fed every 40 ms up to ``until``."""
    feed = WatchdogFeed(TIMEOUT)
    feed.started(0.0)
    for k in range(1, round(until / 0.04) + 1):
        feed.feed(0.04 * k)
        assert not feed.starved(0.04 * k, **PLAYING)
    return feed


def test_a_stall_whose_first_state_is_stopped_is_our_own() -> None:
    assert running().starved(1.6, **STOPPED)


def test_a_command_that_came_too_late_is_our_own_too() -> None:
    feed = running()
    feed.feed(1.3)
    assert feed.starved(1.31, **STOPPED)


def test_a_program_that_ended_although_it_was_fed_is_not() -> None:
    assert not running().starved(1.02, **STOPPED)


def test_an_end_is_told_once() -> None:
    feed = running()
    assert feed.starved(1.6, **STOPPED)
    assert not feed.starved(1.61, **STOPPED)


def test_a_program_that_ends_before_its_first_state_is_our_own() -> None:
    feed = WatchdogFeed(TIMEOUT)
    feed.started(5.0)
    assert feed.starved(5.3, **STOPPED)


def test_nobody_feeds_a_paused_program_and_nobody_restarts_it() -> None:
    feed = running()
    assert not feed.starved(1.02, **PAUSED)
    assert not feed.starved(9.0, **STOPPED)


def test_a_paused_program_that_goes_on_is_watched_again() -> None:
    feed = running()
    assert not feed.starved(1.02, **PAUSED)
    assert not feed.starved(9.0, **PLAYING)
    feed.feed(9.04)
    assert not feed.starved(9.05, **STOPPED), "it was fed since it went on"


@given(gaps=st.lists(st.floats(0.001, 0.15), min_size=1, max_size=50), after=st.floats(0.0, 0.15))
def test_who_feeds_in_time_is_never_blamed(gaps: list[float], after: float) -> None:
    feed, now = WatchdogFeed(TIMEOUT), 0.0
    feed.started(now)
    for gap in gaps:
        now += gap
        feed.feed(now)
    assert not feed.starved(now + after, **STOPPED)


class Arm:
    """Starts a program that ends by itself ``trips`` times, after ``lasts`` s."""

    def __init__(self, trips: int, lasts: float = 0.6) -> None:
        self.trips, self.lasts = trips, lasts
        self.starts = 0
        self.begun = -1.0
        self.now = 0.0

    def start(self) -> None:
        self.starts += 1
        self.begun = self.now

    @property
    def running(self) -> bool:
        return self.starts > self.trips or (self.starts > 0 and self.now - self.begun < self.lasts)

    def recover(self) -> tuple[RecoveryOutcome, float]:
        """The outcome and when it was reached."""
        recovery = Recovery(Dashboard, self.start, 0.0)
        while self.now < 60.0:
            outcome = recovery.step(self.now, 1, 7, program_running=self.running)
            if outcome is not None:
                return outcome, self.now
            self.now += 0.008
        raise AssertionError("the recovery never ended")


class Dashboard:
    """One that is asked for nothing here."""

    def closeSafetyPopup(self) -> None: ...  # noqa: N802
    def unlockProtectiveStop(self) -> None: ...  # noqa: N802
    def powerOn(self) -> None: ...  # noqa: N802
    def brakeRelease(self) -> None: ...  # noqa: N802
    def disconnect(self) -> None: ...


def test_a_program_counts_as_recovered_once_it_has_stayed_up() -> None:
    arm = Arm(trips=1)
    outcome, when = arm.recover()
    assert outcome == RecoveryOutcome(ok=True, message="control program started")
    assert arm.starts == 2
    assert when - arm.begun >= 1.0
    assert arm.running


def test_a_program_that_never_stays_up_is_no_success() -> None:
    arm = Arm(trips=100)
    outcome, _ = arm.recover()
    assert not outcome.ok
    assert "ended again after each of 3 starts" in outcome.message
    assert arm.starts == 3


def test_a_running_program_needs_no_recovery() -> None:
    arm = Arm(trips=0)
    arm.start()
    outcome, when = arm.recover()
    assert outcome == RecoveryOutcome(ok=True, message="nothing to recover: the arm is ready")
    assert when == 0.0
    assert arm.starts == 1
