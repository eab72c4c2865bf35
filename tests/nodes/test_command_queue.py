"""What the twin's next stretch of steps has to obey, and where in it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.nodes.twin.command_queue import AT_ONCE, CommandQueue

STEP = 4e-4  # s
HOME = np.zeros(6)


def play(queue: CommandQueue, lengths: list[int]) -> tuple[list[float], list[tuple[int, int]]]:
    """The setpoint (its first number) at each step of wake-ups of so many steps, and at which step
    each call was made, by its number.
    """
    target, done, seen, called = HOME, 0, [], []
    for length in lengths:
        left = length
        while left:
            stretch = queue.take(done * STEP, STEP, left, target)
            called += [(done, call()) for call in stretch.calls]  # type: ignore[func-returns-value]
            seen += stretch.targets[:, 0].tolist()
            target, count = stretch.after, len(stretch.targets)
            done, left = done + count, left - count
    return seen, called


def number(k: int) -> Callable[[], int]:
    return lambda: k


@given(
    st.lists(st.tuples(st.integers(0, 100), st.booleans()), max_size=12),
    st.lists(st.integers(1, 40), min_size=5, max_size=5),
)
def test_each_command_is_obeyed_at_its_step_however_the_steps_are_cut(
    commands: list[tuple[int, bool]], lengths: list[int]
) -> None:
    queue = CommandQueue()
    for k, (at, call) in enumerate(commands, 1):
        queue.add(at * STEP, number(k) if call else np.full(6, float(k)))
    seen, called = play(queue, lengths)
    total = sum(lengths)
    order = sorted(enumerate(commands, 1), key=lambda item: item[1][0])
    wanted = np.zeros(total)
    for k, (at, call) in order:
        if not call:
            wanted[at:] = k
    assert seen == wanted.tolist()
    assert called == [(at, k) for k, (at, call) in order if call and at < total]


def test_setpoints_alone_do_not_cut_a_stretch() -> None:
    queue = CommandQueue()
    for k in (3, 9, 15):
        queue.add(k * STEP, np.full(6, float(k)))
    stretch = queue.take(0.0, STEP, 20, HOME)
    assert stretch.targets[:, 2].tolist() == [0.0] * 3 + [3.0] * 6 + [9.0] * 6 + [15.0] * 5


def test_a_setpoint_at_the_end_of_a_stretch_that_a_call_cuts_is_not_lost() -> None:
    queue = CommandQueue()
    queue.add(5 * STEP, np.ones(6))
    queue.add(5 * STEP, number(1))
    stretch = queue.take(0.0, STEP, 20, HOME)
    assert len(stretch.targets) == 5 and not stretch.targets.any() and stretch.after.all()
    assert [call() for call in queue.take(5 * STEP, STEP, 15, stretch.after).calls] == [1]  # type: ignore[func-returns-value]


def test_what_has_no_time_comes_at_once_and_nothing_stays_after_it_is_cleared() -> None:
    queue = CommandQueue()
    queue.add(AT_ONCE, np.ones(6))
    assert queue.take(100.0, STEP, 2, HOME).targets.all()
    queue.add(0.0, np.ones(6))
    queue.clear()
    assert not queue.take(100.0, STEP, 2, HOME).targets.any()
