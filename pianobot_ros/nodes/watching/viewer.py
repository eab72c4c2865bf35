"""``viewer``: the cell in the browser, the real one beside its ghost, and the gap as it opens.

Listens to the fast streams, as raw bytes, only while a browser looks; without one it costs next to
nothing, and it never answers a publisher. Serves at 127.0.0.1; parameter ``host`` opens it to the
network, without a password. Parameter ``controls`` adds buttons that call the graph's own actions
and services.
"""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus, GoalStatusArray
from pianobot_msgs.action import DiagnoseGap, Investigate
from pianobot_msgs.msg import Diagnosis, GapReport, MidiEvent
from pianobot_msgs.msg import Keystroke as KeystrokeMessage
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from pianobot_ros.cell.messages.events import note_event
from pianobot_ros.cell.messages.stamps import seconds
from pianobot_ros.cell.recordings.keystroke import Keystroke
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.topics.decoding import KINDS, Decoder
from pianobot_ros.nodes.topics.polled import Beat, PolledSubscription, stream_qos
from pianobot_ros.nodes.watching.viewer_controls import Controls
from pianobot_ros.piano.view.address import DEFAULT_HOST, DEFAULT_PORT, warn_if_open
from pianobot_ros.piano.view.page import Page
from pianobot_ros.piano.view.tape.from_bag import stage_table
from pianobot_ros.piano.view.tape.tape import CELLS, STREAMS, Job, StageGaps, StrikeRow, Tape

__all__ = ["Viewer", "main"]

MEMORY = 15.0  # s of streams kept
PAGE_DELAY = 0.06  # s by which the page is behind, so that both cells have been heard
IDLE = 0.25  # s between two looks for a browser
LINGER = 5.0  # s after the last browser's leave in which the streams are still taken
ROWS = 2000  # strikes kept
RUNNING = (
    GoalStatus.STATUS_ACCEPTED,
    GoalStatus.STATUS_EXECUTING,
    GoalStatus.STATUS_CANCELING,
)


