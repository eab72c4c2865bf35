"""Rollouts of the reduced strike model, remembered by everything that they depend on."""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Midi
from pianobot_ros.cell.recordings.keystroke import Keystroke
from pianobot_ros.piano.gap.effects.base import shifted
from pianobot_ros.piano.gap.evidence.strike_data import StrikeData, quiet
from pianobot_ros.piano.gap.evidence.time_stamps import DeviceClock
from pianobot_ros.piano.gap.simulation.description import StrikeBlock
from pianobot_ros.piano.gap.simulation.force_sensor import ForceSensor
from pianobot_ros.piano.gap.simulation.note_events import NoteSensor
from pianobot_ros.piano.gap.simulation.resampling import moved_along
from pianobot_ros.piano.gap.simulation.shared_rollouts import SharedRollout, shared_rollouts
from pianobot_ros.piano.twin.reduced.strike_laws import HAND_ALONE, KEY_ALONE, NULLS
from pianobot_ros.piano.twin.reduced.strike_model import Stroke, key_strokes

__all__ = ["Rollouts"]


Store = OrderedDict[tuple[object, ...], dict[StrikeData, Stroke]]
EXACT = DeviceClock()
KEPT = 24  # sets of rollouts remembered, by kind
UNFELT: Mapping[str, frozenset[str]] = {
    "strike": frozenset(),
    "press": KEY_ALONE,
    "drive": HAND_ALONE,
}
"""By kind, the mechanical numbers without effect on a rollout."""
ENCODER_ERROR = (
    1e-4  # rad: a step of the key's encoder (567 counts/cm at the key's front) and its noise
)
ANGLE_LIMITS = {
    "note.onset": 1.2e-3,
    "note.hold": 1.6e-3,
    "note.velocity": 1.5,
    "note.release": 1.5,
}
FORCE_LIMITS = {"note.onset": 2.5e-3, "note.hold": 4e-3, "note.velocity": 3.0, "note.release": 4.0}


