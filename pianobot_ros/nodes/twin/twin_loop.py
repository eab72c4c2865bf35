"""The thread that keeps the twin on wall time.

Commands take effect at the time that they are stamped with, not when the thread happens to get
round to them: a busy machine may delay the twin, but it does not distort what the twin plays. For
that the twin runs a few milliseconds behind the wall clock, so that a command is there before its
time.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.wall_clock import AHEAD, wall_offset_ns
from pianobot_ros.devices.attended import Attended
from pianobot_ros.devices.base import Health, HealthLevel
from pianobot_ros.nodes.twin.command_queue import AT_ONCE, CommandQueue
from pianobot_ros.piano.twin.stepping.cell_twin import (
    CellTwin,
    Samples,
    TwinDivergedError,
    check_pose,
    check_pressure,
)
from pianobot_ros.piano.twin.stepping.laws import Laws

__all__ = ["CATCH_UP", "Pace", "Sink", "TwinLoop"]

# s behind real time beyond which the twin skips ahead instead of catching up. A busy machine holds
# a process up for some tenths of a second; the physics runs many times faster than they pass.
CATCH_UP = 2.0
WINDOW = 1.0  # s over which pace is judged
# s by which the twin trails the wall clock: what comes at once is then obeyed at its time, or
# nearly
DELAY = 0.001
LONGEST_STRETCH = (
    0.02  # s of physics without a look at the clock, when there is something to catch up with
)


class Pace:
    """Real-time factor and jitter over the last second."""

    def __init__(self, period: float) -> None:
        self.simulated = deque[tuple[float, float]]()
        self.late = deque[float](maxlen=max(20, round(WINDOW / period)))

    def clear(self) -> None:
        """Forget everything."""
        self.simulated.clear()
        self.late.clear()

    def note(self, wall: float, simulated: float, late: float) -> None:
        """One wake-up: wall and simulated time at its end, s, and how late after its due time it
        was begun, s.
        """
        self.simulated.append((wall, simulated))
        self.late.append(late)
        while self.simulated[0][0] < wall - WINDOW:
            self.simulated.popleft()

    @property
    def real_time_factor(self) -> float:
        """Simulated over wall time; NaN before there is any."""
        if len(self.simulated) < 2:
            return float("nan")
        (w0, s0), (w1, s1) = self.simulated[0], self.simulated[-1]
        return (s1 - s0) / (w1 - w0)

    def jitter(self, percentile: float) -> float:
        """Lateness (s) that ``percentile`` of the wake-ups stay below."""
        return float(np.percentile(list(self.late), percentile)) if self.late else float("nan")


class Sink(Protocol):
    """Where the samples go; called on the loop's thread."""

    def publish(self, samples: Samples, epoch_ns: int, pace: Pace, paused: bool) -> None:
        """``epoch_ns``: wall time of simulated time 0."""

    def idle(self, pace: Pace) -> None:
        """Called now and then while paused."""


