"""The cell under ROS's own clients: every verb of a table, and what the graph answered.

    python tools/official_clients.py [--ros2 PROGRAM] [--only VERB] [--no-realtime] [--out FILE]

``ros2 launch`` starts the emulated cell and its nodes in a domain of its own, the other commands of
``ros2`` drive them, and Ctrl-C ends the launch. ``--ros2`` is the command ``ros2`` of a ROS 2
installation, run in this environment (AMENT_PREFIX_PATH and PYTHONPATH reach it); it must be able
to import ``rclpy`` and the messages of this project. Exit code 1 if a verb answered otherwise than
expected. docs/graph.md says how to set it up.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import psutil

LAUNCH = Path(__file__).resolve().parents[1] / "launch" / "cell.launch.py"
STARTED = 240.0  # s for the nodes; the first start on a machine compiles
ANSWER = 40.0  # s for a command
ENDED = 30.0  # s for what Ctrl-C ends
SEEN = 120  # characters of an answer that the table shows
HARDWARE = ("ur5_wrist", "vacuum_regulator", "fsr_reader", "midi_bridge")
OTHERS = ("recorder", "gap_monitor", "sim_twin", "conductor", "gap_diagnoser", "optimizer")
STRIKE = "{note: 64, speed: 0.1, depth: 0.013, hold: 0.2}"


class ClientRow(NamedTuple):
    """One line of the table."""

    verb: str
    command: str
    expected: str
    seen: str
    ok: bool


class Program:
    """A running command whose output is collected."""

    def __init__(self, words: list[str], folder: Path, realtime: bool = True) -> None:
        self.text = ""
        self.process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,
            preexec_fn=partial(prepare, realtime),  # noqa: PLW1509 (system calls only)
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with contextlib.suppress(ValueError):
            while part := os.read(self.process.stdout.fileno(), 65536):
                self.text += part.decode(errors="replace")

    def wait_for(self, pattern: str, limit: float) -> bool:
        """Whether the output matched before the program's end and ``limit`` s."""
        end = time.monotonic() + limit
        while not (found := re.search(pattern, self.text, re.DOTALL)):
            if time.monotonic() > end or not self._reader.is_alive():
                return re.search(pattern, self.text, re.DOTALL) is not None
            time.sleep(0.02)
        return bool(found)

    def end(self, limit: float, interrupt: bool = False) -> int | None:
        """Its exit code, after Ctrl-C if ``interrupt``; None if it had to be killed."""
        if interrupt and self.process.poll() is None:
            # As a terminal does: every process of the group is told.
            os.killpg(self.process.pid, signal.SIGINT)
        try:
            code: int | None = self.process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        self._reader.join(2.0)
        return code


