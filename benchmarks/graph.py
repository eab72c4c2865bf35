"""The whole emulated graph while it plays: ``python benchmarks/graph.py [--seconds 60] [--json]``.

Starts every node and the emulated cell as `pianobot up --emulated` does, plays strikes on both cells, and prints how well they
keep time, what gets lost and what it costs; beside it what RoboPianist and mujoco_ros2_control publish about themselves.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from pianobot_ros.bags.stream import read_raw
from pianobot_ros.bags.types import typestore
from pianobot_ros.cli.cell import Cell, isolated_emulation, running_cell

Array = NDArray[np.float64]

# Reliable topics: those on which nothing may be lost.
RELIABLE = {
    "/command/wrist": "WristCommand", "/command/vacuum": "VacuumCommand", "/command/strike": "StrikeMark",
    "/real/midi": "MidiEvent", "/sim/midi": "MidiEvent", "/real/keystroke": "Keystroke", "/sim/keystroke": "Keystroke",
    "/gap/live": "GapReport",
}  # fmt: skip
SAME = 1e-6  # m between a setpoint and its echo
LONGEST = 0.5  # s in which an echo is sought
PUBLISHED = (
    ("RoboPianist", "control period 50 ms, physics step 5 ms (robopianist/suite/tasks/base.py); real-time factor, jitter and "
     "latency not published: it steps as fast as it can and has no real cell, no messages"),
    ("mujoco_ros2_control", "update periods of 16 to 18 ms instead of 20 ms (ros-controls/mujoco_ros2_control, issue 144); "
     "the viewer shows the real-time factor (pull request 189), but no figure is published, nor latency, losses or load"),
)  # fmt: skip


class Delivered:
    """What arrives on the reliable topics, with the running number that the publisher's middleware gave each message."""

    def __init__(self, node: Any) -> None:
        from pianobot_msgs import msg

        from pianobot_ros.nodes.polled import PolledSubscription, stream_qos

        self._kinds = {topic: getattr(msg, kind) for topic, kind in RELIABLE.items()}
        self._streams = {t: PolledSubscription(node, k, t, stream_qos(1000, True)) for t, k in self._kinds.items()}
        self.numbers: dict[str, dict[int, int]] = defaultdict(dict)
        """Time of sending, ns, by running number, by topic. Each of these topics has one publisher."""

    def take(self) -> None:
        """Fetch what has arrived."""
        for topic, stream in self._streams.items():
            handle = stream._subscription.handle
            with handle:
                while (found := handle.take_message(self._kinds[topic], True)) is not None:
                    info = found[1]
                    self.numbers[topic][int(info["publication_sequence_number"])] = int(info["source_timestamp"])


def lost_messages(delivered: Delivered, bag: Path) -> dict[str, dict[str, int]]:
    """By topic: how many were published, and how many of them neither the bag nor this process received."""
    recorded: dict[str, set[int]] = defaultdict(set)
    for raw in read_raw(bag):
        recorded[raw.topic].add(raw.log_time)
    found = {}
    for topic, numbers in delivered.numbers.items():
        published = max(numbers) - min(numbers) + 1
        first, last = min(numbers.values()), max(numbers.values())
        kept = sum(first <= t <= last for t in recorded[topic])
        found[topic] = {"published": published, "lost_here": published - len(numbers), "lost_in_bag": published - kept}
    return found


def read(bag: Path, topics: Iterable[str]) -> dict[str, list[tuple[float, Any]]]:
    """Time of sending (s) and message, by topic."""
    wanted, found = set(topics), defaultdict(list)
    for raw in read_raw(bag):
        if raw.topic in wanted:
            found[raw.topic].append((raw.log_time * 1e-9, typestore().deserialize_cdr(raw.data, raw.type)))
    return found


def echo_latency(commands: list[tuple[float, Any]], states: list[tuple[float, Any]]) -> Array:
    """From the sending of each setpoint to that of the first state that names it as its target, s. Setpoints that a state
    skipped because a newer one was there already, and those that do not move, are left out."""
    times = np.array([t for t, _ in states])
    targets = np.array([[p.x, p.y, p.z] for p in (s.target_pose.position for _, s in states)])
    found, last = [], None
    for sent, command in commands:
        p = command.pose.position
        goal = np.array([p.x, p.y, p.z])
        if last is None or np.abs(goal - last).max() > 10 * SAME:
            window = slice(int(np.searchsorted(times, sent)), int(np.searchsorted(times, sent + LONGEST)))
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


def processor_seconds(cell: Cell) -> dict[str, float]:
    """CPU time so far by node with its children, s."""
    spent = {}
    for name, pid in {**cell.supervisor.pids, "command line": os.getpid()}.items():
        try:
            process = psutil.Process(pid)
            family = [process] if name == "command line" else [process, *process.children(recursive=True)]
            spent[name] = sum(sum(p.cpu_times()[:2]) for p in family)
        except psutil.NoSuchProcess:
            continue
    return spent