class Viewer(common.PianoNode):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("viewer", **options)
        host = self.declare(
            "host", DEFAULT_HOST, "address of the page; others than loopback open it to all"
        )
        port = self.declare(
            "port", DEFAULT_PORT, "port of the page, the next free one if taken; 0: any"
        )
        rate = self.declare("rate", 20.0, "pictures per second", 1.0, 60.0)
        controls = self.declare("controls", False, "buttons that play, diagnose and adopt")
        output = self.declare(
            "output", "", "directory of reports asked for on the page; empty: until the node ends"
        )
        self.tape = Tape(memory=MEMORY)
        self._decoder = Decoder(self.tape)
        self._streams: dict[str, PolledSubscription] = {}
        self._lock = threading.Lock()
        self._seen = 0.0
        self._leading: tuple[tuple[str, float], ...] = ()
        warn_if_open(host)
        self.page = Page(self.tape, host=host, port=port)
        self._listen()
        self._controls: Controls | None = None
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        if controls:
            if not output:
                self._scratch = tempfile.TemporaryDirectory(prefix="pianobot-view-")
                output = self._scratch.name
            self._controls = Controls(self, self.page.server.gui, Path(output))
        self.create_timer(IDLE, self._attend)
        self._period = 1.0 / rate
        self._beat = Beat(self, self._draw, IDLE, "page")
        self._beat.start()
        self.get_logger().info(f"the page is at {self.page.address}")

    def _listen(self) -> None:
        """To what comes seldom; kept also while nobody looks."""
        for cell in CELLS:
            self.create_subscription(
                MidiEvent, f"/{cell}/midi", lambda m, c=cell: self._note(c, m), common.EVENT_QOS
            )
        self.create_subscription(GapReport, "/gap/live", self._compared, common.EVENT_QOS)
        self.create_subscription(Diagnosis, "/gap/diagnosis", self._diagnosed, common.LATCHED_QOS)
        for kind, name in ((DiagnoseGap, "diagnose_gap"), (Investigate, "investigate")):
            self.create_subscription(
                kind.Impl.FeedbackMessage, f"/{name}/_action/feedback", self._progress, 10
            )
            self.create_subscription(
                GoalStatusArray, f"/{name}/_action/status", self._ended, common.LATCHED_QOS
            )

    def diagnose(self) -> Mapping[str, Health]:
        """Where the page is and who looks."""
        values: dict[str, float | int | str] = {
            "address": self.page.address,
            "browsers": self.page.clients,
            "dropped": self._decoder.dropped,
        }
        return {"page": Health(HealthLevel.OK, self.page.address, 0.0, values)}

    def shut_down(self) -> None:
        """Stop serving."""
        self._beat.close()
        if self._controls is not None:
            self._controls.close()
        self.page.close()
        if self._scratch is not None:
            self._scratch.cleanup()

    # The fast streams, while somebody looks.

    def _attend(self) -> None:
        now = time.monotonic()
        if self.page.clients:
            self._seen = now
        wanted = self._seen > 0 and now - self._seen < LINGER
        with self._lock:
            if wanted and not self._streams:
                for cell in CELLS:
                    for topic in STREAMS:
                        name = f"{cell}/{topic}"
                        self._streams[name] = PolledSubscription(
                            self, KINDS[topic], f"/{name}", stream_qos(500)
                        )
                    joints = f"{cell}/joint_states"
                    self._streams[joints] = PolledSubscription(
                        self, JointState, f"/{joints}", stream_qos(1)
                    )
            elif not wanted and self._streams:
                for stream in self._streams.values():
                    stream.destroy()
                self._streams.clear()
                self.tape.forget_samples()
        self._beat.period = self._period if wanted else IDLE

    def _draw(self) -> None:
        with self._lock:
            if not self._streams:
                return
            for name, stream in self._streams.items():
                data = [taken.data for taken in stream.take()]
                if name.endswith("joint_states"):
                    self._joints(name, data)
                else:
                    self._decoder.feed(name, data)
        self.page.update(time.time() - PAGE_DELAY)

    def _joints(self, name: str, data: Sequence[bytes]) -> None:
        if data:
            message = deserialize_message(data[-1], JointState)
            position = np.array(message.position, dtype=float)
            if position.shape == (6,) and np.isfinite(position).all():
                stamp = np.array([seconds(message.header.stamp)])
                self.tape.add(f"{name}.position", stamp, position[None])

    # What comes seldom.

    def _note(self, cell: str, message: MidiEvent) -> None:
        event = note_event(message, seconds(message.header.stamp))
        if event is not None:
            self.tape.note(cell, event)

    def _compared(self, message: GapReport) -> None:
        now = seconds(message.header.stamp)
        with self.tape.lock:
            for gap in message.keystrokes:
                real = None if gap.real_missing else _stroke(gap.real)
                sim = None if gap.sim_missing else _stroke(gap.sim)
                self.tape.rows.append(
                    StrikeRow(
                        now,
                        now,
                        int(message.strike),
                        gap.note,
                        gap.condition,
                        real,
                        sim,
                        gap.err,
                        tuple(message.adopted),
                    )
                )
            del self.tape.rows[:-ROWS]

    def _diagnosed(self, message: Diagnosis) -> None:
        now = time.time() - PAGE_DELAY
        document = json.loads(message.json) if message.json else {}
        gaps = {s.name: float(s.gap) for s in message.stages}
        with self.tape.lock:
            self._leading = tuple((c.name, float(c.probability)) for c in message.candidates)
            self.tape.jobs = [replace(job, leading=self._leading) for job in self.tape.jobs]
            if gaps:
                table = stage_table(document)
                self.tape.stages.append(StageGaps(now, len(self.tape.rows), gaps, table))
            self.tape.said = [(now, message.sentence)]
            if message.verdict:
                self.tape.verdicts = [(now, document)]
                self.tape.jobs.clear()
                if document.get("report"):
                    self.tape.report = str(document["report"])
            del self.tape.stages[:-ROWS]

    def _progress(self, message: Any) -> None:
        feedback = message.feedback
        leading = tuple((c.name, float(c.probability)) for c in getattr(feedback, "leading", ()))
        leading = leading or self._leading
        doing = str(getattr(feedback, "stage", "") or getattr(feedback, "doing", ""))
        with self.tape.lock:
            self.tape.jobs = [
                Job(time.time() - PAGE_DELAY, doing, float(feedback.progress), leading)
            ]

    def _ended(self, message: GoalStatusArray) -> None:
        """A job whose goal has ended is no longer shown."""
        if message.status_list and not any(s.status in RUNNING for s in message.status_list):
            with self.tape.lock:
                self.tape.jobs.clear()


def _stroke(message: KeystrokeMessage) -> Keystroke:
    return Keystroke(
        int(message.note),
        seconds(message.onset),
        message.v_pre,
        message.v_rel,
        message.t_hold,
        message.t_idle,
        message.peak_force,
        message.radius,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(Viewer, arguments, low_priority=True, alone=False)


if __name__ == "__main__":
    sys.exit(main())
