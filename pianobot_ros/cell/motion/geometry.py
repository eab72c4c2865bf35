"""Geometry of hand and keyboard: where the fingertips are, and where the keys.

Frames (REP-103 axes): base and keyboard frame have x right along the keyboard, y forward to the key
hinges, z up; the wrist frame coincides with their orientation in the playing pose. Hand angles
follow "Data-driven Simulation Framework", II-A.
"""

from __future__ import annotations

import math
import os
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ConfigError, ScoreError, unknown_name
from pianobot_ros.cell.numbers.config import Section, SpringDamper, load_section, quantity

__all__ = [
    "FINGERS",
    "KEY_PRESET",
    "Finger",
    "Hand",
    "Keyboard",
    "finger_points",
    "fingertip",
    "hand",
    "is_black",
    "key_centre",
    "keyboard",
    "pivot_radius",
    "strike_point",
    "use_key_preset",
]

FINGERS = ("thumb", "index", "middle")
KEY_PRESET = "PIANOBOT_KEY_PRESET"
"""Name of the environment variable that chooses the key preset."""
_BLACK = frozenset({1, 3, 6, 8, 10})
_WHITE_INDEX = {0: 0, 2: 1, 4: 2, 5: 3, 7: 4, 9: 5, 11: 6}

# A hand and a keyboard fit into a metre: what does not is millimetres, as an angle beyond half a
# turn is degrees.
_LONGEST = 1.0  # m
Size = Annotated[float, Field(gt=0, le=_LONGEST)]
Offset = Annotated[float, Field(ge=-_LONGEST, le=_LONGEST)]
Angle = Annotated[float, Field(ge=-math.pi, le=math.pi)]


class Finger(Section):
    """One finger: base in the wrist frame, directions at rest, phalanges from the palm outwards."""

    base: tuple[Offset, Offset, Offset] = quantity("m")
    yaw: Angle = quantity("rad")
    pitch: Angle = quantity("rad")
    bends: tuple[Angle, ...] = quantity("rad")
    lengths: tuple[Size, ...] = quantity("m")
    radius: Size = quantity("m")

    @model_validator(mode="after")
    def _jointed(self) -> Finger:
        if len(self.bends) != len(self.lengths) - 1:
            raise ValueError(
                f"{len(self.lengths)} lengths and {len(self.bends)} bends: there is a bend between"
                " each two phalanges"
            )
        return self


class Palm(Section):
    """The palm as a box in the wrist frame."""

    size: tuple[Size, Size, Size] = quantity("m")
    centre: tuple[Offset, Offset, Offset] = quantity("m")


class FingerJoints(Section):
    """What all joints share; stiffness comes from the vacuum calibration."""

    damping: float = quantity("N*m*s/rad", low=0)
    abduction_ratio: float = quantity("1", low=0)


class Pad(SpringDamper):
    """The silicone pad under each fingertip: a spring and damper normal to the key."""

    mass: float = quantity("kg", low=0)
    friction: float = quantity("1", low=0)


class Hand(Section):
    """The soft hand (``config/hand.yaml``)."""

    density: float = quantity("kg/m^3", low=1)
    palm: Palm
    fingers: dict[str, Finger]
    joints: FingerJoints
    pad: Pad


class WhiteKeys(Section):
    """Dimensions of the white keys."""

    pitch: Size = quantity("m")
    width: Size = quantity("m")
    length: Size = quantity("m")
    pivot: Size = quantity("m")
    thickness: Size = quantity("m")


class BlackKeys(Section):
    """Dimensions of the black keys."""

    width: Size = quantity("m")
    front: Size = quantity("m")
    height: float = quantity("m", low=0, high=_LONGEST)


