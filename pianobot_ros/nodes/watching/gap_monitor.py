"""``gap_monitor``: compares the real and the simulated cell live, strike by strike.

Follows both cells' streams as raw bytes and decodes only the window of each strike once it is over;
publishes one GapReport on ``/gap/live`` for each announced strike, and on ``/gap/clocks`` what the
devices' stamps say about their clocks.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Any

import numpy as np
from pianobot_msgs.msg import GapReport, StrikeMark, TwinStatus
from rclpy.serialization import deserialize_message

from pianobot_ros.cell.recordings.keystroke import PAPER_LAMBDA
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.session.clock_sights import ClockSights
from pianobot_ros.nodes.session.lost_strikes import ARRIVAL
from pianobot_ros.nodes.session.notes import EVENTS, Listener
from pianobot_ros.nodes.session.refused_commands import OneSidedRefusals
from pianobot_ros.nodes.topics.polled import Beat, PolledSubscription, stream_qos
from pianobot_ros.nodes.watching.cell_streams import CELLS, CellStreams
from pianobot_ros.nodes.watching.strike_comparison import StrikeComparison, warm_up

__all__ = ["GapMonitor", "main"]

SOON = 0.06  # s before a window's end from which on the streams are looked at more often


class GapMonitor(common.PianoNode):
    """The node: waits for each strike to be over, and publishes its comparison."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gap_monitor", **options)
        self._slow = self.declare(
            "poll_period", 0.05, "s between two looks at the streams", 0.005, 0.2
        )
        ending = "s between two looks when a strike's window ends"
        self._quick = self.declare("end_period", 0.005, ending, 0.002, 0.1)
        dynamics, articulation = PAPER_LAMBDA
        weights = (
            self.declare("lambda1", dynamics, "weight of dynamics in Err (Eq. 5)", 0.0, 1.0),
            self.declare("lambda2", articulation, "weight of articulation in Err", 0.0, 1.0),
        )
        self._clocks = ClockSights(self)
        self._streams = CellStreams(self, self._clocks)
        self._notes = Listener(self, CELLS)
        self._marks = PolledSubscription(
            self, StrikeMark, "/command/strike", stream_qos(EVENTS, reliable=True)
        )
        self._refusals = OneSidedRefusals(self, CELLS)
        self._comparison = StrikeComparison(self._streams, self._notes, weights)
        self._report = self.create_publisher(GapReport, "/gap/live", common.EVENT_QOS)
        self._waiting: list[StrikeMark] = []
        self._errors: list[float] = []
        self._latencies: deque[float] = deque(maxlen=1000)
        self._count = 0
        self._adopted: list[str] = []
        self.create_subscription(TwinStatus, "/sim/status", self._on_status, common.SENSOR_QOS)
        warm_up()
        self._beat = Beat(self, self._poll, self._slow, "streams")
        self._beat.start()

    def diagnose(self) -> Mapping[str, Health]:
        """How many strikes were compared, how quickly, and which streams are silent."""
        silent = self._streams.silent()
        latest = float(np.quantile(self._latencies, 0.99)) if self._latencies else 0.0
        values: dict[str, float | int | str] = {
            "strikes": self._count,
            "latency_p99_ms": 1e3 * latest,
        }
        values |= {"err_mean": float(np.mean(self._errors))} if self._errors else {}
        values |= {"silent": ", ".join(silent)} if silent else {}
        if self._refusals.count:
            values |= {"not_comparable": self._refusals.count, "last_reason": self._refusals.last}
        return {
            "comparison": Health(HealthLevel.OK, f"{self._count} strikes compared", 0.0, values)
        }

    def shut_down(self) -> None:
        """End the looking."""
        self._beat.close()

    # What arrives. All of it on the thread that looks for it, so that a strike's end waits for
    # nothing else of the node.

    def _poll(self) -> None:
        now = time.time()
        for taken in self._marks.take():
            mark = deserialize_message(taken.data, StrikeMark)
            self._waiting.append(mark)
            self._comparison.announce(mark)
        self._notes.look()
        self._clocks.tell()
        self._refusals.take()
        self._streams.take(now)
        due = list(takewhile(lambda mark: self._over(mark, now), self._waiting))
        del self._waiting[: len(due)]
        for mark in due:
            self._compare(mark)
        ending = any(common.seconds(m.end) < now + SOON for m in self._waiting)
        self._beat.period = self._quick if ending else self._slow

    def _over(self, mark: StrikeMark, now: float) -> bool:
        """Whether all of the strike is there: every living stream has passed the window's end, and
        its note has begun and ended on both cells, or has had the time to arrive."""
        end = common.seconds(mark.end)
        if now < end or not self._streams.passed(end, now):
            return False
        return now >= end + ARRIVAL or not any(
            self._comparison.awaited(cell, mark) for cell in self._notes.present()
        )

    def _on_status(self, message: TwinStatus) -> None:
        self._adopted = list(message.adopted)

    def _compare(self, mark: StrikeMark) -> None:
        report = GapReport(strike=self._count, adopted=self._adopted)
        self._count += 1
        report.keystrokes = [self._comparison.keystrokes(mark)]
        if self._refusals.spoil(mark):
            self.get_logger().warning(
                f"the cells are not comparable in strike {mark.index}: {self._refusals.last}"
            )
            report.keystrokes[0].err = float("nan")
        else:
            report.signals = self._comparison.signals(mark)
        if not np.isnan(err := report.keystrokes[0].err):
            self._errors.append(err)
        report.err_mean = float(np.mean(self._errors)) if self._errors else float("nan")
        now = time.time_ns()
        report.latency = now * 1e-9 - common.seconds(mark.end)
        report.header.stamp = common.time_msg(now)
        self._latencies.append(report.latency)
        self._report.publish(report)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(GapMonitor, arguments, realtime=common.REALTIME_PRIORITY - 1)


if __name__ == "__main__":
    sys.exit(main())
