"""Faults while a phrase plays: ``python benchmarks/faults.py [--only NAME] [--list] [--minutes M]
[--out FILE]``.

Starts the graph against the emulated cell as ``pianobot up --emulated`` does, injects each fault
while a phrase plays, and prints after which time it was noticed (the supervisor's line, or the
first warning in a node's log), when the arm stood still, when what was hurt was back, and what
became of the phrase. Times are seconds, seen from outside every 0.01 s; nodes that have no stream
of their own are back with their next diagnostics, which come once a second. After ``--minutes``
no further fault is tried; those left out are said.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import platform
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from faults_graph import NODES, UP, RunningGraph, listen
from tables import table_head, table_row

from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.nodes.base.domain import claim_domain

STRIKES = 4
PHRASE = (  # 6 s
    f"defaults: {{note: 64, depth: 0.014, hold: 0.1, repeats: {STRIKES}}}\n"
    "strikes: [{speed: 0.08}]"
)
LIMIT = 25.0  # s in which a fault is to be over
MOVING = 0.04  # m/s of the wrist at the time of the fault
AWAY = 1.0  # s for which a device is away
LOADED = 20.0  # s in which a second program has begun, on a busy machine too
NOTICED, BACK, STOPPED_CONTROLLER, SOUNDING, LOST = 0.5, 2.0, 0.2, 0.05, 0.1  # s, asked


@dataclass(frozen=True)
class FaultCase:
    """One fault.

    Attributes: ``inject`` makes it, and returns what ends it after ``AWAY`` s or None; ``node`` is
    what must come back, empty if nothing goes away; ``stops`` whether the arm must come to rest;
    ``note`` whether it is injected while a note sounds; ``ends`` whether it ends the whole graph;
    ``says`` words without which a line does not count as noticing; ``away`` s until what ends it.
    """

    name: str
    inject: Callable[[RunningGraph], Callable[[], Any] | None]
    node: str = ""
    stops: bool = False
    note: bool = False
    ends: bool = False
    says: str = ""
    away: float = AWAY

    @property
    def restarts(self) -> bool:
        """Whether the supervisor has to start ``node`` anew."""
        return bool(self.node) and self.name.startswith(("kill", "SIGSTOP", "midi_bridge killed"))


@dataclass
class Seen:
    """What was seen of a fault, s after it (``back``: after the device's return)."""

    noticed: float | None = None
    by: str = ""
    stopped: float | None = None
    back: float | None = None
    sounded: float | None = None
    lost: str = ""


def _signal(name: str, number: int) -> Callable[[RunningGraph], None]:
    def inject(graph: RunningGraph) -> None:
        process = graph.node(name)
        if process is None:
            raise TimeoutError(f"{name} does not run")
        process.send_signal(number)

    return inject


def _device(
    device: str, makes: tuple[str, ...], ends: tuple[str, ...], recover: bool = False
) -> Callable[[RunningGraph], Callable[[], Any]]:
    """Commands to an emulated device, and those that end the fault."""

    def inject(graph: RunningGraph) -> Callable[[], Any]:
        for command in makes:
            graph.fault(device, command)

        def restore() -> None:
            for command in ends:
                graph.fault(device, command)
            if recover:
                graph.recover()

        return restore

    return inject


def _other_terminal(device: str) -> Callable[[RunningGraph], Callable[[], Any]]:
    """Unplugged, and back as another terminal of the system (below the same link)."""

    def inject(graph: RunningGraph) -> Callable[[], Any]:
        graph.fault(device, "unplug")
        taken = os.openpty()  # the number that the device had

        def restore() -> None:
            graph.fault(device, "replug")
            for descriptor in taken:
                os.close(descriptor)

        return restore

    return inject


def _supervisor(number: int) -> Callable[[RunningGraph], Callable[[], Any] | None]:
    def inject(graph: RunningGraph) -> Callable[[], Any] | None:
        graph.process.send_signal(number)
        if number != signal.SIGSTOP:
            return None
        return lambda: graph.process.send_signal(signal.SIGCONT)

    return inject


def _full_disk(graph: RunningGraph) -> Callable[[], Any]:
    """No file of the recorder may grow any more; afterwards a user starts a new bag."""
    process = graph.node("recorder")
    assert process is not None
    size = max((f.stat().st_size for f in _bags(graph)), default=0)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

    def restore() -> None:
        from std_srvs.srv import Trigger

        unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, unlimited)
        client = graph.observer.node.create_client(Trigger, "/recorder/start")
        client.wait_for_service(2.0)
        client.call_async(Trigger.Request())

    return restore


