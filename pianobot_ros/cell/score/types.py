"""What is to be played: strikes that one hand on one wrist can play, and when their keys sound."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.motion.geometry import Keyboard, keyboard, pivot_radius
from pianobot_ros.cell.motion.limits import WristLimits
from pianobot_ros.cell.motion.strike_motion import StrikeMotion

__all__ = [
    "MOST_STRIKES",
    "WINDOW_TAIL",
    "Score",
    "ScoreStrike",
    "check_strikes",
    "check_tempo",
    "hold_for",
    "motion_refusal",
    "onset_delay",
    "release_delay",
]

MOST_STRIKES = 10_000
"""A score has no more, repeats counted: the plan is computed as a whole before it is played."""
WINDOW_TAIL = 0.15  # s after the motion that still belong to a strike's window


@dataclass(frozen=True)
class ScoreStrike:
    """One downward motion of the wrist and the keys it plays.

    Attributes: ``fingers`` and ``notes`` side by side, one or two; ``motion`` the up and down;
    ``pressure`` of the striking fingers, Pa gauge; ``onset`` when the key is to sound, s from the
    start of the score, NaN: as soon as the previous note length is over; ``note_length`` T_N of Eq.
    2, s, 0: as short as the hand can; ``condition`` names like strikes; ``slide`` notes that a
    glissando passes while the finger is down, in order, the first being ``notes[0]``, and
    ``slide_time`` how long it takes, s.
    """

    fingers: tuple[str, ...]
    notes: tuple[int, ...]
    motion: StrikeMotion
    pressure: float
    condition: str
    note_length: float = 0.0
    onset: float = float("nan")
    slide: tuple[int, ...] = ()
    slide_time: float = 0.0

    @property
    def duration(self) -> float:
        """Whole motion, s."""
        return self.motion.duration + self.slide_time

    @property
    def name(self) -> str:
        """How messages call it."""
        return " and ".join(
            f"note {n} ({f})" for f, n in zip(self.fingers, self.notes, strict=True)
        )


@dataclass(frozen=True)
class Score:
    """A score: ``strikes`` in order, and one line for each note that was left out with the
    reason.
    """

    name: str
    strikes: tuple[ScoreStrike, ...]
    unreachable: tuple[str, ...] = field(default_factory=tuple)

    def repeated(self, times: int) -> Score:
        """The same score ``times`` times in a row; timed notes follow after the whole length.

        Raises :class:`ScoreError` if those are too many.
        """
        if times <= 1:
            return self
        check_strikes(times * len(self.strikes), self.name)
        timed = [s for s in self.strikes if not np.isnan(s.onset)]
        length = max((s.onset + max(s.note_length, s.duration) for s in timed), default=0.0) + 0.5
        parts = [replace(s, onset=s.onset + i * length) for i in range(times) for s in self.strikes]
        return replace(self, strikes=tuple(parts))

    @property
    def places(self) -> list[int]:
        """Place in ``strikes`` of each key struck, in the order in which a plan marks them."""
        return [i for i, s in enumerate(self.strikes) for _ in s.slide or s.notes]

    def again(self, places: Iterable[int]) -> Score:
        """The strikes at these places, each once and in order, without times of their own: to be
        played once more.
        """
        parts = [replace(self.strikes[i], onset=float("nan")) for i in sorted(set(places))]
        return replace(self, strikes=tuple(parts), unreachable=())


def check_strikes(count: int, where: str) -> None:
    """Raise :class:`ScoreError` if a score would have too many strikes."""
    if count > MOST_STRIKES:
        raise ScoreError(
            f"{where}: {count} strikes are too many, a score has at most {MOST_STRIKES}: fewer"
            " repeats?"
        )


def check_tempo(tempo: float) -> None:
    """Raise :class:`ScoreError` unless ``tempo`` is a sane factor."""
    if not 0.1 <= tempo <= 10:
        raise ScoreError(f"tempo {tempo:g} is not a factor between 0.1 and 10")


def onset_delay(motion: StrikeMotion, note: int, board: Keyboard | None = None) -> float:
    """Time from the start of the motion until the commanded fingertip passes the trigger, s (finger
    taken as rigid).
    """
    board = board or keyboard()
    depth = board.midi.trigger_on * pivot_radius(note, board)
    return motion.down_time * _cosine_phase((motion.clearance + depth) / motion.amplitude)


def release_delay(motion: StrikeMotion, note: int, board: Keyboard | None = None) -> float:
    """Time from the start of the way up until the commanded fingertip passes the release trigger,
    s.
    """
    board = board or keyboard()
    depth = board.midi.trigger_off * pivot_radius(note, board)
    return motion.up_time * _cosine_phase((motion.depth - depth) / motion.amplitude)


def hold_for(motion: StrikeMotion, note: int, t_hold: float, least: float = 0.02) -> float:
    """Time at the bottom that gives a key hold of about ``t_hold`` s, at least ``least``."""
    return max(
        t_hold - (motion.down_time - onset_delay(motion, note)) - release_delay(motion, note),
        least,
    )


def _cosine_phase(fraction: float) -> float:
    """Fraction of the time at which half a cosine has covered ``fraction`` of its way."""
    return float(np.arccos(1.0 - 2.0 * np.clip(fraction, 0.0, 1.0)) / np.pi)


def motion_refusal(motion: StrikeMotion, limits: WristLimits) -> str:
    """Why the arm may not do this motion, or an empty string."""
    speed, fastest = max(motion.speed, motion.release_speed), limits.fastest(motion.amplitude)
    if speed > limits.speed:
        return f"{speed:g} m/s is too fast: the arm's limit is {limits.speed:g} m/s"
    if speed > fastest:
        needed = 2 * speed**2 / motion.amplitude
        return (
            f"{speed:g} m/s over {1e3 * motion.amplitude:.0f} mm needs {needed:.0f} m/s^2, the"
            f" arm's limit is {limits.acceleration:g}: at most {np.floor(100 * fastest) / 100:g}"
            " m/s, or more depth"
        )
    return ""
