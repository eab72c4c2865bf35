"""Notes and keystrokes from the angles of keys."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.piano.twin.stepping.key_trigger import KeyTrigger


def test_what_plays_while_time_is_lost_ends_without_a_keystroke() -> None:
    midi = keyboard().midi
    time = np.arange(0.0, 0.4, 1e-3)
    angle = 1.5 * midi.trigger_on * np.sin(np.pi * time / 0.4)[:, None]
    force = np.ones_like(angle)
    for torn in (False, True):
        trigger = KeyTrigger((64,), np.array([0.2]), midi)
        events, strokes = trigger.feed(time[:200], angle[:200], force[:200])
        assert [e.on for e in events] == [True] and strokes == []
        if torn:
            trigger.interrupt()
        events, strokes = trigger.feed(time[200:], angle[200:], force[200:])
        assert [e.on for e in events] == [False]
        assert len(strokes) == (0 if torn else 1)
        _, again = trigger.feed(time + 0.4, angle, force)
        assert len(again) == 1  # the next one is whole