class TwinLoop:
    """Steps the twin every ``period`` s up to a due time on the monotonic clock. Commands may come
    from any thread.

    A wake-up costs about as much as 2 ms of physics, so it does many steps, all of them in one
    stretch if nothing but setpoints of the wrist comes between; each command is obeyed at the step
    nearest to its time.
    """

    def __init__(
        self,
        twin: CellTwin,
        sink: Sink,
        period: float,
        complain: Callable[[Exception], None],
        look: Callable[[], None],
    ) -> None:
        """``look`` is called at each wake-up, to fetch commands; ``complain`` with what goes
        wrong.
        """
        self.twin, self._sink, self._complain, self._look = twin, sink, complain, look
        self.steps = max(1, round(period / twin.cell.timestep))
        self.pace = Pace(period)
        self.faults = 0
        self.skips = 0  # how often the machine slept for longer than could be caught up
        self.starts = 0  # how often the twin began anew, away from where it was commanded
        self._commands = CommandQueue()
        self._epoch = time.time_ns()
        self._stopping, self._paused, self._reset = (
            threading.Event(),
            threading.Event(),
            threading.Event(),
        )
        self._thread = Attended(self._run, "physics", self._begin_anew)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, and wait for it."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def command_wrist(self, pose: NDArray[np.float64], stamp_ns: int = 0) -> None:
        """As :meth:`Twin.command_wrist`, at wall time ``stamp_ns``; 0: at once. Raises
        :class:`PianobotError` for a bad pose.
        """
        self._commands.add(self._due(stamp_ns), check_pose(pose))

    def command_vacuum(self, pressure: Mapping[str, float], stamp_ns: int = 0) -> None:
        """As :meth:`Twin.command_vacuum`, at wall time ``stamp_ns``; 0: at once."""
        command = partial(self.twin.command_vacuum, check_pressure(pressure))
        self._commands.add(self._due(stamp_ns), command)

    def correct(self, laws: Laws | None) -> None:
        """As :meth:`Twin.correct`, before the next step."""
        self._commands.add(AT_ONCE, partial(self.twin.correct, laws))

    def _due(self, stamp_ns: int) -> float:
        """Simulated time, s, at which a command stamped ``stamp_ns`` is to be obeyed."""
        due = (stamp_ns - self._epoch) * 1e-9 if stamp_ns else AT_ONCE
        # Judged by the wall clock: a twin that has to catch up obeys at the stamp all the same.
        latest = (time.time_ns() - self._epoch) * 1e-9 + AHEAD
        return due if due < latest else AT_ONCE

    def reset(self) -> None:
        """Start over before the next wake-up."""
        self._reset.set()

    def pause(self, paused: bool) -> None:
        """Stand still, or go on."""
        if paused:
            self._paused.set()
        else:
            self._paused.clear()

    def health(self) -> Health:
        """Whether the twin keeps up with real time."""
        values = {
            "real_time_factor": self.pace.real_time_factor,
            "jitter_p99_s": self.pace.jitter(99),
            "faults": self.faults,
            "skips": self.skips,
        }
        if not self._thread.is_alive():
            return Health(HealthLevel.ERROR, "the physics has ended", values=values)
        if self._paused.is_set():
            return Health(HealthLevel.OK, "paused", 0.0, values)
        slow = self.pace.real_time_factor < 0.98
        return Health(
            HealthLevel.WARN if slow else HealthLevel.OK,
            "slower than real time" if slow else "on time",
            0.0,
            values,
        )

    def _begin_anew(self, text: str) -> None:
        self._fail(PianobotError(f"internal error: {text}; the twin starts over"))
        self.reset()

    def _run(self) -> None:
        period = self.steps * self.twin.cell.timestep
        start, done = self._anchor()
        while not self._stopping.is_set():
            if self._reset.is_set():
                self._reset.clear()
                self._commands.clear()
                self.twin.reset()
                self.starts += 1
                self.pace.clear()
                start, done = self._anchor()
            if self._paused.is_set():
                self._sink.idle(self.pace)
                self._look()
                time.sleep(0.02)
                start, done = self._anchor()
                continue
            due = start + (done + 1) * period
            wait = due + DELAY - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            late = time.monotonic() - DELAY - due
            self._look()
            now = time.monotonic() - DELAY
            if now - (start + done * period) > CATCH_UP:
                self.skips += 1
                self.twin.trigger.interrupt()
                start, done = self._anchor()  # the machine slept: time goes on from here
                continue
            periods = max(
                1, min(int((now - start) / period) - done, round(LONGEST_STRETCH / period))
            )
            left = periods * self.steps
            while left > 0 and not self._reset.is_set():
                left -= self._advance(left)
            done += periods
            self.pace.note(time.monotonic() - DELAY, self.twin.time, late)

    def _anchor(self) -> tuple[float, int]:
        """Now is now: wall time of simulated time 0, so that stamps are on wall time, evenly
        spaced, and never go back. What waits for its time keeps that, and is obeyed at once where
        the twin has left it out.
        """
        now, before = time.monotonic() - DELAY, self._epoch
        self._epoch = max(before, wall_offset_ns() + round(1e9 * (now - self.twin.time)))
        self._commands.put_off(1e-9 * (before - self._epoch))
        return now, 0

    def _advance(self, steps: int) -> int:
        """Step until the next command that is no setpoint, at most ``steps``; returns how many
        steps that were.
        """
        twin = self.twin
        stretch = self._commands.take(twin.time, twin.cell.timestep, steps, twin.target)
        for call in stretch.calls:
            call()
        count = len(stretch.targets)
        try:
            samples = twin.step(count, stretch.targets)
        except TwinDivergedError as error:
            self._fail(error)
            self.reset()
            return count
        except PianobotError as error:
            self._fail(error)
            twin.target = twin.pose
            self.starts += 1
            return count
        twin.target = stretch.after
        self._sink.publish(samples, self._epoch, self.pace, False)
        return count

    def _fail(self, error: Exception) -> None:
        self.faults += 1
        self._complain(error)