class Mechanism(Section):
    """The key as a hinge with spring, damper and two stops at ``reference_radius``.

    A stop of stiffness k and damping c that is pressed by x is a spring and damper, k x + c x',
    where ``felt_power`` is 1; above 1 it is felt by Hunt and Crossley (1975), as stiff and as lossy
    as that at ``felt_force`` f: k x (k x / f)^(power - 1) (1 + c x' / f). Neither pulls.
    """

    stiffness: float = quantity("N*m/rad", low=0)
    damping: float = quantity("N*m*s/rad", low=0)
    max_angle: float = quantity("rad", low=1e-3, high=1)
    stop_stiffness: float = quantity("N/m", low=0)
    stop_damping: float = quantity("N*s/m", low=0)
    rest_stiffness: float = quantity("N/m", low=1)
    rest_damping: float = quantity("N*s/m", low=0)
    felt_power: float = quantity("1", low=1.0, high=5.0)
    felt_force: float = quantity("N", low=0.1)
    moving_mass: float = quantity("kg", low=0)
    dry_friction: float = quantity("N", low=0)
    preload: float = quantity("N", low=0)
    reference_radius: Size = quantity("m")

    @property
    def added_inertia(self) -> float:
        """Inertia beside the key's own wood, kg m^2."""
        return self.moving_mass * self.reference_radius**2

    @property
    def friction_torque(self) -> float:
        """Dry friction at the hinge, N m."""
        return self.dry_friction * self.reference_radius

    @property
    def preload_torque(self) -> float:
        """Torque by which spring and weights press the key up at angle 0, N m."""
        return self.preload * self.reference_radius

    @property
    def rest_angle(self) -> float:
        """Angle at which a key coming up meets its rest stop, rad: so far above 0 that the stop
        bears the preload at 0, where the key rests.
        """
        force, soft = self.preload, self.felt_force
        pressed = (
            force if self.felt_power == 1.0 else soft * (force / soft) ** (1 / self.felt_power)
        )
        return pressed / self.rest_stiffness / self.reference_radius

    @property
    def felted(self) -> bool:
        """Whether the stops are felt and no springs."""
        return self.felt_power > 1.0

    @property
    def acts_by_steps(self) -> bool:
        """Whether there is something that MuJoCo has not and that acts in each step."""
        return self.felted or self.preload > 0.0


def _replaced(unit: str) -> Any:
    return Field(None, ge=0, json_schema_extra={"unit": unit})


class KeyPreset(Section):
    """What an instrument's keys have in place of :class:`Mechanism`'s numbers; None: the same."""

    stiffness: float | None = _replaced("N*m/rad")
    damping: float | None = _replaced("N*m*s/rad")
    felt_power: float | None = _replaced("1")
    moving_mass: float | None = _replaced("kg")
    dry_friction: float | None = _replaced("N")
    preload: float | None = _replaced("N")


class Midi(Section):
    """From key angle to MIDI (Fig. 2(c) and Eq. 2)."""

    trigger_on: float = quantity("rad", low=0)
    trigger_off: float = quantity("rad", low=0)
    velocity_gain: float = quantity("s/m", low=1)
    delay: float = quantity("s", low=0)


class StrikePoint(Section):
    """Where fingertips meet keys, from the white keys' front edge."""

    white: float = quantity("m", low=0)
    black: float = quantity("m", low=0)


class Keyboard(Section):
    """The keyboard (``config/keyboard.yaml``)."""

    origin: tuple[float, float, float] = quantity("m")
    first_note: int = quantity("1", low=0, high=116)
    white: WhiteKeys
    black: BlackKeys
    density: float = quantity("kg/m^3", low=1)
    mechanism: Mechanism
    preset: str
    presets: dict[str, KeyPreset]
    midi: Midi
    strike_point: StrikePoint

    @model_validator(mode="after")
    def _playable(self) -> Keyboard:
        """Numbers that are each fine and together make no key that sounds."""
        midi, white, black, at = self.midi, self.white, self.black, self.strike_point
        for wrong, reason in (
            (
                midi.trigger_on >= self.mechanism.max_angle,
                "midi.trigger_on is not below mechanism.max_angle: no key would sound",
            ),
            (
                midi.trigger_off > midi.trigger_on,
                "midi.trigger_off is above midi.trigger_on: a note would end before it begins",
            ),
            (white.width > white.pitch, "white.width is above white.pitch: keys overlap"),
            (
                self.mechanism.reference_radius > white.pivot,
                "mechanism.reference_radius is above white.pivot: it is before the key's front",
            ),
            (at.white >= white.pivot, "strike_point.white is behind the hinge (white.pivot)"),
            (at.black >= white.pivot, "strike_point.black is behind the hinge (white.pivot)"),
            (at.black < black.front, "strike_point.black is before the black keys (black.front)"),
        ):
            if wrong:
                raise ValueError(reason)
        return self

    def __hash__(self) -> int:
        """Of all numbers: keyboards are in keys of caches, and a table of presets has no hash."""
        own = {n: x for n, x in self if n != "presets"}
        return hash((*own.values(), *self.presets.items()))

    def with_keys(self, preset: str, **changed: float) -> Keyboard:
        """This keyboard with the keys of ``preset``, and ``changed`` numbers of their mechanism.
        Raises :class:`ConfigError` for a preset that is not there.
        """
        if preset not in self.presets:
            raise ConfigError(unknown_name("key preset", preset, self.presets))
        replaced = self.presets[preset].model_dump(exclude_none=True) | changed
        mechanism = self.mechanism.model_copy(update=replaced)
        return self.model_copy(update={"preset": preset, "mechanism": mechanism})

    @property
    def notes(self) -> tuple[int, ...]:
        """The MIDI note numbers of the twelve keys."""
        return tuple(range(self.first_note, self.first_note + 12))


