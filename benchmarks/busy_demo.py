"""``pianobot demo`` beside busy loops: ``python benchmarks/busy_demo.py [--runs 1] [--loops 2]
[--no-realtime] [--no-diagnosis] [--seed 1] [--keep DIR] [--out FILE]``.

Starts busy loops of ordinary priority and runs the demo beside them, with the right to real-time
scheduling if the caller has it, or without (``--no-realtime`` takes ``CAP_SYS_NICE`` from it).
Prints a line for each run: exit code, verdict, what became of the strikes, setpoints late by more
than a cycle (``benchmarks/live_strikes.py``), strikes falsely called silent, and what the demo
said had failed. Asked: no crash, a verdict every time, lost strikes counted.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from live_strikes import COLUMNS, Counts, strikes_of
from tables import table_head, table_row

from pianobot_ros.cell.errors import PianobotError

PR_CAPBSET_DROP, CAP_SYS_NICE = 24, 23
LIMIT = 900.0  # s for one run
HEADER = (
    "run",
    "real-time",
    "exit",
    "verdict",
    "strikes asked",
    "played again",
    "lost",
    "falsely silent",
    "setpoints sent late",
    "obeyed late (of moving states)",
    "seconds",
    "said",
)


@dataclass
class DemoRun:
    """One demo. ``said`` is what it said had failed, or its last words if it crashed."""

    exit_code: int
    seconds: float
    summary: dict[str, Any]
    strikes: Counts
    said: str

    @property
    def verdict(self) -> str:
        """The diagnosis' verdict, or why there is none."""
        return str(self.summary.get("diagnosis", {}).get("verdict", "none"))

    @property
    def crashed(self) -> bool:
        """Whether it ended without its summary."""
        return not self.summary


def no_realtime() -> None:
    """Take from this process and its children the right to real-time scheduling and negative nice
    values.
    """
    # A process that may not drop it does not have it.
    ctypes.CDLL(None, use_errno=True).prctl(PR_CAPBSET_DROP, CAP_SYS_NICE, 0, 0, 0)
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_NICE):
        resource.setrlimit(limit, (0, 0))


@contextlib.contextmanager
def busy(loops: int) -> Iterator[None]:
    """So many processes of ordinary priority that compute without end."""
    made = [
        subprocess.Popen(
            [sys.executable, "-c", "while True: pass"],
            preexec_fn=_ordinary,  # noqa: PLW1509 (system calls only)
        )
        for _ in range(loops)
    ]
    try:
        yield
    finally:
        for process in made:
            process.kill()
            process.wait()


def _ordinary() -> None:
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, 0)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # ends with this process


def demo(folder: Path, seed: int, *, realtime: bool, diagnosis: bool) -> DemoRun:
    """Run the demo once; bag and logs go to ``folder``."""
    words = ["demo", "--json", "--no-tui", "--seed", str(seed), "--run", str(folder)]
    begun = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "pianobot_ros.cli.app", *words, *([] if diagnosis else NOTHING)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=None if realtime else no_realtime,  # noqa: PLW1509 (system calls only)
    )
    try:
        output, errors = process.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        process.terminate()
        output, errors = process.communicate()
    seconds = time.monotonic() - begun
    try:
        summary = json.loads(output.splitlines()[-1])
    except (IndexError, json.JSONDecodeError):
        summary = {}
    last = (errors.strip().splitlines() or [""])[-1]
    said = "; ".join(summary.get("failures", [])) if summary else last
    try:
        strikes = strikes_of(folder / "bag")
    except PianobotError as error:
        strikes, said = dict.fromkeys(COLUMNS, 0), f"{said}; {error}"
    return DemoRun(process.returncode, seconds, summary, strikes, said)


NOTHING = ["--no-diagnosis"]


def row(number: int, run: DemoRun, realtime: bool) -> str:
    """One line of the table."""
    s = run.strikes
    cells = (
        number,
        "yes" if realtime else "no",
        run.exit_code,
        run.verdict,
        run.summary.get("asked", "?"),
        run.summary.get("repeated", "?"),
        run.summary.get("lost", "?"),
        f"{s['falsely_silent']} of {s['silent']}",
        f"{s['late_sent']} of {s['setpoints']}",
        f"{s['late_obeyed']} of {s['moving']}",
        f"{run.seconds:.0f}",
        run.said.replace("|", "/") or "-",
    )
    return table_row(cells)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--loops", type=int, default=2, help="busy loops (default %(default)s)")
    parser.add_argument("--no-realtime", action="store_true")
    parser.add_argument("--no-diagnosis", action="store_true", help="only play and record")
    parser.add_argument("--seed", type=int, default=1, help="of the first run's hidden effect")
    parser.add_argument("--keep", type=Path, help="directory for bags and logs")
    parser.add_argument("--out", type=Path, help="also write the table there")
    options = parser.parse_args()
    words = " ".join(["python benchmarks/busy_demo.py", *_without_files(sys.argv[1:])])
    lines = [
        f"`{words}`: {os.cpu_count()} cores, {options.loops} busy loops, load at the start"
        f" {os.getloadavg()[0]:.1f}.",
        "",
        *table_head(HEADER),
    ]
    print("\n".join(lines), flush=True)
    runs: list[DemoRun] = []
    with tempfile.TemporaryDirectory() as folder:
        base = options.keep or Path(folder)
        for i in range(options.runs):
            with busy(options.loops):
                run = demo(
                    base / f"run-{i + 1}",
                    options.seed + i,
                    realtime=not options.no_realtime,
                    diagnosis=not options.no_diagnosis,
                )
            runs.append(run)
            lines.append(row(i + 1, run, not options.no_realtime))
            print(lines[-1], flush=True)
    lines += ["", _total(runs, diagnosis=not options.no_diagnosis)]
    print("\n".join(lines[-2:]))
    if options.out:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 1 if any(r.crashed for r in runs) else 0


def _without_files(words: list[str]) -> list[str]:
    """The command line without the places of files, which differ from machine to machine."""
    kept, skip = [], False
    for word in words:
        if not skip and word not in ("--keep", "--out"):
            kept.append(word)
        skip = word in ("--keep", "--out")
    return kept


def _total(runs: list[DemoRun], *, diagnosis: bool) -> str:
    crashed = sum(r.crashed for r in runs)
    verdicts = sum(r.verdict != "none" for r in runs)
    lost = sum(int(r.summary.get("lost", 0)) for r in runs)
    said = f"{verdicts} verdicts, " if diagnosis else ""
    return f"{len(runs)} runs: {crashed} crashed, {said}{lost} strikes lost."


if __name__ == "__main__":
    sys.exit(main())
