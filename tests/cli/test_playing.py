"""``pianobot play`` as a client of a conductor: what ``--transpose`` plays, and that the conductor
is left as it was.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pianobot_msgs.action import PlayPhrase
from pianobot_msgs.msg import StrikeMark
from rclpy.action import ActionServer
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from standing_arm import standing_arm

from pianobot_ros.cell.errors import PianobotError, ScoreError
from pianobot_ros.cli.app import main
from pianobot_ros.cli.graph.phrase import played
from pianobot_ros.cli.graph.playing import play_score
from pianobot_ros.nodes.playing.conductor import Conductor
from pianobot_ros.nodes.watching.observer import Observer
from pianobot_ros.testing import wait_for

pytestmark = pytest.mark.graph
LIMIT = 60.0  # s to wait for the graph, on a busy machine


class Stage:
    """A conductor and an arm that says where it is, spun by a thread; the notes of the strikes that
    were announced.
    """

    def __init__(self, ros: Any) -> None:
        overrides = {"require": ["real"], "ready_timeout": LIMIT, "transpose": 1}
        self.conductor = ros.add(
            Conductor(
                context=ros.context,
                parameter_overrides=[Parameter(n, value=v) for n, v in overrides.items()],
            )
        )
        standing_arm(ros)
        self.marks: list[StrikeMark] = ros.record(StrikeMark, "/command/strike")
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin, args=(ros.executor,), daemon=True)
        self._thread.start()

    def _spin(self, executor: Any) -> None:
        while not self._closing.is_set():
            executor.spin_once(timeout_sec=0.02)

    def notes(self) -> list[int]:
        """Of the strikes, in order, each once."""
        return list(dict.fromkeys(m.note for m in list(self.marks)))

    def transpose(self) -> int:
        return int(self.conductor.get_parameter("transpose").value)

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        self.conductor.shut_down()


@pytest.fixture
def stage(ros: Any) -> Iterator[Stage]:
    made = Stage(ros)
    yield made
    made.close()


@pytest.fixture
def score(tmp_path: Path) -> str:
    path = tmp_path / "phrase.yaml"
    path.write_text(
        "strikes:\n  - {note: 62, speed: 0.2, depth: 0.014, hold: 0.05}\n", encoding="utf-8"
    )
    return str(path)


def test_notes_are_moved_and_the_conductor_is_left_as_it_was(stage: Stage, score: str) -> None:
    done = play_score(score, 2, 1.0, 1, LIMIT)
    assert done["strikes"] >= 1, "or more: one that a busy machine spoilt is played once more"
    wait_for(lambda: stage.notes() == [64], "the strike announced", LIMIT)
    assert stage.transpose() == 1
    play_score(score, 0, 1.0, 1, LIMIT)
    wait_for(lambda: len(stage.notes()) > 1, "the second strike announced", LIMIT)
    assert stage.notes() == [64, 63], "0 leaves the conductor's own transposition as it is"


def test_the_conductor_is_left_as_it_was_when_a_phrase_is_refused(stage: Stage, score: str) -> None:
    handle = stage.conductor
    handle.set_parameters([Parameter("ready_timeout", value=0.0)])
    handle._cells.require[:] = ["sim"]  # a cell that nobody plays
    with pytest.raises(PianobotError, match="sim"):
        play_score(score, 2, 1.0, 1, LIMIT)
    assert stage.transpose() == 1 and not stage.marks


def test_what_would_leave_the_keyboard_is_refused_before_anything_is_asked(
    score: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ScoreError, match="not on the keyboard"):
        play_score(score, 40, 1.0, 1, 1.0)
    assert main(["play", score, "--transpose", "40"]) == 2
    captured = capsys.readouterr()
    assert "102" in captured.err and captured.err.count("\n") == 1


def test_a_conductor_that_is_gone_takes_its_phrase_with_it(ros: Any) -> None:
    """Its successor knows nothing of the phrase, for which a client had waited on, ten minutes
    long in a demo.
    """
    over = threading.Event()

    def execute(handle: Any) -> PlayPhrase.Result:
        over.wait(LIMIT)
        return PlayPhrase.Result()

    node = Node("conductor", context=ros.context)
    server = ActionServer(node, PlayPhrase, "/play_phrase", execute)
    executor = SingleThreadedExecutor(context=ros.context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    observer = Observer(executor=ros.executor)
    phrase = 600.0  # s

    def wait(done: Callable[[], Any], limit: float, what: Callable[[], str]) -> None:
        if limit == phrase:  # it was accepted, and its result is waited for
            server.destroy()
        end = time.monotonic() + min(limit, LIMIT)
        while not done():
            if time.monotonic() > end:
                raise PianobotError(what())
            observer.spin(0.05)

    wait(observer.conductor_ready, LIMIT, lambda: "no server")
    with pytest.raises(PianobotError, match="the conductor ended"):
        played(observer, PlayPhrase.Goal(score="demo"), wait, phrase)
    observer.close()
    over.set()
    executor.shutdown(LIMIT)
