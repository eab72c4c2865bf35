"""A process that hangs with Python's lock held ends all the same, as it was going to."""

from __future__ import annotations

import subprocess
import sys

import pytest

from pianobot_ros.testing import wait_for

HANGS = """
import ctypes
from pianobot_ros.cell.host.way_out import way_out
print("said")
with way_out({code}, 0.2):
    ctypes.PyDLL(None).pause()  # with the lock, until a signal comes
print("never")
"""
GOES_ON = """
import time
from pianobot_ros.cell.host.way_out import way_out
with way_out(9, 0.05):
    pass
print("in time", flush=True)
time.sleep(0.3)  # the limit passes
print("went on")
"""


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.skipif(sys.platform != "linux", reason="timers that start threads are Linux'")
@pytest.mark.parametrize("code", [0, 7])
def test_a_body_that_hangs_ends_the_process_with_the_code(code: int) -> None:
    done = run(HANGS.format(code=code))
    assert (done.returncode, done.stdout) == (code, "said\n"), done.stderr


def test_a_body_in_time_is_left_alone() -> None:
    runs: list[subprocess.CompletedProcess[str]] = []

    def in_time() -> bool:
        """A machine that holds it up within the body has it ended, as it should: once more."""
        runs.append(run(GOES_ON))
        return "in time" in runs[-1].stdout

    wait_for(in_time, lambda: f"a body in time: {runs}")
    done = runs[-1]
    assert (done.returncode, done.stdout) == (0, "in time\nwent on\n"), done.stderr