def _another(*words: str) -> Callable[[RunningGraph], Callable[[], Any]]:
    """A second program in the same domain."""

    def inject(graph: RunningGraph) -> Callable[[], Any]:
        process = subprocess.Popen(
            [sys.executable, "-m", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            text=True,
        )
        graph.family.append(psutil.Process(process.pid))
        listen(process, graph.lines, only="error:")  # it is the second that has to say so

        def restore() -> None:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.wait(30)

        return restore

    return inject


def _faults() -> list[FaultCase]:
    moving = {spec.name for spec in NODES if spec.moves}
    found = [
        FaultCase(f"{word} {s.name}", _signal(s.name, number), s.name, s.name in moving)
        for word, number in (("kill", signal.SIGKILL), ("SIGSTOP", signal.SIGSTOP))
        for s in NODES
    ]
    wrist = "ur5_wrist"
    found += [
        FaultCase("RTDE dropped", _device("wrist", ("drop rst",), ()), wrist, True),
        FaultCase("RTDE stalled", _device("wrist", ("stall",), ("resume",)), wrist, True),
        FaultCase("RTDE refused", _device("wrist", ("refuse", "drop"), ("accept",)), wrist, True),
        FaultCase("protective stop", _device("wrist", ("pstop",), (), True), wrist, True),
        FaultCase("emergency stop", _device("wrist", ("estop",), ("unlock",), True), wrist, True),
    ]
    for device, node in (("fsr", "fsr_reader"), ("vacuum", "vacuum_regulator")):
        found += [
            FaultCase(f"{device} unplugged", _device(device, ("unplug",), ("replug",)), node),
            FaultCase(
                f"{device} garbled",
                _device(device, ("garble 1",), ("garble 0",)),
                node,
                says=f"{device}: no measurement",
            ),
            FaultCase(
                f"{device} silent",
                _device(device, ("silence",), ("resume",)),
                node,
                says=f"{device}: no measurement",
            ),
            FaultCase(f"{device} as another terminal", _other_terminal(device), node),
        ]
    found += [
        FaultCase("MIDI server gone", _device("midi", ("drop",), ()), "midi_bridge", note=True),
        FaultCase(
            "MIDI unplugged", _device("midi", ("unplug",), ("replug",)), "midi_bridge", note=True
        ),
        FaultCase(
            "midi_bridge killed amid a note",
            _signal("midi_bridge", signal.SIGKILL),
            "midi_bridge",
            note=True,
        ),
        FaultCase("disk full", _full_disk, "recorder"),
        FaultCase(
            "two conductors",
            _another("pianobot_ros.nodes.playing.conductor"),
            says="another conductor runs",
            away=LOADED,
        ),
        FaultCase(
            "second graph",
            _another("pianobot_ros.cli.app", *UP),
            says="another graph runs",
            away=LOADED,
        ),
        FaultCase("SIGSTOP supervisor", _supervisor(signal.SIGSTOP), says="stands still"),
        FaultCase("kill supervisor", _supervisor(signal.SIGKILL), stops=True, ends=True),
    ]
    return found


def _bags(graph: RunningGraph) -> list[Path]:
    return sorted(graph.run.glob("bag*/*.mcap"), key=lambda path: path.stat().st_mtime)


def observe(graph: RunningGraph, fault: FaultCase) -> Seen:
    """Inject the fault while a phrase plays, and watch until everything is over."""
    graph.wait(graph.healthy, 60.0, "a healthy graph before the fault")
    graph.knots.clear()
    graph.setpoints.clear()
    result = graph.start(PHRASE)
    # So that there is something to stop.
    graph.wait(lambda: len(graph.setpoints) > 60, 20.0, "setpoints")
    graph.wait(lambda: graph.knots and graph.knots[-1][1] > MOVING, 20.0, "a moving arm")
    if fault.note:
        graph.wait(graph.sounding, 20.0, "a note")
    seen, bags = Seen(), _bags(graph)
    begun = time.monotonic()
    restore = fault.inject(graph)
    returned = begun if restore is None else None
    end = begun + LIMIT
    while time.monotonic() < end:
        graph.turn()
        now = time.monotonic()
        if fault.note and seen.sounded is None and not graph.sounding():
            seen.sounded = now - begun
        if restore is not None and returned is None and now > begun + fault.away:
            restore()
            returned = time.monotonic()
        if seen.back is None and returned is not None and fault.node:
            # What was sent before the fault may still be on its way.
            came, since = graph.seen.get(fault.node, 0.0), max(returned, begun + 0.15)
            if fault.restarts:
                since = graph.time_of(f"{fault.node} restarted", begun)
            if came > since:
                seen.back = came - returned
        # A killed conductor never answers.
        answered = result.done() or fault.node == "conductor"
        over = _gone(graph) if fault.ends else answered
        if over and returned is not None and (seen.back is not None or not fault.node):
            break
    _conclude(graph, fault, seen, begun, result, bags)
    return seen


def _gone(graph: RunningGraph) -> bool:
    return not any(p.is_running() and p.status() != "zombie" for p in graph.family)


def _conclude(
    graph: RunningGraph, fault: FaultCase, seen: Seen, begun: float, result: Any, bags: list[Path]
) -> None:
    shown = [
        (t, line)
        for t, line in graph.lines
        if t >= begun and not line.lstrip().startswith(("strike", "emulated cell"))
    ]
    if noticed := sorted(one for one in shown + graph.logged(begun) if fault.says in one[1]):
        seen.noticed, seen.by = noticed[0][0] - begun, noticed[0][1].strip()
    if fault.stops:
        seen.stopped = _stopped(graph, fault, begun)
    lost = []
    if fault.ends:
        gone = _gone(graph)
        lost.append("the graph ends, the emulated arm too" if gone else "processes are left over")
        if gone and seen.noticed is None:
            seen.noticed, seen.by = time.monotonic() - begun, "no process is left"
    elif fault.node == "conductor" and not result.done():
        lost.append("the phrase: its client has no result")
    elif result.done():
        answer = result.result().result
        lost.append(f"{answer.message}" if not answer.success else _played(answer))
    else:
        lost.append("the phrase's result never came")
    if fault.node == "recorder" and bags:
        lost.append(_hole(bags[-1], begun))
    seen.lost = "; ".join(lost)


def _stopped(graph: RunningGraph, fault: FaultCase, begun: float) -> float | None:
    """Arm at rest, s after the last setpoint's time where setpoints ended, else after the fault."""
    rest = graph.rest(begun)
    if rest is None:
        return None
    if "conductor" not in fault.name:
        return rest - begun
    behind = time.monotonic() - time.time()
    before = [t + behind for t in graph.setpoints if t + behind < rest]
    return rest - max([begun, *before[-1:]])


def _played(answer: Any) -> str:
    lost = len(answer.unreachable)
    again = max(int(answer.strikes) - STRIKES, 0)
    return f"{lost} of {STRIKES} strikes lost, {again} played once more"


def _hole(bag: Path, begun: float) -> str:
    """What the bag that was being written lacks before the fault."""
    last = 0.0
    with contextlib.suppress(PianobotError):
        last = max(1e-9 * raw.log_time for raw in read_raw(bag))
    wall = begun + time.time() - time.monotonic()
    return f"bag: the last {max(1e3 * (wall - last), 0.0):.0f} ms before the fault"


HEADER = (
    "fault",
    "noticed",
    "arm at rest",
    "back",
    "note sounded on",
    "what was lost",
    "noticed by",
)


def row(fault: FaultCase, seen: Seen) -> str:
    """One line of the table; what is not as asked is marked."""

    def said(value: float | None, asked: float, due: bool) -> str:
        if not due:
            return ""
        if value is None:
            return "**never**"
        return f"{value:.3f}" if value <= asked else f"**{value:.3f}**"

    cells = (
        fault.name,
        said(seen.noticed, NOTICED, True),
        # An arm that ended with the graph was not seen at rest.
        said(
            seen.stopped, STOPPED_CONTROLLER, fault.stops and not (fault.ends and not seen.stopped)
        ),
        said(seen.back, BACK, bool(fault.node)),
        said(seen.sounded, SOUNDING, fault.note),
        seen.lost.replace("|", "/")[:160],
        seen.by.replace("|", "/")[:110],
    )
    return table_row(cells)


def heading(words: list[str]) -> list[str]:
    """Title and head of the table."""
    return [
        "# Faults while a phrase plays",
        "",
        f"`{' '.join(['python benchmarks/faults.py', *words])}`, {os.cpu_count()} cores, Python"
        f" {platform.python_version()}, load at the start {os.getloadavg()[0]:.1f}, one run.",
        "",
        f"Seconds after the fault; *back*: after the device's return ({AWAY:g} s later), for a node"
        f" after its end. Asked: noticed in {NOTICED} s, arm at rest within {STOPPED_CONTROLLER} s"
        " (of the last setpoint's time, where setpoints ended: 0.04 s by the driver), back within"
        f" {BACK:g} s, no note for more than {SOUNDING} s, at most {LOST} s of a bag. **Bold**: not"
        " reached.",
        "",
        *table_head(HEADER),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", default=[], help="words in a fault's name")
    parser.add_argument("--list", action="store_true", help="only name the faults")
    parser.add_argument("--minutes", type=float, default=12.0, help="for all faults together")
    parser.add_argument("--keep", type=Path, help="directory for bags and logs")
    parser.add_argument("--out", type=Path, help="also write the table there")
    options = parser.parse_args()
    faults = [f for f in _faults() if not options.only or any(o in f.name for o in options.only)]
    if not faults:
        print(f"error: no fault is named {' or '.join(options.only)}: see --list", file=sys.stderr)
        return 2
    if options.list:
        print("\n".join(f.name for f in faults))
        return 0
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    lines = heading([w for o in options.only for w in ("--only", f"'{o}'")])
    print("\n".join(lines), flush=True)
    with contextlib.ExitStack() as stack:
        if "ROS_DOMAIN_ID" not in os.environ:
            os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(claim_domain()).number)
        base = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for line in _rows(faults, base, time.monotonic() + 60.0 * options.minutes):
            lines.append(line)
            print(line, flush=True)
            if options.out:
                options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


def _rows(faults: list[FaultCase], base: Path, until: float) -> Iterator[str]:
    """A line for each fault that begins before ``until`` (monotonic s); a graph that does not get
    well is replaced.
    """
    graph: RunningGraph | None = None
    try:
        for number, fault in enumerate(faults):
            if time.monotonic() > until:
                yield f"| {fault.name} | not tried: the time was up |" + " |" * (len(HEADER) - 2)
                continue
            try:
                graph = graph or RunningGraph(base / f"run-{number}")
                yield row(fault, observe(graph, fault))
                hurt = fault.ends or graph.process.poll() is not None
            except TimeoutError as error:
                yield f"| {fault.name} | not measured: {error} |" + " |" * (len(HEADER) - 2)
                hurt = True
            if hurt and graph is not None:
                graph.close()
                graph = None
    finally:
        if graph is not None:
            graph.close()


if __name__ == "__main__":
    sys.exit(main())
