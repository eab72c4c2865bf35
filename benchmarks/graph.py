"""The whole emulated graph while it plays: ``python benchmarks/graph.py [--seconds 60]
[--view | --browser] [--json] [--out FILE]``.

Starts every node and the emulated cell as `pianobot up --emulated` does, plays strikes on both
cells, and prints how well they keep time, what gets lost and what it costs; beside it what
RoboPianist and mujoco_ros2_control publish about themselves.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import platform
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from rclpy.serialization import deserialize_message

from pianobot_ros.bags.message_types import typestore
from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.host.priority import request_realtime
from pianobot_ros.cli.graph.running_cell import SupervisedCell, isolated_emulation, running_cell
from pianobot_ros.testing.browser import chromium, open_page

# Reliable topics: those on which nothing may be lost.
RELIABLE = {
    "/command/wrist": "WristCommand",
    "/command/vacuum": "VacuumCommand",
    "/command/strike": "StrikeMark",
    "/real/midi": "MidiEvent",
    "/sim/midi": "MidiEvent",
    "/real/keystroke": "Keystroke",
    "/sim/keystroke": "Keystroke",
    "/gap/live": "GapReport",
}
OWN = "this benchmark"
SAME = 1e-6  # m between a setpoint and its echo
LONGEST = 0.5  # s in which an echo is sought
PUBLISHED = (
    (
        "RoboPianist",
        (
            "control period 50 ms, physics step 5 ms (robopianist/suite/tasks/base.py); real-time"
            " factor, jitter and latency not published: it steps as fast as it can and has no real"
            " cell, no messages"
        ),
    ),
    (
        "mujoco_ros2_control",
        (
            "update periods of 16 to 18 ms instead of 20 ms (ros-controls/mujoco_ros2_control,"
            " issue 144); the viewer shows the real-time factor (pull request 189), but no figure"
            " is published, nor latency, losses or load"
        ),
    ),
)


class Delivered:
    """What arrives on the reliable topics, with the running number that the publisher's middleware
    gave each message.
    """

    def __init__(self, node: Any) -> None:
        from pianobot_msgs import msg

        from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos

        self._kinds = {topic: getattr(msg, kind) for topic, kind in RELIABLE.items()}
        self._streams = {
            t: PolledSubscription(node, k, t, stream_qos(1000, True))
            for t, k in self._kinds.items()
        }
        self.numbers: dict[str, dict[int, int]] = defaultdict(dict)
        """Time of sending, ns, by running number, by topic. Each of these topics has one publisher.
        """

    def take(self) -> None:
        """Fetch what has arrived."""
        for topic, stream in self._streams.items():
            handle = stream._subscription.handle
            with handle:
                while (found := handle.take_message(self._kinds[topic], True)) is not None:
                    info = found[1]
                    self.numbers[topic][int(info["publication_sequence_number"])] = int(
                        info["source_timestamp"]
                    )


def lost_messages(delivered: Delivered, bag: Path) -> dict[str, dict[str, int]]:
    """By topic: how many were published, and how many of them neither the bag nor this process
    received.
    """
    recorded: dict[str, set[int]] = defaultdict(set)
    for raw in read_raw(bag):
        recorded[raw.topic].add(raw.sent)
    found = {}
    for topic, numbers in delivered.numbers.items():
        published = max(numbers) - min(numbers) + 1
        first, last = min(numbers.values()), max(numbers.values())
        kept = sum(first <= t <= last for t in recorded[topic])
        found[topic] = {
            "published": published,
            "lost_here": published - len(numbers),
            "lost_in_bag": published - kept,
        }
    return found


def read(bag: Path, topics: Iterable[str]) -> dict[str, list[tuple[float, Any]]]:
    """Time of sending (s) and message, by topic."""
    wanted, found = set(topics), defaultdict(list)
    for raw in read_raw(bag):
        if raw.topic in wanted:
            found[raw.topic].append(
                (raw.sent * 1e-9, typestore().deserialize_cdr(raw.data, raw.type))
            )
    return found


def echo_latency(commands: list[tuple[float, Any]], states: list[tuple[float, Any]]) -> Array:
    """From the sending of each setpoint to that of the first state that names it as its target, s.
    Setpoints that a state skipped because a newer one was there already, and those that do not
    move, are left out.
    """
    times = np.array([t for t, _ in states])
    targets = np.array([[p.x, p.y, p.z] for p in (s.target_pose.position for _, s in states)])
    found, last = [], None
    for sent, command in commands:
        p = command.pose.position
        goal = np.array([p.x, p.y, p.z])
        if last is None or np.abs(goal - last).max() > 10 * SAME:
            window = slice(
                int(np.searchsorted(times, sent)), int(np.searchsorted(times, sent + LONGEST))
            )
            hits = np.flatnonzero(np.abs(targets[window] - goal).max(axis=1) < SAME)
            if len(hits):
                found.append(times[window][hits[0]] - sent)
        last = goal
    return np.array(found)


def quantiles(seconds: Array) -> dict[str, float | int | None]:
    """Median, 99th percentile and maximum in ms."""
    if not len(seconds):
        return {"n": 0, "p50_ms": None, "p99_ms": None, "max_ms": None}
    p50, p99, worst = (1e3 * float(np.percentile(seconds, q)) for q in (50, 99, 100))
    return {"n": len(seconds), "p50_ms": p50, "p99_ms": p99, "max_ms": worst}


def processor_seconds(cell: SupervisedCell) -> dict[str, float]:
    """CPU time so far by node with its children, s."""
    spent = {}
    for name, pid in {**cell.supervisor.pids, OWN: os.getpid()}.items():
        try:
            process = psutil.Process(pid)
            family = [process] if name == OWN else [process, *process.children(recursive=True)]
            spent[name] = sum(sum(p.cpu_times()[:2]) for p in family)
        except psutil.NoSuchProcess:
            continue
    return spent


def probe(cell: SupervisedCell, seconds: float) -> None:
    """Stream setpoints that are to be obeyed at once, stamped when they are sent: a few millimetres
    up and down where the wrist is. (The conductor sends its setpoints ahead of their time, so that
    they say nothing about latency.)
    """
    from pianobot_msgs.msg import WristCommand, WristState

    from pianobot_ros.nodes.base import common
    from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos

    node = cell.observer.node
    states = PolledSubscription(node, WristState, "/real/wrist/state", stream_qos(1))
    publisher = node.create_publisher(
        WristCommand, "/command/wrist", common.command_publisher_qos()
    )
    known = cell.wait(
        lambda: publisher.get_subscription_count() >= 3 and states.take(),
        10.0,
        lambda: "no wrist state",
    )
    start = deserialize_message(known[-1][0], WristState).pose
    message = WristCommand(pose=start)
    height = start.position.z

    def stream() -> None:
        request_realtime()
        begun = time.monotonic()
        for k in range(1, round(seconds * 125)):
            time.sleep(max(0.0, begun + k * 0.008 - time.monotonic()))
            message.pose.position.z = height + 0.0015 * (1 - math.cos(2 * math.pi * k * 0.008))
            message.pose.position.y += 4e-6  # so that no setpoint comes twice
            message.header.stamp = common.time_msg(time.time_ns())
            publisher.publish(message)

    thread = threading.Thread(target=stream)
    thread.start()
    while thread.is_alive():
        cell.turn()


def phrase(seconds: float) -> str:
    """A phrase of about this length."""
    turns = max(1, round(seconds / 4.5))
    strikes = """  - {note: 64, speed: 0.10, depth: 0.013, hold: 0.2, note_length: 1.0}
  - {note: 64, speed: 0.20, depth: 0.014, hold: 0.15, note_length: 1.0}
  - {notes: {thumb: 62, middle: 66}, speed: 0.15, depth: 0.014, hold: 0.3, note_length: 1.2}
  - {note: 60, speed: 0.18, depth: 0.014, hold: 0.15, note_length: 1.2}