@lru_cache(maxsize=8)
def hand(path: str = "hand.yaml") -> Hand:
    """The hand of the configuration in force."""
    return load_section(path, Hand)


@lru_cache(maxsize=8)
def keyboard(path: str = "keyboard.yaml") -> Keyboard:
    """The keyboard of the configuration in force, with the numbers of its key preset.

    The preset is that of :data:`KEY_PRESET` in the environment, else the file's. Raises
    :class:`ConfigError` for one that is not there.
    """
    board = load_section(path, Keyboard)
    return board.with_keys(os.environ.get(KEY_PRESET) or board.preset)


def use_key_preset(name: str) -> None:
    """Choose the keys of this process and of those that it starts, before anything is built of
    them. Raises :class:`ConfigError` for a preset that is not there.
    """
    before = os.environ.get(KEY_PRESET)
    os.environ[KEY_PRESET] = name
    keyboard.cache_clear()
    try:
        keyboard()
    except ConfigError:
        os.environ.pop(KEY_PRESET)
        if before is not None:
            os.environ[KEY_PRESET] = before
        raise


def is_black(note: int) -> bool:
    """Whether ``note`` is a black key."""
    return note % 12 in _BLACK


def finger_points(finger: Finger) -> Array:
    """Joint positions and fingertip of a finger at rest in the wrist frame, shape (phalanges + 1,
    3), m.

    Row 0 is the base (MCP joint), the last row the end of the last phalanx on its axis.
    """
    pitch = finger.pitch + np.concatenate([[0.0], np.cumsum(finger.bends)])
    heading = np.array([-np.sin(finger.yaw), np.cos(finger.yaw), 0.0])
    steps = np.outer(np.cos(pitch), heading) - np.outer(np.sin(pitch), [0.0, 0.0, 1.0])
    return np.vstack(
        [finger.base, finger.base + np.cumsum(steps * np.array(finger.lengths)[:, None], axis=0)]
    )


def fingertip(name: str, model: Hand | None = None) -> Array:
    """Lowest point of the fingertip ``name`` at rest in the wrist frame, shape (3,), m."""
    fingers = (model or hand()).fingers
    if name not in fingers:
        raise ScoreError(unknown_name("finger", name, fingers))
    finger = fingers[name]
    return np.asarray(finger_points(finger)[-1] - [0.0, 0.0, finger.radius])


def key_centre(note: int, board: Keyboard | None = None) -> float:
    """x of the middle of the key ``note`` in the base frame, m. Raises :class:`ScoreError` off the
    keyboard.
    """
    board = board or keyboard()
    if note not in board.notes:
        raise ScoreError(
            f"note {note} is not on the keyboard: it has the notes {board.notes[0]} to"
            f" {board.notes[-1]}"
        )
    step = (note - board.first_note) % 12
    whites = _WHITE_INDEX[step] + 0.5 if step in _WHITE_INDEX else _WHITE_INDEX[step - 1] + 1.0
    return board.origin[0] + whites * board.white.pitch


def strike_point(note: int, board: Keyboard | None = None) -> Array:
    """Where a fingertip meets the key ``note`` at rest, in the base frame, shape (3,), m."""
    board = board or keyboard()
    black = is_black(note)
    y = board.strike_point.black if black else board.strike_point.white
    z = board.black.height if black else 0.0
    return np.array([key_centre(note, board), board.origin[1] + y, board.origin[2] + z])


def pivot_radius(note: int, board: Keyboard | None = None) -> float:
    """Distance of the contact point from the key's hinge, r of Eq. 2, m."""
    board = board or keyboard()
    return board.white.pivot - (
        board.strike_point.black if is_black(note) else board.strike_point.white
    )
