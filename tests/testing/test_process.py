"""What a test is told of a process that does not end."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from pianobot_ros.testing.running.process import Processes
from pianobot_ros.testing.waiting import wait_for

DEAF = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
def stands_here():
    print("deaf")
    time.sleep(600.0)
stands_here()
"""


def test_of_a_process_that_does_not_end_its_words_and_stacks_are_told(tmp_path: Path) -> None:
    with Processes(tmp_path) as processes:
        process = processes.start(sys.executable, "-c", DEAF, log="deaf")
        wait_for(lambda: "deaf" in process.output(), "it does not hear")
        with pytest.raises(AssertionError, match=r"did not end within 0\.1 s") as told:
            process.end(signal.SIGINT, 0.1)
        assert "in stands_here" in str(told.value)
        assert process.returncode == -signal.SIGABRT
