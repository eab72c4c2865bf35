"""The loop that keeps the twin on wall time, when the machine holds it up."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from pianobot_ros.nodes.twin import twin_loop
from pianobot_ros.nodes.twin.twin_loop import TwinLoop
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin, Samples
from pianobot_ros.testing.waiting import wait_for


class Heard:
    """What the loop gave to be published: its epoch, and where each stretch began, with what
    vacuum.
    """

    def __init__(self, twin: CellTwin) -> None:
        self.twin, self.epoch = twin, 0
        self.stretches: list[tuple[float, float]] = []
        self.epochs: list[int] = []  # of each stretch
        self.steps: list[tuple[float, float]] = []  # time and height that the wrist is told

    def publish(self, samples: Samples, epoch_ns: int, pace: Any, paused: bool) -> None:
        self.epoch = epoch_ns
        self.epochs.append(epoch_ns)
        self.stretches.append((float(samples.time[0]), float(self.twin.pressure[2])))
        self.steps += zip(samples.time.tolist(), samples.target[:, 2].tolist(), strict=True)

    def idle(self, pace: Any) -> None:
        pass


class Held:
    """A loop whose thread the test can hold up, as a busy machine does."""

    def __init__(self) -> None:
        self.twin = CellTwin()
        self.heard = Heard(self.twin)
        self.free = threading.Event()
        self.free.set()
        self.inside = threading.Event()
        self.errors: list[Exception] = []
        self.loop = TwinLoop(self.twin, self.heard, 0.004, self.errors.append, self._look)
        self.loop.start()
        wait_for(lambda: len(self.heard.stretches) > 5, "a running twin")

    def _look(self) -> None:
        if not self.free.is_set():
            self.inside.set()
            self.free.wait()

    def hold_up(
        self,
        seconds: float,
        meanwhile: Callable[[], Any] = lambda: None,
        at_last: Callable[[], Any] = lambda: None,
    ) -> None:
        """``meanwhile`` is called when the loop stands, ``at_last`` when it is far behind."""
        self.inside.clear()
        self.free.clear()
        self.inside.wait()
        until = time.monotonic() + seconds
        meanwhile()
        wait_for(lambda: time.monotonic() > until, "the machine")
        at_last()
        self.free.set()


@pytest.fixture
def held() -> Iterator[Held]:
    held = Held()
    yield held
    held.free.set()
    held.loop.stop()
    assert not held.errors


def test_a_twin_that_was_held_up_obeys_each_command_at_its_time(
    held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(twin_loop, "CATCH_UP", 60.0)  # the machine may hold it up longer still
    sent: dict[float, int] = {}

    def send(pressure: float, ahead: float = 0.0) -> None:
        sent[pressure] = time.time_ns() + round(1e9 * ahead)
        held.loop.command_vacuum({"middle": pressure}, sent[pressure])

    epoch, skips = held.heard.epoch, held.loop.skips
    held.hold_up(0.4, lambda: [send(-1e3 * k, 0.05 * k) for k in (1, 2, 3)])
    held.hold_up(0.4, lambda: send(-4e3), lambda: send(-5e3))
    wait_for(lambda: held.heard.stretches[-1][1] == -5e3, "the last command")
    assert (held.heard.epoch, held.loop.skips) == (epoch, skips)
    for pressure, stamp in sent.items():
        obeyed = next(t for t, p in held.heard.stretches if p == pressure)
        assert obeyed == pytest.approx(1e-9 * (stamp - epoch), abs=held.twin.cell.timestep)


def test_after_a_long_sleep_it_goes_on_from_now(
    held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(twin_loop, "CATCH_UP", 0.1)
    epoch, skips = held.heard.epoch, held.loop.skips
    held.hold_up(0.5)
    wait_for(lambda: held.heard.epoch > epoch + 4e8, "a stretch after the sleep")
    assert held.loop.health().values["skips"] > skips
    assert np.all(np.diff([t for t, _ in held.heard.stretches]) > 0)


def test_what_came_during_a_long_sleep_is_over_after_it(
    held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(twin_loop, "CATCH_UP", 0.1)

    def send(pressure: float) -> int:
        stamp = time.time_ns()
        held.loop.command_vacuum({"middle": pressure}, stamp)
        return stamp

    held.hold_up(0.5, lambda: send(-1e3), lambda: send(-2e3))
    wait_for(lambda: held.heard.stretches[-1][1] == -2e3, "the last command")
    monkeypatch.setattr(twin_loop, "CATCH_UP", 60.0)  # the machine may hold it up once more
    stamp = send(-3e3)
    wait_for(lambda: held.heard.stretches[-1][1] == -3e3, "what came afterwards")
    first = next(k for k, (_, p) in enumerate(held.heard.stretches) if p == -3e3)
    due = 1e-9 * (stamp - held.heard.epochs[first])
    assert held.heard.stretches[first][0] == pytest.approx(due, abs=held.twin.cell.timestep)
    assert [p for _, p in held.heard.stretches].count(-1e3) <= 1


def test_a_stream_of_setpoints_is_obeyed_step_by_step(
    held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(twin_loop, "CATCH_UP", 60.0)
    sent: dict[float, int] = {}

    def send() -> None:
        now, pose = time.time_ns(), held.twin.pose
        for k in range(1, 20):
            pose[2] += 1e-4
            sent[float(pose[2])] = now + 3_000_000 * k
            held.loop.command_wrist(pose, sent[float(pose[2])])

    epoch = held.heard.epoch
    held.hold_up(0.2, send)
    wait_for(lambda: held.heard.steps[-1][1] == max(sent), "the last setpoint")
    assert held.heard.epoch == epoch
    for height, stamp in sent.items():
        obeyed = next(t for t, z in held.heard.steps if z == height)
        assert obeyed == pytest.approx(1e-9 * (stamp - epoch), abs=held.twin.cell.timestep)
    assert np.all(np.diff([t for t, _ in held.heard.steps]) > 0)
