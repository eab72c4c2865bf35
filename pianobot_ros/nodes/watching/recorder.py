"""``recorder``: a rosbag2 MCAP bag of the whole cell, of which ``kill -9`` loses at most 100 ms.

Records every topic under the prefixes of ``topics`` as it appears, with the QoS of its publishers;
``~/start`` and ``~/stop`` begin and end a bag. A full disk ends the bag in order, with one error
line and in ``/diagnostics``.
"""

from __future__ import annotations

import importlib
import shutil
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from std_srvs.srv import Trigger

from pianobot_ros.bags.live_writer import LiveWriter, fresh_directory
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.topics.polled import Beat, PolledSubscription, stream_qos

__all__ = ["Recorder", "main"]

DEPTH = 1000  # messages of one topic between two polls, with a wide margin
DISCOVERY = 0.25  # s between two looks for new topics


class Recorder(common.PianoNode):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("recorder", **options)
        self._prefixes = self.declare(
            "topics",
            ["/command/", "/real/", "/sim/", "/gap/", "/diagnostics"],
            "beginnings of the topics recorded",
        )
        self._output = self.declare(
            "output", "", "directory of the bag; empty: recordings/<date and time>"
        )
        self._floor = 1e6 * self.declare(
            "min_free", 50.0, "MB of free disk space below which recording ends", 0.0, 1e9
        )
        flush = self.declare("flush_period", 0.04, "s between two writes to the disk", 0.005, 0.1)
        self._writer: LiveWriter | None = None
        self._failure = ""
        self._streams: dict[str, PolledSubscription] = {}
        self._unknown: set[str] = set()
        self._lock = (
            threading.RLock()
        )  # writer and streams: the beat's thread and the executor's both use them
        self.create_service(Trigger, "~/start", self._on_start)
        self.create_service(Trigger, "~/stop", self._on_stop)
        self.create_timer(DISCOVERY, self._discover)
        self.create_timer(1.0, self._check_disk)
        self._beat = Beat(self, self._poll, flush, "streams")
        try:
            if self.declare("autostart", True, "begin to record at start-up"):
                self._start()
            self._beat.start()
        except BaseException:  # a signal may come while it is being made, which nobody ends then
            self._finish()
            raise

    def diagnose(self) -> Mapping[str, Health]:
        """Where the bag is and how much is in it."""
        if self._failure:
            return {"recorder": Health(HealthLevel.ERROR, self._failure, 0.0)}
        if self._writer is None:
            return {"recorder": Health(HealthLevel.OK, "not recording", 0.0)}
        values: dict[str, float | int | str] = {
            "bag": str(self._writer.path),
            "messages": self._writer.messages,
            "topics": len(self._streams),
        }
        return {"recorder": Health(HealthLevel.OK, "recording", 0.0, values)}

    def shut_down(self) -> None:
        """Close the bag."""
        self._beat.close()
        self._finish()

    # Beginning and end.

    def _start(self) -> Path:
        with self._lock:
            wanted = (
                Path(self._output)
                if self._output
                else Path("recordings") / time.strftime("%Y-%m-%d_%H-%M-%S")
            )
            self._writer = LiveWriter(fresh_directory(wanted.absolute()), chunk_size=1 << 20)
            self._failure = ""
            self.get_logger().info(f"recording to {self._writer.path}")
            self._discover()
            return self._writer.path

    def _finish(self) -> str:
        with self._lock:
            if self._writer is None:
                return self._failure or "not recording"
            self._poll()
            writer = self._take_writer()
            if writer is None:  # the disk was full
                return self._failure
            for stream in self._streams.values():
                stream.destroy()
            self._streams.clear()
            try:
                writer.close()
            except OSError as error:
                self._fail(writer, error.strerror or str(error))
                return self._failure
            text = f"{writer.messages} messages in {writer.path}"
            self.get_logger().info(f"closed: {text}")
            return text

    def _take_writer(self) -> LiveWriter | None:
        writer, self._writer = self._writer, None
        return writer

    def _fail(self, writer: LiveWriter, reason: str) -> None:
        writer.abandon()
        self._writer = None
        self._failure = (
            f"recording ended: {reason}; make room and call ~/start; `pianobot bag repair"
            f" {writer.path}`"
        )
        self.get_logger().error(self._failure)
        self.diagnostics.publish()

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._writer is not None:
            response.message = f"recording to {self._writer.path} already"
            return response
        try:
            response.message, response.success = str(self._start()), True
        except RecordingError as error:
            response.message = str(error)
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._writer is not None
        response.message = self._finish()
        return response

    # While recording.

    def _discover(self) -> None:
        with self._lock:
            if self._writer is None:
                return
            for topic, types in self.get_topic_names_and_types():
                if (
                    topic in self._streams
                    or topic in self._unknown
                    or not topic.startswith(tuple(self._prefixes))
                ):
                    continue
                if "/_action/" in topic or not (
                    publishers := self.get_publishers_info_by_topic(topic)
                ):
                    continue
                try:
                    kind = _message_class(types[0])
                    if not self._writer.knows(topic):
                        offered = [_offered(p.qos_profile) for p in publishers]
                        self._writer.add_topic(topic, types[0], offered)
                except (RecordingError, ImportError, AttributeError) as error:
                    self._unknown.add(topic)
                    self.get_logger().warning(f"{topic} is not recorded: {error}")
                    continue
                self._streams[topic] = PolledSubscription(
                    self, kind, topic, _matching([p.qos_profile for p in publishers])
                )

    def _poll(self) -> None:
        with self._lock:
            writer = self._writer
            if writer is None:
                return
            try:
                taken = [
                    (received, topic, data, sent)
                    for topic, stream in self._streams.items()
                    for data, sent, received in stream.take()
                ]
                for received, topic, data, sent in sorted(taken, key=itemgetter(0)):
                    writer.write(topic, received, data, sent)
                writer.flush()
            except OSError as error:
                self._fail(writer, error.strerror or str(error))

    def _check_disk(self) -> None:
        with self._lock:
            if self._writer is None:
                return
            try:
                free = shutil.disk_usage(self._writer.path).free
            except OSError as error:  # somebody has taken the bag away
                self._fail(self._writer, error.strerror or str(error))
                return
            if free < self._floor:
                # Ended while there is still room for the summary, so that the bag is whole.
                path = self._writer.path
                self._finish()
                self._failure = (
                    f"recording ended: {free / 1e6:.0f} MB free on the disk of {path}; make room"
                    " and call ~/start"
                )
                self.get_logger().error(self._failure)
                self.diagnostics.publish()


def _message_class(name: str) -> Any:
    package, _, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def _matching(offered: Sequence[QoSProfile]) -> QoSProfile:
    """The strictest QoS that every publisher of the topic offers."""
    reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
    qos = stream_qos(DEPTH, reliable)
    if all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered):
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return qos


def _offered(qos: QoSProfile) -> Qos:
    """What one publisher offers, as a bag says it."""

    def seconds(duration: Duration) -> QosTime:
        return QosTime(*divmod(duration.nanoseconds, 1_000_000_000))

    return Qos(
        history=QosHistory(qos.history),
        depth=qos.depth,
        reliability=QosReliability(qos.reliability),
        durability=QosDurability(qos.durability),
        deadline=seconds(qos.deadline),
        lifespan=seconds(qos.lifespan),
        liveliness=QosLiveliness(qos.liveliness),
        liveliness_lease_duration=seconds(qos.liveliness_lease_duration),
        avoid_ros_namespace_conventions=qos.avoid_ros_namespace_conventions,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(Recorder, arguments, realtime=common.REALTIME_PRIORITY - 1, alone=False)


if __name__ == "__main__":
    sys.exit(main())
