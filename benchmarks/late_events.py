"""How late reliable events come on a busy machine: ``python benchmarks/late_events.py [--profile
FILE]``.

A process that stores 500 Hz streams and note events, as ``gap_monitor`` does, is stopped for a
quarter of a second now and then, as by a machine with other work. Meanwhile its socket overflows;
what is lost then arrives when the middleware sends it again. Prints by how much events came late,
with the profile of the graph (``config/dds-localhost.xml``) and with the middleware's own
settings.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tables import table_head

STREAMS = 6  # of nearly 500 Hz
SECONDS, STOPS, STOPPED = 9.0, 1.5, 0.4  # s: to publish, between two stops, and how long each is
EVENT = 0.12  # s between two events
REST = 3.5  # s in which what was lost may come: longer than the middleware's own 3 s
PLAIN = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com"><profiles>
  <transport_descriptors><transport_descriptor><transport_id>udp</transport_id><type>UDPv4</type>
  </transport_descriptor></transport_descriptors>
  <participant profile_name="plain" is_default_profile="true"><rtps>
    <userTransports><transport_id>udp</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
  </rtps></participant>
</profiles></dds>
"""


def _node(name: str) -> Any:
    import rclpy

    rclpy.init()
    return rclpy.create_node(name)


def receive() -> None:
    """Store everything until standard input ends; prints the delays of the events, s."""
    from pianobot_msgs.msg import MidiEvent, WristState

    from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos

    node = _node("receiver")
    events = PolledSubscription(node, MidiEvent, "/late/events", stream_qos(200, True))
    streams = [
        PolledSubscription(node, WristState, f"/late/stream_{i}", stream_qos(500))
        for i in range(STREAMS)
    ]
    delays: list[float] = []
    end = time.monotonic() + SECONDS + REST + 10.0
    while time.monotonic() < end and not select.select([sys.stdin], [], [], 0.01)[0]:
        for taken in events.take():
            delays.append(1e-9 * (time.time_ns() - taken.sent))
        for stream in streams:
            stream.take()
    print(json.dumps(delays))


def publish(profile: Path) -> tuple[int, list[float]]:
    """Events that were published, and the delays (s) of those that arrived."""
    from pianobot_msgs.msg import MidiEvent, WristState

    from pianobot_ros.nodes.base import common

    receiver = subprocess.Popen(
        [sys.executable, __file__, "--receive"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    node = _node("sender")
    events = node.create_publisher(MidiEvent, "/late/events", common.EVENT_QOS)
    streams = [
        node.create_publisher(WristState, f"/late/stream_{i}", common.SENSOR_QOS)
        for i in range(STREAMS)
    ]
    limit = time.monotonic() + 30.0
    while not all(p.get_subscription_count() for p in (events, *streams)):
        if time.monotonic() > limit:
            receiver.kill()
            sys.exit(f"error: nobody listens with {profile}")
        time.sleep(0.05)
    begun, count, stopped = time.monotonic(), 0, False
    while (now := time.monotonic() - begun) < SECONDS:
        for stream in streams:
            stream.publish(WristState())
        if now > count * EVENT:
            events.publish(MidiEvent())
            count += 1
        wanted = 0.5 < now % STOPS < 0.5 + STOPPED
        if wanted != stopped:
            receiver.send_signal(signal.SIGSTOP if wanted else signal.SIGCONT)
            stopped = wanted
        time.sleep(0.002)
    receiver.send_signal(signal.SIGCONT)
    time.sleep(REST)
    answer = receiver.communicate(b"\n")[0]
    return count, json.loads(answer)


def measure(profile: Path) -> tuple[int, list[float]]:
    """:func:`publish` in a process of its own, since the middleware reads its profile once."""
    environment = {
        **os.environ,
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
        "FASTDDS_DEFAULT_PROFILES_FILE": str(profile),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    }
    done = subprocess.run(
        [sys.executable, __file__, "--publish", str(profile)],
        env=environment,
        stdout=subprocess.PIPE,
        check=True,
    )
    count, delays = json.loads(done.stdout)
    return int(count), list(delays)


def row(name: str, count: int, delays: list[float]) -> str:
    """One line of the table."""
    late = [sum(d > limit for d in delays) for limit in (0.5, 1.0)]
    return (
        f"| {name} | {count} | {count - len(delays)} | {late[0]} | {late[1]} |"
        f" {max(delays, default=float('nan')):.2f} s |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--profile", type=Path, help="a profile of your own, instead of the graph's"
    )
    parser.add_argument("--receive", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--publish", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.receive:
        receive()
    elif options.publish:
        print(json.dumps(publish(options.publish)))
    else:
        from pianobot_ros.cell.numbers.config import config_file

        own = options.profile or config_file("dds-localhost.xml")
        names = "profile", "events", "never came", "later than 0.5 s", "than 1 s", "latest"
        print("\n".join(table_head(names)))
        with tempfile.TemporaryDirectory() as folder:
            plain = Path(folder) / "plain.xml"
            plain.write_text(PLAIN, encoding="utf-8")
            print(row("the middleware's own settings", *measure(plain)), flush=True)
        print(row(own.name, *measure(own)))


if __name__ == "__main__":
    main()
