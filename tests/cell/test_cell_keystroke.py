from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.motion.geometry import Midi
from pianobot_ros.cell.recordings.keystroke import (
    Keystroke,
    NoteEvent,
    absolute_error,
    keystroke_error,
    keystrokes_from_angle,
    keystrokes_from_midi,
    match_keystrokes,
    midi_velocity,
)

MIDI = Midi(trigger_on=0.03, trigger_off=0.02, velocity_gain=270.0, delay=0.0)


@given(down=st.floats(0.2, 3.0), up=st.floats(0.2, 3.0), hold=st.floats(0.05, 1.0))
def test_ramps_give_their_own_slopes(down: float, up: float, hold: float) -> None:
    """A trapezoid of the angle has known trigger times and speeds (Eq. 2)."""
    top, radius = 0.045, 0.2
    corners = np.cumsum([0.1, top / down, hold, top / up, 0.1])
    time = np.linspace(0, corners[-1], 20001)
    angle = np.interp(time, corners[:-1], [0, top, top, 0])
    (stroke,) = keystrokes_from_angle(time, angle, 64, radius, MIDI)
    on = corners[0] + MIDI.trigger_on / down
    off = corners[2] + (top - MIDI.trigger_off) / up
    assert stroke.onset == pytest.approx(on, abs=1e-6)
    assert stroke.t_hold == pytest.approx(off - on, abs=1e-6)
    assert stroke.v_pre == pytest.approx(radius * down, rel=1e-6)
    assert stroke.v_rel == pytest.approx(radius * up, rel=1e-6)
    assert stroke.with_note_length(2.5).t_idle == pytest.approx(2.5 - stroke.t_hold)


def test_a_key_between_the_thresholds_neither_sounds_nor_ends() -> None:
    time = np.linspace(0, 1, 1001)
    angle = np.where(
        time < 0.2, 0.0, np.where(time < 0.5, 0.035, np.where(time < 0.7, 0.025, 0.035))
    )
    angle[time > 0.9] = 0.0
    assert len(keystrokes_from_angle(time, angle, 64, 0.2, MIDI)) == 1


def test_midi_pairs_in_order_and_ignores_a_lone_note_off() -> None:
    events = [
        NoteEvent(0.0, False, 60, 0),
        NoteEvent(1.0, True, 60, 54),
        NoteEvent(1.2, True, 64, 27),
        NoteEvent(1.5, False, 60, 27),
        NoteEvent(1.6, True, 64, 0),
    ]
    first, second = keystrokes_from_midi(events, MIDI)
    assert (first.note, first.t_hold, first.v_pre) == (60, pytest.approx(0.5), pytest.approx(0.2))
    assert (second.note, second.t_hold) == (64, pytest.approx(0.4))


def test_velocity_stays_a_midi_velocity() -> None:
    assert [midi_velocity(v, MIDI) for v in (0.0, 0.1, 10.0)] == [1, 27, 127]


def test_error_is_eq_5_by_hand() -> None:
    reference = Keystroke(64, 0.0, 0.20, 0.10, 0.5, 2.0)
    sim = Keystroke(64, 0.0, 0.22, 0.09, 0.6, 1.9)
    assert absolute_error(sim, reference) == pytest.approx((0.03, 0.2)), "Eq. 4 as printed"
    by_hand = 0.8 / 2 * (0.1 + 0.1) + 0.2 / 2 * (0.2 + 0.05)
    assert keystroke_error(sim, reference) == pytest.approx(by_hand)
    assert keystroke_error(sim, reference, t_idle=False) == pytest.approx(0.8 * 0.1 + 0.2 * 0.2)
    assert keystroke_error(reference, reference) == 0
    assert math.isnan(keystroke_error(sim, Keystroke(64, 0.0, 0.2, 0.1, 0.5)))


def test_matching_is_by_note_and_nearest_onset() -> None:
    real = [Keystroke(64, 1.0, 1, 1, 1), Keystroke(64, 2.0, 1, 1, 1), Keystroke(60, 1.0, 1, 1, 1)]
    sim = [Keystroke(64, 1.9, 1, 1, 1), Keystroke(64, 1.1, 1, 1, 1), Keystroke(62, 1.0, 1, 1, 1)]
    pairs = match_keystrokes(real, sim)
    onsets = [(r.onset if r else None, s.onset if s else None) for r, s in pairs]
    assert sorted(onsets, key=str) == sorted(
        [(1.0, 1.1), (2.0, 1.9), (1.0, None), (None, 1.0)], key=str
    )
