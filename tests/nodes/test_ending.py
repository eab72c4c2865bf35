"""A node ends in order, and without a word, however often it is told to."""

from __future__ import annotations

import contextlib
import signal
import subprocess
from typing import Any

import pytest

pytestmark = pytest.mark.graph


def test_signals_after_the_first_are_ignored_without_a_word(ros: Any, processes: Any) -> None:
    node = processes.node("conductor")
    ros.wait_for(lambda: ros.tester.count_services("/conductor/get_parameters"), "the node")
    # As a terminal and a launcher do; the end takes longer than the first few of them.
    while node.poll() is None:
        for number in (signal.SIGINT, signal.SIGTERM):
            node.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            node.wait(0.02)
    assert node.returncode == 0
    said = [line for line in node.output().splitlines() if not line.startswith("[INFO]")]
    assert said == []
