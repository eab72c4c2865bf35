"""Hostile input at every door of the package, and what became of it.

    python benchmarks/fuzz.py [--frames N] [--minutes N] [--seed S] [--target NAME] [--save DIR]
        [--out FILE]

Frames are made with correct checksums, so that they reach what lies behind. Asked of each door: no
crash, no second of computing for one input, nothing accepted that is out of limits, and no growth
of the process. Prints a table; exit code 1 if one of these fails. ``--seed-bug`` takes a check away
first, which the fuzzer must find.
"""

from __future__ import annotations

import argparse
import math
import platform
import random
import resource
import shlex
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from unittest import mock

import psutil
from fuzzing.files import file_targets
from fuzzing.target import OutOfLimitsError, Target
from fuzzing.topics import Topics
from fuzzing.wire import wire_targets
from tables import table_head, table_row

from pianobot_ros.devices.serial_line import Line

ALL: list[type[Target]] = [*wire_targets(), *file_targets(), Topics]
TARGETS = {target.name: target for target in ALL}
LONGEST = 1.0  # s of computing for one frame
BRAKE = 30  # s after which a frame is given up, however busy the machine
GROWTH = 200e6  # bytes that the process may grow by
WARM = 50  # inputs after which it counts
ROOM = 4 << 30  # bytes of address space beyond what is taken at the start


class Hang(BaseException):
    """A frame took too long."""


@dataclass
class Outcome:
    """What became of the frames of one target."""

    name: str
    frames: int = 0
    inputs: int = 0
    accepted: int = 0
    worst: float = 0.0
    growth: float = 0.0
    seconds: float = 0.0
    failures: list[tuple[str, bytes, str]] = field(default_factory=list)

    def count(self, kind: str) -> int:
        """Number of failures of a kind."""
        return sum(k == kind for k, _, _ in self.failures)

    @property
    def held(self) -> bool:
        """Whether nothing failed."""
        return not self.failures and self.growth < GROWTH


def feed(target: Target, data: bytes, outcome: Outcome) -> None:
    """One frame, and what became of it."""
    begun = time.process_time()
    signal.setitimer(signal.ITIMER_REAL, BRAKE)
    try:
        outcome.accepted += target.feed(data)
    except OutOfLimitsError as error:
        outcome.failures.append(("limits", data, str(error)))
    except Hang:
        outcome.failures.append(("hang", data, f"more than {BRAKE} s"))
    except Exception:
        outcome.failures.append(("crash", data, traceback.format_exc()))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    took = time.process_time() - begun
    outcome.inputs += 1
    outcome.frames += target.inside
    if outcome.inputs > 3:  # the first ones load and compile
        outcome.worst = max(outcome.worst, took)
        if took > LONGEST:
            outcome.failures.append(("hang", data, f"{took:.2f} s of computing"))


def fuzz(kind: type[Target], frames: int, seed: int, seconds: float = float("inf")) -> Outcome:
    """Up to ``frames`` frames for one target within ``seconds`` of computing; ends at the tenth
    failure.
    """
    outcome, rng = Outcome(kind.name), random.Random(f"{seed} {kind.name}")
    process, start = psutil.Process(), 0.0
    begun, until = time.process_time(), time.process_time() + seconds
    target = kind()
    try:
        while (
            outcome.frames < frames and time.process_time() < until and len(outcome.failures) < 10
        ):
            feed(target, target.make(rng), outcome)
            if outcome.inputs == WARM:
                start = process.memory_info().rss
            elif start and outcome.inputs % 500 == 0:
                outcome.growth = max(outcome.growth, process.memory_info().rss - start)
    finally:
        target.close()
    outcome.seconds = time.process_time() - begun
    return outcome


@contextmanager
def bounded() -> Iterator[None]:
    """Alarms raise Hang, and the address space ends: to ask for too much is a crash."""

    def ring(_: int, __: FrameType | None) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + ROOM, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGALRM, before)


def seeded_bug() -> mock._patch[object]:
    """The bounds of the serial protocol's numbers are not looked at."""

    def integers(line: Line, *bounds: tuple[int, int]) -> list[int]:
        if len(line.fields) != len(bounds):
            raise ValueError("fields")
        return [int(text) for text in line.fields]

    return mock.patch.object(Line, "integers", integers)


HEADER = (
    "target",
    "frames",
    "inputs",
    "accepted",
    "crashes",
    "hangs",
    "out of limits",
    "slowest",
    "growth",
    "frames/s",
)


def row(o: Outcome) -> str:
    """One line of the table."""
    failed = (o.count("crash"), o.count("hang"), o.count("limits"))
    cells = (o.name, o.frames, o.inputs, o.accepted, *failed)
    pace = f"{o.frames / o.seconds:.0f}" if o.seconds else ""
    measured = (f"{1e3 * o.worst:.0f} ms", f"{o.growth / 1e6:.0f} MB", pace)
    return table_row((*cells, *measured))


def heading(words: Sequence[str]) -> list[str]:
    """Title and head of the table."""
    command = shlex.join(["python", "benchmarks/fuzz.py", *words])
    return [
        "# Hostile input",
        "",
        f"`{command}`, Python {platform.python_version()}. Frames are mutated with correct"
        " checksums; an input is what a door is given at once: a frame, or a file with many"
        " (messages of a recording, cells of a table). Asked of each door: no crash, no input of"
        f" more than {LONGEST:g} s of computing, nothing accepted that is out of limits, no growth"
        f" of the process beyond {GROWTH / 1e6:.0f} MB. *frames/s* is per second of computing,"
        " making the frames included.",
        "",
        *table_head(HEADER),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--frames", type=int, help="of each target (default 20000, fewer of files)")
    parser.add_argument("--minutes", type=float, help="of computing, for all targets together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--target", choices=sorted(TARGETS), action="append")
    parser.add_argument("--save", type=Path, help="folder for the frames that failed")
    parser.add_argument("--out", type=Path, help="also write the table there")
    parser.add_argument("--seed-bug", action="store_true", help="take a check away first")
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(words)
    chosen = [TARGETS[name] for name in options.target or TARGETS]
    left = 60 * options.minutes if options.minutes else math.inf
    outcomes, lines = [], heading(_reproducible(words))
    print("\n".join(lines), flush=True)
    with bounded(), seeded_bug() if options.seed_bug else mock.MagicMock():
        for k, kind in enumerate(chosen):
            share = left / (len(chosen) - k)  # what a quick one leaves goes to the others
            usual = sys.maxsize if options.minutes else max(1, 20_000 // kind.cost)
            outcomes.append(fuzz(kind, options.frames or usual, options.seed, share))
            left -= outcomes[-1].seconds
            lines.append(row(outcomes[-1]))
            print(lines[-1], flush=True)
            if options.out is not None:
                options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    for outcome in outcomes:
        tell(outcome, options.save)
    return 0 if all(o.held for o in outcomes) else 1


def _reproducible(words: Sequence[str]) -> list[str]:
    """The command line without the folders, which say nothing about the figures."""
    kept = []
    for before, word in zip(["", *words], words, strict=False):
        if {before, word}.isdisjoint({"--save", "--out"}):
            kept.append(word)
    return kept


def tell(outcome: Outcome, folder: Path | None) -> None:
    """Every failure of a target; its frames are kept in ``folder``."""
    for k, (what, data, text) in enumerate(outcome.failures):
        print(f"\n{outcome.name}: {what}\n{data[:200]!r}\n{text}")
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{outcome.name}-{what}-{k}").write_bytes(data)


if __name__ == "__main__":
    sys.exit(main())
