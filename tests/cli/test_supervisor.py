"""What the supervisor says of a node that has ended."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pianobot_ros.cli.graph.supervisor import Supervisor, _Running
from pianobot_ros.nodes.graph import NodeSpec
from pianobot_ros.testing import wait_for


@pytest.mark.parametrize(
    ("code", "writes", "said"),
    [
        (0, "", "recorder ended (exit code 0)"),
        (1, "", "recorder died (exit code 1)"),
        (1, "the disk is gone", "recorder died (exit code 1): the disk is gone"),
        (-9, "a warning long before", "recorder died (SIGKILL)"),
    ],
)
def test_a_death_is_explained_by_the_dead_process_own_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, writes: str, said: str
) -> None:
    messages: list[str] = []
    supervisor = Supervisor(tmp_path, messages.append)
    log = tmp_path / "log" / "recorder.log"
    log.write_text("a line of the process before\n", encoding="utf-8")
    begin = log.stat().st_size
    with log.open("a", encoding="utf-8") as file:
        file.write(writes)
    ending = f"import os; os.kill(os.getpid(), {-code})" if code < 0 else f"exit({code})"
    dead = subprocess.Popen([sys.executable, "-c", ending])
    dead.wait()
    supervisor._nodes["recorder"] = _Running(NodeSpec("recorder", "watching"), dead, begin)
    next_one = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        monkeypatch.setattr(supervisor, "_node", lambda _: (next_one, 0))
        supervisor.poll()
    finally:
        next_one.communicate(b"\n")
    assert messages[0] == said


def test_a_node_that_stands_still_is_named_killed_and_started_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages: list[str] = []
    supervisor = Supervisor(tmp_path, messages.append)
    idle = [sys.executable, "-c", "input()"]
    first, second = (subprocess.Popen(idle, stdin=subprocess.PIPE) for _ in range(2))
    try:
        supervisor._nodes["recorder"] = _Running(NodeSpec("recorder", "watching"), first)
        monkeypatch.setattr(supervisor, "_node", lambda _: (second, 0))
        supervisor.poll()
        assert not messages
        first.send_signal(signal.SIGSTOP)

        def restarted() -> bool:
            supervisor.poll()
            return "recorder restarted" in messages

        wait_for(restarted, "a new process")
    finally:
        for process in (first, second):
            process.kill()
            process.communicate()
    assert messages[0] == "recorder was stopped by a signal (SIGSTOP)"
    assert "recorder died (SIGKILL)" in messages
