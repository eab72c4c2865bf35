"""Brings the arm back after a protective stop, a released emergency stop, or the death of its
program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Dashboard", "Recovery", "RecoveryOutcome"]

_STEP_PERIOD = 0.25  # s between two dashboard commands
_UNLOCK_LIMIT = 9.0  # s; the robot refuses to unlock during the first 5 s
_POWER_LIMIT = 30.0  # s for power-on and brake release
_SETTLED = 0.5  # s after the request from which a state is believed to be younger than it
_STAYS_UP = 1.0  # s for which a program that was started must run before that counts as success
_STARTS = 3  # of the program in one recovery

_NORMAL, _REDUCED, _PROTECTIVE_STOP = 1, 2, 3
_POWERED = (4, 5)  # power on, idle
_RUNNING = 7
_NOT_RECOVERABLE = {
    4: (
        "the robot is in recovery mode: move it back into its limits on the pendant, then recover"
        " again"
    ),
    5: "safeguard stop: close the safeguard, then recover again",
    6: "emergency stop: release the button, then recover again",
    7: "emergency stop: release the button, then recover again",
    8: "safety violation: restart the safety system on the pendant",
    9: "safety fault: restart the safety system on the pendant",
}


class Dashboard(Protocol):
    """The commands needed of the dashboard client; each raises RuntimeError if the robot
    refuses.
    """

    def closeSafetyPopup(self) -> None: ...  # noqa: N802, D102
    def unlockProtectiveStop(self) -> None: ...  # noqa: N802, D102
    def powerOn(self) -> None: ...  # noqa: N802, D102
    def brakeRelease(self) -> None: ...  # noqa: N802, D102
    def disconnect(self) -> None: ...  # noqa: D102


@dataclass(frozen=True)
class RecoveryOutcome:
    """Whether the arm obeys again, and one line that says so or why not."""

    ok: bool
    message: str


class Recovery:
    """One recovery, a step at a time, so that the state keeps flowing meanwhile.

    Args:
        dashboard: opens a connection to the dashboard.
        start_control: uploads and starts the control program.
        now: monotonic time, s.
    """

    def __init__(
        self, dashboard: Callable[[], Dashboard], start_control: Callable[[], None], now: float
    ) -> None:
        self._open, self._start_control = dashboard, start_control
        self._dashboard: Dashboard | None = None
        self._begun, self._next = now, now
        self._done: list[str] = []
        self._last_refusal = ""
        self._starts = 0
        self._up_since: float | None = None

    def step(
        self, now: float, safety_mode: int, robot_mode: int, *, program_running: bool
    ) -> RecoveryOutcome | None:
        """Do the next thing; an outcome when there is nothing left to do."""
        if now < self._next:
            return None
        self._next = now + _STEP_PERIOD
        try:
            outcome = self._advance(now, safety_mode, robot_mode, program_running)
        except RuntimeError as error:
            outcome = RecoveryOutcome(
                ok=False, message=f"recovery failed: {' '.join(str(error).split())}"
            )
        if outcome is not None and self._dashboard is not None:
            self._dashboard.disconnect()
        return outcome

    def _advance(
        self, now: float, safety: int, robot: int, program_running: bool
    ) -> RecoveryOutcome | None:
        if safety in _NOT_RECOVERABLE:
            # What was read last may be from before the button was released.
            settled = now - self._begun >= _SETTLED
            return RecoveryOutcome(ok=False, message=_NOT_RECOVERABLE[safety]) if settled else None
        if self._dashboard is None:
            self._dashboard = self._open()
        if safety == _PROTECTIVE_STOP:
            return self._unlock(self._dashboard, now)
        if robot != _RUNNING:
            return self._power(self._dashboard, now, robot)
        if not program_running:
            return self._start()
        return self._confirm(now)

    def _start(self) -> RecoveryOutcome | None:
        if self._starts == _STARTS:
            return RecoveryOutcome(
                ok=False,
                message=f"the control program ended again after each of {_STARTS} starts: look at"
                " the pendant, and at what else keeps this machine busy",
            )
        self._start_control()
        self._starts += 1
        self._up_since = None
        self._note("control program started")
        return None

    def _confirm(self, now: float) -> RecoveryOutcome | None:
        """A program that was started counts once it has stayed up."""
        if self._up_since is None:
            self._up_since = now
        if self._starts and now - self._up_since < _STAYS_UP:
            return None
        return RecoveryOutcome(
            ok=True, message=", ".join(self._done) or "nothing to recover: the arm is ready"
        )

    def _unlock(self, dashboard: Dashboard, now: float) -> RecoveryOutcome | None:
        if now - self._begun > _UNLOCK_LIMIT:
            return RecoveryOutcome(
                ok=False, message=f"the protective stop cannot be unlocked: {self._last_refusal}"
            )
        try:
            dashboard.closeSafetyPopup()
            dashboard.unlockProtectiveStop()
            self._note("protective stop unlocked")
        except RuntimeError as error:
            self._last_refusal = " ".join(str(error).split())
        return None

    def _power(self, dashboard: Dashboard, now: float, robot: int) -> RecoveryOutcome | None:
        if now - self._begun > _POWER_LIMIT:
            return RecoveryOutcome(
                ok=False, message="the robot did not power up: look at the pendant"
            )
        if robot in _POWERED:
            self._once("brakes released", dashboard.brakeRelease)
        else:
            self._once("motors switched on", dashboard.powerOn)
        return None

    def _once(self, what: str, action: Callable[[], None]) -> None:
        if what not in self._done:
            action()
            self._done.append(what)

    def _note(self, what: str) -> None:
        if what not in self._done:
            self._done.append(what)