class Rollouts:
    """Rollouts of strikes, each made once for the same numbers.

    A rollout's key holds all mechanical numbers but those that
    ``piano/twin/reduced/strike_laws.py`` declares without effect on it (the hand on a key that
    moves as measured knows no law of the key, and the other way round). A number that
    is declared nowhere is in every key.
    """

    def __init__(self, blocks: Sequence[StrikeBlock]) -> None:
        data = {b.name: b.data for b in blocks}
        self.shared: dict[StrikeData, tuple[StrikeData, SharedRollout]] = {
            data[name]: (data[like.example], like)
            for name, like in shared_rollouts(data, blocks).items()
        }
        self._centre: Mapping[str, float] = dict(NULLS)
        self._strikes = len(blocks)
        self._reset()

    def _reset(self) -> None:
        self._central: defaultdict[str, Store] = defaultdict(OrderedDict)
        self._kept: defaultdict[str, Store] = defaultdict(OrderedDict)
        self._numbers: dict[str, tuple[Mapping[str, float], tuple[float, ...]]] = {}
        self._keystrokes: dict[tuple[StrikeData, float, float], list[Keystroke]] = {}
        self._unstable: dict[tuple[str, StrikeData], frozenset[str]] = {}

    def __getstate__(self) -> dict[str, object]:
        return {n: self.__dict__[n] for n in ("shared", "_centre", "_strikes")}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._reset()

    def centred(self, mechanics: Mapping[str, float]) -> Rollouts:
        """The same rollouts, with differences between repeats taken at ``mechanics``."""
        other = object.__new__(Rollouts)
        other.__dict__.update(self.__dict__)
        other._centre, other._central = dict(mechanics), defaultdict(OrderedDict)
        return other

    def _key(self, kind: str, mechanics: Mapping[str, float]) -> tuple[float, ...]:
        """The numbers that a kind of rollout depends on; all strikes of a prediction have the same
        ones, which are told by their identity.
        """
        known = self._numbers.get(kind)
        if known is None or known[0] is not mechanics:
            unfelt = UNFELT[kind]
            key = tuple(x for n, x in mechanics.items() if n not in unfelt)
            known = self._numbers[kind] = mechanics, key
        return known[1]

    def strike(self, data: StrikeData, mechanics: Mapping[str, float]) -> Stroke:
        """The whole strike under the measured wrist."""
        return self._by_example("strike", self._key("strike", mechanics), data, mechanics)

    def moved(
        self, data: StrikeData, mechanics: Mapping[str, float], time: Array, wrist: Array
    ) -> Stroke:
        """The whole strike under another motion of the wrist (n, 3) m at ``time`` (n,)."""
        key = (*self._key("strike", mechanics), wrist.tobytes())
        return _remembered(
            self._kept["strike"],
            key,
            data,
            lambda: data.model.strike(data.input(time, wrist), mechanics, data.resting),
        )

    def held(
        self, data: StrikeData, mechanics: Mapping[str, float], clock: DeviceClock = EXACT
    ) -> Stroke:
        """The hand alone on a key that moves as measured, by stamps of this ``clock``."""
        return self._by_example("press", self._key("press", mechanics), data, mechanics, clock)

    def driven(
        self,
        data: StrikeData,
        mechanics: Mapping[str, float],
        sensor: ForceSensor,
        clock: DeviceClock = EXACT,
    ) -> Stroke:
        """The key alone under the measured force, by stamps of this ``clock``, after the
        ``sensor``'s laws are undone and its gain is taken out.
        """
        assert data.reading is not None
        reading, lever = data.reading, data.lever - mechanics["tip_reach"]
        key = (*sensor.key, *self._key("drive", mechanics), clock)
        late = clock.shift(data.start)

        def drive() -> Stroke:
            force = shifted(data.grid, reading, late) if late else reading
            push = quiet(sensor.undone(data, force)) if late or sensor.bent else data.push
            assert push is not None
            force = push / sensor.gain
            return data.model.drive(data.start, force, lever, mechanics, data.resting)

        return _remembered(self._kept["drive"], key, data, drive)

    def keystrokes(
        self, data: StrikeData, motion: Stroke, note: int, radius: float, midi: Midi
    ) -> list[Keystroke]:
        """Keystrokes of a strike's measured motion: they depend on nothing but the triggers."""
        key = (data, midi.trigger_on, midi.trigger_off)
        if key not in self._keystrokes:
            while len(self._keystrokes) > 20 * self._strikes:
                self._keystrokes.pop(next(iter(self._keystrokes)))
            self._keystrokes[key] = key_strokes(motion, note, radius, midi)
        return self._keystrokes[key]

    def unstable_by_angle(self, data: StrikeData, values: Mapping[str, float]) -> frozenset[str]:
        """Events that cannot be predicted from the measured angle: the encoder's error moves them
        by more than is told apart, as where the key only just reaches the trigger and hovers there.

        ``values``: the twin's nominal parameters.
        """
        if ("angle", data) not in self._unstable:
            angle, rate = data.angle, data.rate
            assert angle is not None and rate is not None
            still = np.zeros_like(angle)
            strokes = [
                Stroke(data.start, angle + x, rate, still, still)
                for x in (-ENCODER_ERROR, ENCODER_ERROR)
            ]
            self._unstable["angle", data] = _unlike(strokes, data, values, ANGLE_LIMITS)
        return self._unstable["angle", data]

    def unstable_by_force(self, data: StrikeData, values: Mapping[str, float]) -> frozenset[str]:
        """Events that cannot be predicted from the measured force: 2 % more or less of it moves
        them by more than is told apart, as when a slow or shallow strike hardly reaches the
        trigger.

        ``values``: the twin's nominal parameters.
        """
        if ("force", data) not in self._unstable:
            assert data.reading is not None
            push = quiet(data.reading)
            strokes = [data.model.drive(data.start, push * x, data.lever) for x in (0.98, 1.02)]
            self._unstable["force", data] = _unlike(strokes, data, values, FORCE_LIMITS)
        return self._unstable["force", data]

    def _by_example(
        self,
        kind: str,
        key: tuple[object, ...],
        data: StrikeData,
        mechanics: Mapping[str, float],
        clock: DeviceClock = EXACT,
    ) -> Stroke:
        """The rollout of the strike's example among its repeats, plus what sets the strike apart
        from it at the centre (:meth:`centred`).

        Repeats have almost one input, so the difference between their rollouts hardly depends on
        the parameters (a control variate); this saves three rollouts of four where every condition
        is played four times. By a clock that gains, stamps of one time are in two places in two of
        them: that sets them apart, too.
        """

        def rolled(one: StrikeData) -> Stroke:
            late = clock.shift(one.start)
            make = partial(_roll, kind, one, mechanics, late)
            return _remembered(self._kept[kind], (*key, clock), one, make)

        found = self.shared.get(data)
        if found is None or (kind == "press" and (found[0].angle is None or data.angle is None)):
            return rolled(data)
        example, shared = found
        new = rolled(example)
        own = self._at_centre(kind, data, clock.gained, data.start - example.start)
        other, shift = self._at_centre(kind, example), shared.shift
        return Stroke(
            data.start,
            moved_along(own.angle, new.angle, other.angle, shift, -np.inf),
            moved_along(own.rate, new.rate, other.rate, shift, -np.inf),
            moved_along(own.force, new.force, other.force, shift, 0.0),
            own.lever,
        )

    def _at_centre(
        self, kind: str, data: StrikeData, gained: float = 0.0, later: float = 0.0
    ) -> Stroke:
        """The rollout at the centre, by a clock that has ``gained`` since ``later`` s ago."""
        make = partial(_roll, kind, data, self._centre, -gained * later)
        return _remembered(self._central[kind], (gained,), data, make)


def _remembered(
    store: Store, key: tuple[object, ...], data: StrikeData, make: Callable[[], Stroke]
) -> Stroke:
    kept = store.get(key)
    if kept is None:
        kept = store[key] = {}
        while len(store) > KEPT:
            store.popitem(last=False)
    stroke = kept.get(data)
    if stroke is None:
        stroke = kept[data] = make()
    return stroke


def _roll(kind: str, data: StrikeData, mechanics: Mapping[str, float], late: float = 0.0) -> Stroke:
    assert data.given is not None
    if kind == "strike":
        return data.model.strike(data.given, mechanics, data.resting)
    angle, rate = data.angle, data.rate
    assert angle is not None and rate is not None
    if late:
        angle, rate = shifted(data.grid, angle, late), shifted(data.grid, rate, late)
    return data.model.press(data.given, angle, rate, mechanics)


def _unlike(
    strokes: Sequence[Stroke],
    data: StrikeData,
    values: Mapping[str, float],
    limits: Mapping[str, float],
) -> frozenset[str]:
    """Events in which two rollouts differ by their limit or more."""
    keys = NoteSensor(values, [])
    a, b = (keys.events(s, data.mark.note, data.model.key.radius) for s in strokes)
    return frozenset(k for k, most in limits.items() if not abs(a[k] - b[k]) < most)
