"""What the twin predicts of one strike, with given values and effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TypeVar

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.gap import Effect, departures
from pianobot_ros.gap.problem.types import Prediction
from pianobot_ros.piano.gap.effects.base import (
    ClockLaw,
    PressureLaw,
    StrikeLaw,
    WristLaw,
    acting,
    mechanics,
)
from pianobot_ros.piano.gap.evidence.strike_data import StrikeData
from pianobot_ros.piano.gap.evidence.time_stamps import DeviceClock, stamp_parameter
from pianobot_ros.piano.gap.simulation.description import SCATTER, StrikeBlock
from pianobot_ros.piano.gap.simulation.force_sensor import ForceSensor
from pianobot_ros.piano.gap.simulation.note_events import (
    Keystrokes,
    NoteSensor,
    note_departures,
)
from pianobot_ros.piano.gap.simulation.resampling import sampled
from pianobot_ros.piano.gap.simulation.rollouts import Rollouts
from pianobot_ros.piano.twin.reduced.splicing import STEP, Session
from pianobot_ros.piano.twin.reduced.strike_model import GRID, Stroke

Law = TypeVar("Law")

__all__ = ["About", "Predictor", "scatter_places", "start_times"]


@dataclass(frozen=True)
class About:
    """What holds for all strikes of a twin.

    Attributes:
        nominal: the nuisances' nominal values by name.
        starts: by condition, when its strikes began, (n,) s.
        rig: whether a key's angle is measured.
        link_scatter: standard deviation of a note's delay over the links, s.
        places: by strike, its place (0 to 1) among all by how far its note is from its repeats'.
        repeats: strikes of a condition, typically.
    """

    nominal: dict[str, float]
    starts: dict[str, Array]
    rig: bool
    link_scatter: float
    places: dict[str, float]
    repeats: int


def scatter_places(blocks: Sequence[StrikeBlock]) -> tuple[dict[str, float], int]:
    """``places`` and ``repeats`` of :class:`About`."""
    own = {b.name: b.events["note.scatter"] for b in blocks if "note.scatter" in b.events}
    order = sorted(own, key=lambda name: own[name])
    sizes = list(Counter(b.condition for b in blocks if b.name in own).values())
    places = {name: (k + 0.5) / len(order) for k, name in enumerate(order)}
    return places, round(float(np.median(sizes))) if sizes else 3


def start_times(blocks: Sequence[StrikeBlock]) -> dict[str, Array]:
    """By condition, when its strikes began, (n,) s."""
    return {
        c: np.array([b.data.start for b in blocks if b.condition == c])
        for c in {b.condition for b in blocks}
    }


class Predictor:
    """Predicts strikes with the values ``full`` and these ``effects``."""

    def __init__(
        self, about: About, rollouts: Rollouts, full: Mapping[str, float], effects: list[Effect]
    ) -> None:
        self._about, self._rollouts, self._full, self._effects = about, rollouts, full, effects
        self._numbers = mechanics(effects, full)
        self._sensor, self._keys = ForceSensor(effects, full), NoteSensor(full, effects)
        self._clocks: dict[str, DeviceClock] = {}
        self._by_side: dict[float, Mapping[str, float]] = {}
        self._moved_apart: dict[str, Array] = {}

    def _acting(self, kind: type[Law]) -> list[Law]:
        return list(acting(self._effects, kind).values())

    def wrist(self, session: Session, contact: Callable[[Session], Array]) -> Array | None:
        """Predicted height of the wrist on the session's grid, (n,) m; ``contact``: the force on it
        there, N.
        """
        if session.wrist is None:
            return None
        z = session.wrist[:, 2]
        for law in self._acting(WristLaw):
            z = law.height(self._full, session.time, z, contact(session))
        return z

    def pressure(self, session: Session) -> Array | None:
        """Predicted pressure on the session's grid, (n, 3) Pa."""
        if session.setpoint is None:
            return None
        laws = self._acting(PressureLaw)
        if not laws:
            return session.setpoint
        columns = [np.ascontiguousarray(c) for c in session.setpoint.T]
        for law in laws:
            columns = [
                law.pressure(self._full, session.time, c) if np.all(np.isfinite(c)) else c
                for c in columns
            ]
        return np.column_stack(columns)

    def predict(
        self, block: StrikeBlock, wrist: Array | None, pressure: Array | None
    ) -> Prediction:
        """Predict one strike; ``wrist`` (n,) m and ``pressure`` (n, 3) Pa: as predicted on its
        session's grid.
        """
        out: dict[str, Array | float] = {}
        data, session = block.data, block.data.session
        # what is spliced in of the board's readings must be in its true place too
        board = self._clock("fsr")
        if wrist is not None and "wrist.z" in block.outputs:
            stamps = self._clock("wrist").true_time(block.outputs["wrist.z"].t)
            out["wrist.z"] = sampled(stamps, session.time[0], STEP, wrist)
        if pressure is not None and "pressure" in block.outputs:
            column = pressure[:, int(block.attributes["finger"])]
            stamps = self._clock("vacuum").true_time(block.outputs["pressure"].t)
            out["pressure"] = sampled(stamps, session.time[0], STEP, column)
        numbers = self._numbers_of(data)
        stroke = self._stroke(data, numbers, wrist)
        if "force" in block.outputs:
            stamps = board.true_time(block.outputs["force"].t)
            read = self._sensor.read(data, stroke.force)
            out["force"] = sampled(stamps, data.start, GRID, read)
            if data.angle is not None and data.given is not None:
                held = self._sensor.read(data, self._rollouts.held(data, numbers, board).force)
                out["force | key as measured"] = sampled(stamps, data.start, GRID, held)
        if "angle" in block.outputs:
            stamps = board.true_time(block.outputs["angle"].t)
            out["angle"] = sampled(stamps, data.start, GRID, stroke.angle)
            if data.reading is not None:
                driven = self._driven(data, numbers, board)
                out["angle | measured force"] = sampled(stamps, data.start, GRID, driven.angle)
        if block.events:
            out |= self._notes(data, stroke, numbers, board)
            out["note.scatter"] = self._scatter(block.name)
            if self._acting(ClockLaw):
                apart = self._apart(block)
                out["note.scatter"] = float(np.hypot(out["note.scatter"], apart))
        return out

    def whole_notes(self, data: StrikeData, wrist: Array | None) -> dict[str, float]:
        """Events of a strike's note by the whole chain from the wrist's command on, as the live
        twin plays it; only the pressure is spliced in as measured. ``wrist`` as in :meth:`predict`.
        """
        own = self._numbers_of(data)
        if wrist is None:
            return self._events(data, self._stroke(data, own, wrist))
        return self._events(data, self._moved(data, own, wrist))

    def _clock(self, device: str) -> DeviceClock:
        if device not in self._clocks:
            gained = sum(law.skew(self._full, device) for law in self._acting(ClockLaw))
            late = self._full.get(stamp_parameter(device), 0.0)
            self._clocks[device] = DeviceClock(late, gained)
        return self._clocks[device]

    def _numbers_of(self, data: StrikeData) -> Mapping[str, float]:
        """The mechanical numbers of a strike, whose stiffness may depend on the side from which the
        pressure was reached.
        """
        side = sum(law.side(self._full) for law in self._acting(StrikeLaw) if law.side)
        if not side:
            return self._numbers
        if data.side not in self._by_side:
            stiffness = self._numbers["joint_stiffness"] * (1.0 + side * data.side)
            self._by_side[data.side] = {**self._numbers, "joint_stiffness": stiffness}
        return self._by_side[data.side]

    def _apart(self, block: StrikeBlock) -> float:
        """How far clocks that run apart move a note's delay from its repeats', s."""
        times = self._about.starts.get(block.condition)
        if times is None or times.size < 3:
            return 0.0
        if block.condition not in self._moved_apart:
            offset = self._clock("fsr").true_time(times) - self._clock("midi").true_time(times)
            self._moved_apart[block.condition] = departures(offset)
        own = self._moved_apart[block.condition]
        return float(own[np.argmin(np.abs(times - block.data.start))])

    def _notes(
        self, data: StrikeData, stroke: Stroke, numbers: Mapping[str, float], board: DeviceClock
    ) -> dict[str, float]:
        out: dict[str, float] = {}
        if not self._about.rig:
            events = self._events(data, stroke)
            out |= events
            if data.reading is not None:
                found = self._events(data, self._driven(data, numbers, board))
                unstable = self._rollouts.unstable_by_force(data, self._about.nominal)
                out |= {f"{k} | measured force": v for k, v in found.items() if k not in unstable}
        elif data.motion is not None:
            keystrokes = partial(self._rollouts.keystrokes, data)
            events = self._events(data, data.motion, keystrokes)
            events["note.onset"] += board.shift(data.start)
            unstable = self._rollouts.unstable_by_angle(data, self._about.nominal)
            out |= {f"{k} | measured angle": v for k, v in events.items() if k not in unstable}
        else:
            events = self._events(data, stroke)
        out["note.count"] = events["note.count"]
        return out

    @cached_property
    def _departures(self) -> Array:
        """How far notes are from their repeats, s, in rising order."""
        about = self._about
        own = float(np.hypot(SCATTER if about.rig else 2 * SCATTER, about.link_scatter))
        return note_departures(own, about.repeats, self._full, self._effects)

    def _scatter(self, name: str) -> float:
        """How far a strike's note is from its repeats', s: which of them is far nobody can foresee,
        so its place among all is spliced in as measured; of a strike that was not, the mean.
        """
        place = self._about.places.get(name)
        if place is None:
            return float(np.mean(self._departures))
        return float(self._departures[int(place * self._departures.size)])

    def _events(
        self, data: StrikeData, stroke: Stroke, *keystrokes: Keystrokes
    ) -> dict[str, float]:
        return self._keys.events(stroke, data.mark.note, data.model.key.radius, *keystrokes)

    def _stroke(
        self, data: StrikeData, numbers: Mapping[str, float], wrist: Array | None
    ) -> Stroke:
        if data.given is not None:
            return self._rollouts.strike(data, numbers)
        assert wrist is not None  # not measured: it moves as predicted
        return self._moved(data, numbers, wrist)

    def _moved(self, data: StrikeData, numbers: Mapping[str, float], wrist: Array) -> Stroke:
        """The whole strike under a predicted height of the wrist."""
        assert data.session.wrist is not None
        cut = data.session.slice(data.start - 0.1, data.end + 0.1)
        moved = data.session.wrist[cut].copy()
        moved[:, 2] = wrist[cut]
        return self._rollouts.moved(data, numbers, data.session.time[cut], moved)

    def _driven(self, data: StrikeData, numbers: Mapping[str, float], board: DeviceClock) -> Stroke:
        """The key's motion by the measured force."""
        return self._rollouts.driven(data, numbers, self._sensor, board)