def prepare(realtime: bool) -> None:
    """Between fork and exec: Ctrl-C is heard, which a shell's background jobs ignore; without
    ``realtime`` also the right to real-time scheduling goes.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if not realtime:
        drop_from_bounding_set, sys_nice = 24, 23
        ctypes.CDLL(None, use_errno=True).prctl(drop_from_bounding_set, sys_nice, 0, 0, 0)


class Clients:
    """Runs commands of ``ros2`` and judges what they print."""

    def __init__(self, ros2: str, folder: Path) -> None:
        self._ros2, self.folder = ros2, folder
        self._started: list[Program] = []

    def start(self, command: str, realtime: bool = True) -> Program:
        """A command that goes on."""
        program = Program([self._ros2, *shlex.split(command)], self.folder, realtime)
        self._started = [one for one in self._started if one.process.poll() is None]
        self._started.append(program)
        return program

    def close(self) -> None:
        """End what still runs, and the daemon that the commands share."""
        for program in self._started:
            program.end(ENDED, interrupt=True)
        self.start("daemon stop").end(ANSWER)

    def run(
        self,
        command: str,
        expected: str,
        *,
        until: bool = False,
        refused: bool = False,
        says: str = "",
    ) -> ClientRow:
        """``expected`` is a pattern of the output. ``until``: Ctrl-C once it has come. ``refused``:
        the exit code may be another than 0. ``says`` puts the expectation into words.
        """
        program = self.start(command)
        if until:
            program.wait_for(expected, ANSWER)
        code = program.end(ENDED if until else ANSWER, interrupt=until)
        return judged(command, expected, program.text, code in (0, 2) or refused or until, says)

    def goal(self, name: str, kind: str, goal: str, expected: str, *, cancel: bool) -> ClientRow:
        """A goal with feedback; with ``cancel`` it is cancelled after the first."""
        command = (
            f"action send_goal --feedback {name} pianobot_msgs/action/{kind} {shlex.quote(goal)}"
        )
        program = self.start(command)
        feedback = program.wait_for("Feedback:", 2 * ANSWER)
        if cancel and feedback:
            words = f"service call {name}/_action/cancel_goal action_msgs/srv/CancelGoal"
            self.start(words).end(ANSWER)
        program.wait_for("Goal finished", 2 * ANSWER)
        code = program.end(5.0)
        pattern = f"Feedback:.*{expected}"
        says = f"feedback, {expected}" + (", after a cancel" if cancel else "")
        return judged(command, pattern, program.text, code == 0, says)


def judged(command: str, expected: str, text: str, ended: bool, says: str = "") -> ClientRow:
    """The row for a command that printed ``text``."""
    found = re.search(expected, text, re.DOTALL)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    # What only looks ahead matches nothing itself.
    said = (found[0] or " ".join(lines)) if found else " / ".join(lines[-2:])
    seen = " ".join(said.split())
    if len(seen) > SEEN:
        seen = f"{seen[: SEEN // 2]} … {seen[-SEEN // 2 :]}"
    ok = bool(found) and ended and "Traceback" not in text
    words = command.split()
    verb = " ".join(words[: 1 if words[0] in ("run", "launch") else 2])
    return ClientRow(verb, f"ros2 {command}", says or expected.replace("\\", ""), seen, ok)


# The table.


def looks(c: Clients) -> Iterator[ClientRow]:
    """Verbs that only look."""
    everybody = "".join(f"(?=.*/{name}\\b)" for name in (*HARDWARE, *OTHERS))
    yield c.run("node list", everybody, says="the ten nodes")
    yield c.run("node info /conductor", r"/play_phrase: pianobot_msgs/action/PlayPhrase")
    yield c.run("topic list -t", r"/real/fsr \[pianobot_msgs/msg/KeyForce\]")
    yield c.run("topic type /real/midi", "pianobot_msgs/msg/MidiEvent")
    yield c.run("topic find pianobot_msgs/msg/WristState", "/real/wrist/state\n/sim/wrist/state")
    yield c.run(
        "topic info -v /real/fsr",
        r"Node name: fsr_reader.*Reliability: BEST_EFFORT",
        says="fsr_reader, BEST_EFFORT",
    )
    yield c.run("topic echo --once /real/wrist/state", r"program_running: true")
    yield c.run("topic echo --once /sim/status", r"real_time_factor: 1\.0|real_time_factor: 0\.9")
    yield c.run("topic echo --once --field status /diagnostics", r"name='\w+: \w+")
    yield c.run(
        "topic hz --window 500 /real/fsr",
        r"average rate: (4[89]\d|50\d|51\d)",
        until=True,
        says="average rate: 500 Hz ± 4 %",
    )
    yield c.run("topic bw /real/wrist/state", r"KB/s from", until=True)
    yield c.run("topic delay /real/vacuum/state", r"average delay: 0\.0", until=True)
    yield c.run("interface show pianobot_msgs/msg/KeyForce", r"float64 force\s+# N")
    yield c.run("interface show pianobot_msgs/action/PlayPhrase", "phrase_yaml")
    yield c.run("interface package pianobot_msgs", "pianobot_msgs/action/Investigate")
    yield c.run("interface proto pianobot_msgs/msg/VacuumCommand", "header:")
    yield c.run("service list -t", r"/ur5_wrist/recover \[std_srvs/srv/Trigger\]")
    yield c.run("service type /sim_twin/pause", "std_srvs/srv/SetBool")
    yield c.run("action list -t", r"/investigate \[pianobot_msgs/action/Investigate\]")
    yield c.run("action info /play_phrase", r"Action servers: 1\s+/conductor")
    yield c.run("pkg executables pianobot_ros", "pianobot_ros sim_twin")
    yield c.run("pkg xml pianobot_ros --tag name", "pianobot_ros")


def parameters(c: Clients) -> Iterator[ClientRow]:
    """Parameters, accepted and refused."""
    yield c.run("param list /conductor", r"lead.*transpose", says="lead … transpose")
    yield c.run(
        "param describe /conductor lead",
        r"Description: s by which.*Max value: 0.15",
        says="description, range",
    )
    yield c.run("param get /conductor transpose", "Integer value is: 0")
    yield c.run("param set /conductor transpose 12", "Set parameter successful")
    yield c.run("param get /conductor transpose", "Integer value is: 12")
    yield c.run("param set /conductor transpose 0", "Set parameter successful")
    yield c.run("param dump /vacuum_regulator", "ros__parameters")
    for what in (
        "/conductor transpose 100",  # out of its range
        "/conductor transpose high",  # of another type
        "/conductor lead 0.1",  # read at the start only
        "/fsr_reader clock nonsense",  # no choice
        "/fsr_reader rate 250.0",  # read when it is configured
        "/ur5_wrist host ''",
        "/midi_bridge transport smoke",
    ):
        yield c.run(
            f"param set {what}",
            "(?i)setting parameter failed[^\n]*",
            refused=True,
            says="refused, with the reason",
        )


def services(c: Clients) -> Iterator[ClientRow]:
    """Services, and messages by hand."""
    yield c.run("service call /recorder/stop std_srvs/srv/Trigger", "success=True")
    yield c.run("service call /recorder/start std_srvs/srv/Trigger", "success=True")
    yield c.run("service call /sim_twin/pause std_srvs/srv/SetBool '{data: true}'", "success=True")
    yield c.run("service call /sim_twin/pause std_srvs/srv/SetBool '{data: false}'", "success=True")
    yield c.run("service call /sim_twin/reset std_srvs/srv/Trigger", "success=True")
    yield c.run("service call /midi_bridge/release_notes std_srvs/srv/Trigger", "success=True")
    yield c.run("service call /ur5_wrist/stop std_srvs/srv/Trigger", "success=True")
    yield c.run("service call /ur5_wrist/recover std_srvs/srv/Trigger", "success=True")
    heard = c.start("topic echo /real/refusals")
    wrong = "'{header: {frame_id: elsewhere}, pose: {orientation: {w: 1.0}}}'"
    yield c.run(
        f"topic pub -t 2 -w 2 /command/wrist pianobot_msgs/msg/WristCommand {wrong}",
        "publishing #2",
        says="published",
    )
    heard.wait_for("elsewhere", 5.0)
    heard.end(ENDED, interrupt=True)
    yield judged(
        "topic echo /real/refusals",
        "[^\n]*elsewhere[^\n]*",
        heard.text,
        True,
        "the setpoint in a foreign frame is refused",
    )


def lifecycle(c: Clients) -> Iterator[ClientRow]:
    """Every transition of the hardware nodes."""
    yield c.run(
        "lifecycle nodes",
        "".join(f"(?=.*/{n}\\b)" for n in HARDWARE),
        says="the four hardware nodes",
    )
    yield c.run("lifecycle list /ur5_wrist", "deactivate")
    for name in HARDWARE:
        for transition, state in (
            ("deactivate", "inactive"),
            ("cleanup", "unconfigured"),
            ("configure", "inactive"),
            ("activate", "active"),
        ):
            yield c.run(f"lifecycle set /{name} {transition}", "Transitioning successful")
            if transition in ("cleanup", "activate"):
                yield c.run(f"lifecycle get /{name}", rf"{state} \[\d\]", says=state)
    yield c.run(
        "lifecycle set /ur5_wrist cleanup",
        "Unknown transition|Transitioning failed",
        refused=True,
        says="refused: it is active",
    )


def actions(c: Clients) -> Iterator[ClientRow]:
    """The five actions."""
    done, cancelled, aborted = (f"status: {word}" for word in ("SUCCEEDED", "CANCELED", "ABORTED"))
    phrase = f'{{phrase_yaml: "strikes: [{STRIKE}, {STRIKE}]"}}'
    yield c.goal("/play_phrase", "PlayPhrase", phrase, done, cancel=False)
    yield c.goal("/play_phrase", "PlayPhrase", "{score: demo}", cancelled, cancel=True)
    yield c.run(
        "action send_goal /play_phrase pianobot_msgs/action/PlayPhrase '{score: nowhere}'", aborted
    )
    yield c.run(
        "action send_goal /diagnose_gap pianobot_msgs/action/DiagnoseGap '{recording: nowhere}'",
        f"message: [^\n]*nowhere.*{aborted}",
        says=f"names the path, {aborted}",
    )
    # Every program was started in that folder; the nodes too.
    bag = sorted((c.folder / "recordings").iterdir())[-1].relative_to(c.folder)
    goal = f"{{recording: {bag}}}"
    yield c.goal("/identify_keystroke", "IdentifyKeystroke", goal, cancelled, cancel=True)
    reference = "{reference: " + str(bag) + ", lambda1: 0.5, lambda2: 0.5}"
    yield c.goal("/optimize_stiffness", "OptimizeStiffness", reference, cancelled, cancel=True)
    yield c.goal("/diagnose_gap", "DiagnoseGap", goal, cancelled, cancel=True)
    yield c.goal("/investigate", "Investigate", "{budget_strikes: 40}", cancelled, cancel=True)


def running(c: Clients) -> Iterator[ClientRow]:
    """A node by itself, and its Ctrl-C."""
    command = "run pianobot_ros optimizer --ros-args -r __node:=another"
    program = c.start(command)
    end = time.monotonic() + ANSWER
    there = False
    while not there and time.monotonic() < end:
        there = c.run("node list --no-daemon --spin-time 3", "/another").ok
    code = program.end(ENDED, interrupt=True)
    text = f"{'seen' if there else 'not seen'}, exit code {code} {program.text}"
    yield judged(command, r"\Aseen, exit code 0", text, there, "seen in the graph; ends on Ctrl-C")
    wrong = "run pianobot_ros conductor --ros-args -p transpose:=high"
    yield c.run(wrong, "error: [^\n]*transpose[^\n]*", refused=True, says="one line: error")
    yield c.run("run pianobot_ros nobody", "No executable found", refused=True)


PARTS = {
    "looks": looks,
    "parameters": parameters,
    "services": services,
    "lifecycle": lifecycle,
    "actions": actions,
    "run": running,
}


def launched(c: Clients, parts: list[str], realtime: bool) -> Iterator[ClientRow]:
    """All parts while the launch file runs."""
    yield c.run(f"launch {LAUNCH} --show-args", "'emulated':")
    command = f"launch {LAUNCH} emulated:=true view:=false"
    program = c.start(command, realtime)
    family: list[psutil.Process] = []
    try:
        ready = _ready(c, program)
        yield judged(
            command,
            "active",
            "the four hardware nodes are active" if ready else program.text,
            ready,
            "the hardware nodes become active",
        )
        for part in parts if ready else []:
            yield from PARTS[part](c)
    finally:
        with contextlib.suppress(psutil.NoSuchProcess):
            family = psutil.Process(program.process.pid).children(recursive=True)
        before = len(program.text)
        code = program.end(ENDED, interrupt=True)
        _, left = psutil.wait_procs(family, 5.0)
        for process in left:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        (c.folder / "launch.log").write_text(program.text, encoding="utf-8")
    text = program.text[before:]
    died = re.findall(r"[^\n]*(?:process has died|Traceback)[^\n]*", text)
    said = f"exit code {code}, {len(left)} processes left, {len(died)} died: {' '.join(died)}"
    yield judged(
        f"{command}; Ctrl-C",
        "exit code 0, 0 processes left, 0 died",
        said,
        True,
        "exit code 0, nothing died, nothing left",
    )
    restarted = re.findall(r"[^\n]*process has died[^\n]*", program.text[:before])
    yield judged(
        command,
        "0 nodes died",
        f"{len(restarted)} nodes died {restarted}",
        True,
        "no node died meanwhile",
    )


def _ready(c: Clients, program: Program) -> bool:
    """Whether all hardware nodes become active and phrases can be sent."""
    end = time.monotonic() + STARTED
    missing = list(HARDWARE)
    while missing and time.monotonic() < end and program.process.poll() is None:
        if c.run(f"lifecycle get /{missing[0]}", r"^active \[3\]").ok:
            missing.pop(0)
    return not missing and c.run("topic echo --once /sim/status", "real_time_factor").ok


def table(rows: list[ClientRow], folder: Path) -> Iterator[str]:
    """The rows in Markdown; paths as seen from ``folder``, where all of them ran."""
    yield "| verb | command | expected | seen | ok |"
    yield "|---|---|---|---|---|"
    here = f"{LAUNCH.parents[1]}/"
    for row in rows:
        command, expected, seen = (
            text.replace("|", "\\|").replace("\n", " ").replace(here, "").replace(f"{folder}/", "")
            for text in row[1:4]
        )
        ok = "yes" if row.ok else "**no**"
        yield f"| {row.verb} | `{command}` | {expected} | {seen} | {ok} |"


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--ros2", default="ros2", help="the command of a ROS 2 installation")
    parser.add_argument("--only", action="append", choices=sorted(PARTS), help="only this part")
    parser.add_argument("--no-realtime", action="store_true", help="with ordinary scheduling")
    parser.add_argument("--keep", type=Path, help="directory for bags and the launch's output")
    parser.add_argument("--out", type=Path, help="also write the table there")
    options = parser.parse_args()
    ros2 = shutil.which(options.ros2)
    if ros2 is None:
        print(f"error: no command {options.ros2}: name it with --ros2", file=sys.stderr)
        return 2
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    parts = options.only or list(PARTS)
    rows = []
    with contextlib.ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        clients = Clients(str(Path(ros2).absolute()), folder.absolute())
        stack.callback(clients.close)
        for row in launched(clients, parts, not options.no_realtime):
            rows.append(row)
            print(f"{'ok ' if row.ok else 'NO '} {row.command}\n      {row.seen}", flush=True)
    good = sum(row.ok for row in rows)
    command = ["python tools/official_clients.py", *(f"--only {one}" for one in options.only or [])]
    command += ["--no-realtime"] if options.no_realtime else []
    lines = [
        "# ROS's own clients against the graph",
        "",
        f"Written by `{' '.join(command)}`: {good} of {len(rows)} as expected.",
        "",
        *table(rows, folder.absolute()),
    ]
    if options.out:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(lines[2])
    return 0 if good == len(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
