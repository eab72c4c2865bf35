"""All signals of a recording's strikes as one
:class:`~pianobot_ros.piano.identify.cell.joint.FitProblem`.

A strike gives key angle and contact force over time where its key carries the sensors, and moment,
length, velocity and release velocity of its note. Stiffness is free at every vacuum level, the
levels between by interpolation, so that strikes with moving vacuum count too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import Midi
from pianobot_ros.piano.identify.cell.joint import Data
from pianobot_ros.piano.identify.priors import (
    CHANNELS,
    Prior,
    noise_floor,
    prior_of,
    priors,
    usual_misfit,
)
from pianobot_ros.piano.identify.takes.levels import BOTH_SIDES, Levels, level_name, side_name
from pianobot_ros.piano.identify.takes.missing import (
    NOT_MECHANICAL,
    ON_STIFFNESS,
    in_force,
    in_notes,
    share_of,
)
from pianobot_ros.piano.identify.takes.take import Take
from pianobot_ros.piano.twin.reduced.strike_model import GRID, Stroke

__all__ = ["PER_GROUP", "SENSED", "CellProblem", "TakeRows", "mechanics_of", "shifted"]


SPACING = 8  # of the grid: every eighth sample of angle and force is compared
WINDOW = 17  # grid points over which they are averaged first: a bounce is chaotic, its mean is not
TOGETHER = 0.25  # s over which what is left of angle and force hangs together
MECHANICS = ("joint_damping", "key_stiffness", "key_damping", "key_inertia", "pad_stiffness")
PER_GROUP = ("joint_stiffness", "loading_stiffness", "finger_stiffness")
SENSED = ("fsr_gain", "stamp_fsr")  # cannot matter where no key has sensors
STEP = 0.5  # standard deviations: step of a difference quotient, beyond the roughness of contact


@dataclass(frozen=True)
class TakeRows:
    """Where the samples of one take lie: ``first`` row; grid points ``angle`` and ``force`` (m,)
    that are compared; then four rows of its note.
    """

    first: int
    angle: NDArray[np.int64]
    force: NDArray[np.int64]

    @property
    def size(self) -> int:
        """Rows of the take."""
        return self.angle.size + self.force.size + 4

    def put(self, column: Array, source: TakeRows, change: Array) -> None:
        """Copy what changes at ``source`` to the rows of this take in a column (n,), whose grid may
        be a little longer.
        """
        at = self.first
        for own, other, begin in (
            (self.angle, source.angle, 0),
            (self.force, source.force, source.angle.size),
        ):
            count = min(own.size, other.size)
            column[at : at + count] = change[begin : begin + count]
            at += own.size
        column[at : at + 4] = change[-4:]


class CellProblem:
    """The strikes ``takes`` with the parameters that are not known.

    ``fixed`` holds values that are known (by name); ``whole`` predicts angle and force of takes on
    keys without sensors as well, to ask what a sensor would tell.
    """

    def __init__(
        self,
        takes: Sequence[Take],
        fixed: Sequence[str] = (),
        *,
        missing: bool = True,
        whole: bool = False,
    ) -> None:
        if not takes:
            raise PianobotError("there is no strike to identify anything from")
        self.takes = tuple(takes)
        self._whole = whole
        self.levels = Levels(takes)
        self.fingers = sorted({t.strike.finger for t in takes})
        self.parameters = self._parameters(frozenset(fixed))
        left_out = BOTH_SIDES if self.levels.two_sided else ""
        self.missing = tuple(p for p in priors() if missing and p.missing and p.name != left_out)
        self.names = [p.name for p in self.parameters]
        self.tolerance = np.array([p.tolerance / p.sd for p in self.parameters])
        self.layouts = self._layout()
        self.groups = self._groups()
        self.data = self._data()

    def _parameters(self, fixed: frozenset[str]) -> list[Prior]:
        stiffness, finger = prior_of("joint_stiffness"), prior_of("finger_stiffness")
        found = [replace(stiffness, name=level_name(p)) for p in self.levels.pressures]
        by_side = prior_of("loading_stiffness")
        found += [replace(by_side, name=side_name(p)) for p in self.levels.two_sided]
        if len(self.fingers) > 1:
            found += [replace(finger, name=f"finger_stiffness {f}") for f in self.fingers]
        for prior in priors():
            if prior.missing or prior.name in PER_GROUP:
                continue
            sensed = self._whole or any(t.angle.size or t.force.size for t in self.takes)
            if prior.name not in fixed and (sensed or prior.name not in SENSED):
                found.append(prior)
        return found

    def _layout(self) -> list[TakeRows]:
        found, first = [], 0
        for take in self.takes:
            points = np.arange(0, len(take.given.position), SPACING)
            none = points[:0]
            angle = points if take.angle.size or self._whole else none
            force = points if take.force.size or self._whole else none
            found.append(layout := TakeRows(first, angle, force))
            first += layout.size
        return found

    def _groups(self) -> list[int]:
        """Number of the condition of each take; its first take stands for all in derivatives."""
        names: dict[object, int] = {}
        found = []
        for i, take in enumerate(self.takes):
            s = take.strike
            key: object = (s.condition, s.finger, s.note) if s.condition else i
            found.append(names.setdefault(key, len(names)))
        return found

    def _data(self) -> Data:
        values, channels, groups, weights = [], [], [], []
        for take, layout, group in zip(self.takes, self.layouts, self.groups, strict=True):
            size = take.given.time.size
            angle, force = (
                averaged(x) if x.size else np.full(size, np.nan) for x in (take.angle, take.force)
            )
            values.append(
                np.concatenate([angle[layout.angle], force[layout.force], _notes_of(take)])
            )
            counts = (layout.angle.size, layout.force.size, 1, 1, 1, 1)
            channels.append(np.repeat(np.arange(6), counts))
            groups.append(np.full(layout.size, group))
            share = SPACING * GRID / TOGETHER
            weights.append(np.repeat([share, share, 1.0, 1.0, 1.0, 1.0], counts))
        floor = noise_floor()
        return Data(
            np.concatenate(values),
            np.concatenate(channels),
            np.concatenate(groups),
            np.concatenate(weights),
            np.array([floor[c] for c in CHANNELS]),
            np.array([usual_misfit().get(c, np.inf) for c in CHANNELS]),
            np.array([c not in ("angle", "force") for c in CHANNELS]),
        )

    # -- coordinates
    def values(self, x: Array) -> dict[str, float]:
        """Values by name at coordinates x (p,)."""
        return {p.name: p.value(float(u)) for p, u in zip(self.parameters, x, strict=True)}

    def start(self, factor: float = 1.0) -> Array:
        """Coordinates (p,) of the prior means, all stiffnesses times ``factor``."""
        levels = len(self.levels.pressures)
        free = [p.coordinate(factor) for p in self.parameters[:levels]]
        return np.array(free + [0.0] * (len(self.parameters) - levels))

    @cached_property
    def examples(self) -> list[int]:
        """The take that stands for each group."""
        return [self.groups.index(g) for g in range(max(self.groups) + 1)]

    # -- prediction
    def predict(self, x: Array) -> Array:
        """Predicted samples (n,) at coordinates x (p,)."""
        values = self.values(x)
        return np.concatenate([self._one(i, values, {}) for i in range(len(self.takes))])

    def slopes(self, x: Array) -> Array:
        """Derivative (n, p); by the first take of each condition, whose repeats differ little."""
        columns: list[tuple[dict[str, float], dict[str, float], float]] = []
        for j in range(len(x)):
            ahead = x.copy()
            ahead[j] += STEP
            columns.append((self.values(ahead), {}, 1.0 / STEP))
        return self._differences(self.values(x), columns)

    def signatures(self, x: Array) -> Array:
        """What one standard deviation of each missing effect adds, (n, q)."""
        values = self.values(x)
        return self._differences(
            values, [(values, {p.name: 0.5 * p.sd}, 2.0) for p in self.missing]
        )

    def _differences(
        self,
        values: dict[str, float],
        ahead: list[tuple[dict[str, float], dict[str, float], float]],
    ) -> Array:
        out = np.zeros((len(self.data.value), len(ahead)))
        for group, example in enumerate(self.examples):
            members = [i for i, g in enumerate(self.groups) if g == group]
            base = self._one(example, values, {})
            for j, (other, extra, scale) in enumerate(ahead):
                change = scale * (self._one(example, other, extra) - base)
                shared = [name for name in extra if name in ON_STIFFNESS]
                for i in members:
                    share = 1.0
                    for name in shared:
                        share = share_of(name, self.takes[i], self.levels.sides[i], self._span)
                    self.layouts[i].put(out[:, j], self.layouts[example], share * change)
        return out

    def _one(self, i: int, values: dict[str, float], effects: dict[str, float]) -> Array:
        """Predicted rows of take i."""
        take, layout = self.takes[i], self.layouts[i]
        stroke = self._stroke(i, values, effects)
        parts = []
        late = values.get("stamp_fsr", 0.0)
        if layout.angle.size or layout.force.size:
            time = stroke.time
            angle = np.interp(time[layout.angle] - late, time, averaged(stroke.angle))
            force = values.get("fsr_gain", 1.0) * np.maximum(stroke.force, 0.0)
            force = averaged(in_force(take, force, effects))
            parts = [angle, np.interp(time[layout.force] - late, time, force)]
        return np.concatenate([*parts, self._note(take, stroke, values, effects)])

    def _stroke(self, i: int, values: dict[str, float], effects: dict[str, float]) -> Stroke:
        take = self.takes[i]
        mechanics = mechanics_of(values) | {
            n: v for n, v in effects.items() if n not in NOT_MECHANICAL
        }
        factor = self.levels.factor(i, values)
        factor = factor * values.get(f"finger_stiffness {take.strike.finger}", 1.0)
        factor = factor * (1.0 + sum(effects.get(name, 0.0) for name in ON_STIFFNESS))
        given = replace(take.given, stiffness=np.ascontiguousarray(take.given.stiffness * factor))
        return take.model.strike(given, mechanics)

    @cached_property
    def _span(self) -> tuple[float, float]:
        starts = [t.strike.start for t in self.takes]
        return min(starts), max(max(starts) - min(starts), 1.0)

    def _note(
        self, take: Take, stroke: Stroke, values: dict[str, float], effects: dict[str, float]
    ) -> Array:
        midi = take.midi
        found = take.keystroke(stroke, shifted(midi, values))
        if found is None:
            return np.full(4, np.nan)
        gain = midi.velocity_gain * values.get("midi_velocity_gain", 1.0)
        offset = values.get("midi_velocity_offset", 0.0)
        onset = found.onset - take.given.start + midi.delay + values.get("stamp_midi", 0.0)
        row = np.array(
            [onset, found.t_hold, gain * found.v_pre + offset, gain * found.v_rel + offset]
        )
        return in_notes(row, effects)


def mechanics_of(values: Mapping[str, float]) -> dict[str, float]:
    """What of ``values`` are numbers of the strike model."""
    mechanics = {n: values[n] for n in MECHANICS if n in values}
    if drop := values.get("tip_height", 0.0):
        mechanics["tip_drop"] = drop
    return mechanics


def shifted(midi: Midi, values: Mapping[str, float]) -> Midi:
    """The instrument with the trigger angles of ``values``."""
    return midi.model_copy(
        update={n: getattr(midi, n) + values.get(n, 0.0) for n in ("trigger_on", "trigger_off")}
    )


def averaged(x: Array) -> Array:
    """Running mean (n,) over :data:`WINDOW` points."""
    half = WINDOW // 2
    total = np.cumsum(np.concatenate([[0.0], np.pad(x, half, mode="edge")]))
    return np.asarray((total[WINDOW:] - total[:-WINDOW]) / WINDOW)


def _notes_of(take: Take) -> Array:
    """Moment, length, velocity and release velocity of the note as measured, (4,); NaN where it did
    not sound or is not told.
    """
    reference = take.reference
    if reference is None:
        return np.full(4, np.nan)
    gain = take.midi.velocity_gain
    return np.array(
        [
            reference.onset - take.given.start,
            reference.t_hold,
            gain * reference.v_pre,
            gain * reference.v_rel,
        ]
    )