"""
    return "strikes:\n" + turns * strikes


DRAWN = "window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 1000)"


def watch(stack: contextlib.ExitStack, cell: SupervisedCell) -> None:
    """A browser that shows the page of ``cell`` until ``stack`` ends. It takes all that is sent but
    draws once a second: without a graphics card it would draw on the cores that the graph needs.
    """
    cell.wait(lambda: cell.address, 60.0, lambda: "the page did not come up")
    browser = stack.enter_context(chromium())
    open_page(browser, cell.address, "streams", {"width": 640, "height": 400}, DRAWN)


def measure(
    seconds: float, kept: Path | None = None, view: bool = False, browser: bool = False
) -> dict[str, Any]:
    """Run the graph and collect all figures; bag and logs go to ``kept``, if given; ``view`` also
    serves the page, ``browser`` opens it.
    """
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        run = kept or Path(folder) / "run"
        domain = 1 + int.from_bytes(os.urandom(2), "little") % 100
        with running_cell(
            emulated=isolated_emulation(),
            screen=False,
            run=run,
            domain=domain,
            view=view or browser,
        ) as cell:
            if browser:
                watch(stack, cell)
            delivered = Delivered(cell.observer.node)
            turn = cell.turn

            def beat() -> None:
                turn()
                delivered.take()

            cell.turn = beat  # type: ignore[method-assign]
            settled = time.monotonic() + (15.0 if browser else 2.0)
            while time.monotonic() < settled:
                cell.turn()
            delivered.take()
            before, begun, epoch = processor_seconds(cell), time.monotonic(), time.time()
            played = cell.play(timeout=2 * seconds + 60, phrase_yaml=phrase(seconds))
            after, ended, over = processor_seconds(cell), time.monotonic(), time.time()
            cell.turn = turn  # type: ignore[method-assign]
            probe(cell, min(10.0, seconds))
        return collect(run / "bag", delivered, played, (epoch, over)) | {
            "seconds": ended - begun,
            "cores": {n: (after[n] - before[n]) / (ended - begun) for n in after if n in before},
        }


def collect(
    bag: Path, delivered: Delivered, played: Any, span: tuple[float, float]
) -> dict[str, Any]:
    """The figures that the bag holds."""
    data = read(
        bag, ["/command/wrist", "/real/wrist/state", "/sim/wrist/state", "/gap/live", "/sim/status"]
    )
    commands = [(t, m) for t, m in data["/command/wrist"] if t <= span[1]]
    at_once = [(t, m) for t, m in data["/command/wrist"] if t > span[1]]
    in_time = [(m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec, m) for _, m in commands]
    lags = [
        s.lag
        for r in (m for _, m in data["/gap/live"])
        for s in r.signals
        if s.signal == "wrist/state.z"
    ]
    status = [m for t, m in data["/sim/status"] if span[0] + 1 < t < span[1]]
    reports = [m for _, m in data["/gap/live"]]
    factors = [m.real_time_factor for m in status]
    return {
        "success": bool(played.success),
        "message": str(played.message),
        "strikes": int(played.strikes),
        "compared": len(reports),
        "sounded_on_both": sum(
            not (g.real_missing or g.sim_missing) for r in reports for g in r.keystrokes
        ),
        "real_time_factor": (
            {
                "mean": float(np.mean(factors)),
                "low": min(factors),
                "high": max(factors),
            }
            if factors
            else None
        ),
        "step_jitter": (
            {
                "p50_ms": 1e3 * float(np.median([m.jitter_p50 for m in status])),
                "p99_ms": 1e3 * float(np.median([m.jitter_p99 for m in status])),
                "worst_second_p99_ms": 1e3 * max(m.jitter_p99 for m in status),
            }
            if status
            else None
        ),
        "command_to_real_state": quantiles(echo_latency(at_once, data["/real/wrist/state"])),
        "command_to_sim_state": quantiles(echo_latency(at_once, data["/sim/wrist/state"])),
        "due_to_sim_state": quantiles(echo_latency(in_time, data["/sim/wrist/state"])),
        "wrist_real_behind_sim": quantiles(np.array([x for x in lags if np.isfinite(x)])),
        "compare_latency": quantiles(np.array([r.latency for r in reports])),
        "reliable": lost_messages(delivered, bag),
        "spread": spread(reports),
        "load": os.getloadavg()[0],
        "processor": processor(),
    }


def spread(reports: list[Any]) -> dict[str, float]:
    """How well each cell repeats: standard deviations within a condition and note, as RMS over
    those with repeats. Strikes that are not comparable (Err is no number) were not played as told.
    """
    groups: dict[tuple[str, int], list[Any]] = defaultdict(list)
    for gap in (g for r in reports for g in r.keystrokes if np.isfinite(g.err)):
        groups[gap.condition, gap.note].append(gap)
    found = {}
    for cell in ("real", "sim"):
        for name in ("v_pre", "t_hold"):
            variances = [
                np.var([getattr(getattr(g, cell), name) for g in gaps], ddof=1)
                for gaps in groups.values()
                if len(gaps) > 1
            ]
            found[f"{cell}_{name}"] = (
                float(np.sqrt(np.mean(variances))) if variances else float("nan")
            )
    errors = [g.err for gaps in groups.values() for g in gaps]
    return (
        found | {"err_median": float(np.median(errors)), "err_max": max(errors)}
        if errors
        else found
    )


Rows = list[tuple[str, str, str]]


def rows(r: dict[str, Any]) -> Rows:
    """Figure, what is asked of it, and what was measured."""
    return [
        (
            "strikes compared, sounded on both cells",
            "all",
            f"{r['compared']}, {r['sounded_on_both']} of {r['strikes']}",
        ),
        *_twin_rows(r),
        *_link_rows(r),
        *_repeat_rows(r["spread"]),
    ]


def _said(r: dict[str, Any], name: str) -> str:
    q = r[name]
    if not q["n"]:
        return "nothing measured"
    return f"p50 {q['p50_ms']:.1f}, p99 {q['p99_ms']:.1f}, max {q['max_ms']:.1f} ms (n {q['n']})"


def _twin_rows(r: dict[str, Any]) -> Rows:
    factor, jitter = r["real_time_factor"], r["step_jitter"]
    if not (factor and jitter):
        return []
    return [
        (
            "twin: real-time factor",
            "1.00 ± 0.01",
            f"{factor['mean']:.4f} (seconds from {factor['low']:.4f} to {factor['high']:.4f})",
        ),
        (
            "twin: a step begins late by",
            "p99 ≤ 1 ms",
            (
                f"p50 {jitter['p50_ms']:.2f}, p99 {jitter['p99_ms']:.2f} ms; p99 of the worst"
                f" second {jitter['worst_second_p99_ms']:.2f} ms"
            ),
        ),
    ]


def _link_rows(r: dict[str, Any]) -> Rows:
    total = sum(t["published"] for t in r["reliable"].values())
    lost = {
        t: (v["lost_here"], v["lost_in_bag"])
        for t, v in r["reliable"].items()
        if v["lost_here"] or v["lost_in_bag"]
    }
    return [
        (
            "setpoint to be obeyed at once → real state that names it",
            "p99 ≤ 15 ms",
            _said(r, "command_to_real_state"),
        ),
        (
            "setpoint to be obeyed at once → sim state that names it",
            "p99 ≤ 15 ms",
            _said(r, "command_to_sim_state"),
        ),
        (
            "setpoint's time → sim state that names it, in a phrase",
            "",
            _said(r, "due_to_sim_state"),
        ),
        ("real wrist behind simulated, by strike", "", _said(r, "wrist_real_behind_sim")),
        ("comparison after the strike's end", "p99 ≤ 50 ms", _said(r, "compare_latency")),
        (
            "messages on reliable topics; lost (here, in the bag)",
            "none",
            f"{total} on {len(r['reliable'])} topics; {lost or 'none'}",
        ),
        (
            "processor, whole graph with the emulated cell",
            "≤ 1.0 cores",
            _processor(r["cores"]),
        ),
    ]


def _processor(cores: dict[str, float]) -> str:
    graph = sum(x for name, x in cores.items() if name != OWN)
    return f"{graph:.2f} cores; {cores.get(OWN, 0.0):.2f} more of {OWN}, which counts losses"


def _repeat_rows(repeats: dict[str, float]) -> Rows:
    return [
        (
            "repeated strikes, standard deviation of V_pre (real, sim)",
            "",
            (
                f"{1e3 * repeats['real_v_pre']:.1f}, {1e3 * repeats['sim_v_pre']:.1f} mm/s (MIDI"
                " resolves 3.7)"
            ),
        ),
        (
            "repeated strikes, standard deviation of T_hold (real, sim)",
            "",
            f"{1e3 * repeats['real_t_hold']:.1f}, {1e3 * repeats['sim_t_hold']:.1f} ms",
        ),
        (
            "Err (Eq. 5) of the nominal cell",
            "",
            f"median {100 * repeats['err_median']:.1f} %, largest {100 * repeats['err_max']:.1f} %",
        ),
    ]


def print_figures(r: dict[str, Any]) -> None:
    """For people."""
    print(f"{r['message']}; {r['seconds']:.1f} s, load of the machine {r['load']:.1f}")
    for name, asked, measured in rows(r):
        print(f"{name:<60} {asked:<13} {measured}")
    for name, cores in sorted(r["cores"].items(), key=lambda item: -item[1]):
        print(f"  cores {name:<24} {cores:.3f}")
    for name, said in PUBLISHED:
        print(f"{name}: {said}")


def markdown(r: dict[str, Any]) -> str:
    """The same as a page of ``docs/results``."""
    lines = [
        "# The whole graph while it plays",
        "",
        (
            f"Written by `python benchmarks/graph.py --seconds {r['asked']:g} --out"
            f" docs/results/graph.md`: {r['strikes']} strikes in {r['seconds']:.0f} s on"
            f" {os.cpu_count()} cores ({r['processor']}), Python {platform.python_version()},"
            f" emulated cell and all nodes; load of the machine {r['load']:.1f}."
        ),
        "",
        "| figure | asked | measured |",
        "|---|---|---|",
        *(f"| {name} | {asked} | {measured} |" for name, asked, measured in rows(r)),
        "",
        "| process (with its children) | cores |",
        "|---|---|",
        *(
            f"| {name} | {cores:.3f} |"
            for name, cores in sorted(r["cores"].items(), key=lambda item: -item[1])
        ),
        "",
        "What a user has today, by what its makers publish:",
        "",
        *(f"- {name}: {said}" for name, said in PUBLISHED),
        "",
    ]
    return "\n".join(lines)


def processor() -> str:
    """The processor's name."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.machine()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="about how long to play (default %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    parser.add_argument("--out", type=Path, help="also write a page of docs/results")
    parser.add_argument("--keep", type=Path, help="directory for bag and logs")
    parser.add_argument("--view", action="store_true", help="with the node that serves the page")
    parser.add_argument("--browser", action="store_true", help="with the page open in Chromium")
    options = parser.parse_args()
    result = measure(options.seconds, options.keep, options.view, options.browser) | {
        "asked": options.seconds
    }
    if options.out:
        options.out.write_text(markdown(result), encoding="utf-8")
    if options.json:
        print(json.dumps(result | {"published_by_others": dict(PUBLISHED)}))
    else:
        print_figures(result)


if __name__ == "__main__":
    main()