def phrase(seconds: float) -> str:
    """A phrase of about this length."""
    turns = max(1, round(seconds / 4.5))
    strikes = """  - {note: 64, speed: 0.10, depth: 0.013, hold: 0.2, note_length: 1.0}
  - {note: 64, speed: 0.20, depth: 0.014, hold: 0.15, note_length: 1.0}
  - {notes: {thumb: 62, middle: 66}, speed: 0.15, depth: 0.014, hold: 0.3, note_length: 1.2}
  - {note: 60, speed: 0.18, depth: 0.014, hold: 0.15, note_length: 1.2}
"""
    return "strikes:\n" + turns * strikes


def measure(seconds: float, kept: Path | None = None) -> dict[str, Any]:
    """Run the graph and collect all figures; bag and logs go to ``kept``, if given."""
    with tempfile.TemporaryDirectory() as folder:
        run = kept or Path(folder) / "run"
        domain = 1 + int.from_bytes(os.urandom(2), "little") % 100
        with running_cell(emulated=isolated_emulation(), screen=False, run=run, domain=domain) as cell:
            delivered = Delivered(cell.observer.node)
            turn = cell.turn

            def beat() -> None:
                turn()
                delivered.take()

            cell.turn = beat  # type: ignore[method-assign]
            settled = time.monotonic() + 2.0
            while time.monotonic() < settled:
                cell.turn()
            before, begun, epoch = processor_seconds(cell), time.monotonic(), time.time()
            played = cell.play(timeout=2 * seconds + 60, phrase_yaml=phrase(seconds))
            after, ended, over = processor_seconds(cell), time.monotonic(), time.time()
            late = time.monotonic() + 1.0
            while time.monotonic() < late:
                cell.turn()
        return collect(run / "bag", delivered, played, (epoch, over)) | {
            "seconds": ended - begun,
            "cores": {n: (after[n] - before[n]) / (ended - begun) for n in after if n in before},
        }


def collect(bag: Path, delivered: Delivered, played: Any, span: tuple[float, float]) -> dict[str, Any]:
    """The figures that the bag holds."""
    data = read(bag, ["/command/wrist", "/real/wrist/state", "/sim/wrist/state", "/gap/live", "/sim/status"])
    commands = data["/command/wrist"]
    status = [m for t, m in data["/sim/status"] if span[0] + 1 < t < span[1]]
    reports = [m for _, m in data["/gap/live"]]
    factors = [m.real_time_factor for m in status]
    return {
        "success": bool(played.success), "message": str(played.message), "strikes": int(played.strikes), "compared": len(reports),
        "sounded_on_both": sum(not (g.real_missing or g.sim_missing) for r in reports for g in r.keystrokes),
        "real_time_factor": {"mean": float(np.mean(factors)), "low": min(factors), "high": max(factors)} if factors else None,
        "step_jitter": {
            "p50_ms": 1e3 * float(np.median([m.jitter_p50 for m in status])),
            "p99_ms": 1e3 * float(np.median([m.jitter_p99 for m in status])),
            "worst_second_p99_ms": 1e3 * max(m.jitter_p99 for m in status),
        } if status else None,
        "command_to_real_state": quantiles(echo_latency(commands, data["/real/wrist/state"])),
        "command_to_sim_state": quantiles(echo_latency(commands, data["/sim/wrist/state"])),
        "compare_latency": quantiles(np.array([r.latency for r in reports])),
        "reliable": lost_messages(delivered, bag),
    }  # fmt: skip


def print_figures(r: dict[str, Any]) -> None:
    """The same for people."""
    print(f"{r['message']}; {r['compared']} compared, {r['sounded_on_both']} sounded on both; {r['seconds']:.1f} s, "
          f"load of the machine {os.getloadavg()[0]:.1f}")  # fmt: skip
    if f := r["real_time_factor"]:
        print(f"twin real-time factor          {f['mean']:.4f} (seconds from {f['low']:.4f} to {f['high']:.4f})")
    if f := r["step_jitter"]:
        print(f"twin step jitter               p50 {f['p50_ms']:.2f}  p99 {f['p99_ms']:.2f} ms (median second); "
              f"p99 of the worst second {f['worst_second_p99_ms']:.2f} ms")  # fmt: skip
    for name in ("command_to_real_state", "command_to_sim_state", "compare_latency"):
        q = r[name]
        figures = "nothing measured" if not q["n"] else (
            f"p50 {q['p50_ms']:.1f}  p99 {q['p99_ms']:.1f}  max {q['max_ms']:.1f} ms, n {q['n']}")  # fmt: skip
        print(f"{name.replace('_', ' '):<30} {figures}")
    total = sum(t["published"] for t in r["reliable"].values())
    lost = {
        t: (v["lost_here"], v["lost_in_bag"]) for t, v in r["reliable"].items() if v["lost_here"] or v["lost_in_bag"]
    }
    print(f"reliable topics                {total} messages on {len(r['reliable'])} topics; lost (on the way, in the bag): "
          f"{lost or 'none'}")  # fmt: skip
    for name, cores in sorted(r["cores"].items(), key=lambda item: -item[1]):
        print(f"  cores {name:<24} {cores:.3f}")
    print(f"  cores {'in total':<24} {sum(r['cores'].values()):.3f}")
    for name, said in PUBLISHED:
        print(f"{name}: {said}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="about how long to play (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    options = parser.parse_args()
    result = measure(options.seconds)
    if options.json:
        print(json.dumps(result | {"published_by_others": dict(PUBLISHED)}))
    else:
        print_figures(result)


if __name__ == "__main__":
    main()
