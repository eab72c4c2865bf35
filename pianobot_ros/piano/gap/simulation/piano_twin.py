"""The piano cell as a twin of the diagnosis engine: what it predicts at each stage."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.gap import Block, Effect, Observable, Parameter, Signal
from pianobot_ros.gap.problem.types import Prediction
from pianobot_ros.piano.gap.effects import LIBRARY, library_without
from pianobot_ros.piano.gap.effects.base import mechanics
from pianobot_ros.piano.gap.evidence.blocks import prepare
from pianobot_ros.piano.gap.evidence.time_stamps import is_live, link_parameters, note_scatter
from pianobot_ros.piano.gap.simulation.corrections import (
    NOTHING,
    Corrections,
    corrected_nuisances,
    parse_corrections,
)
from pianobot_ros.piano.gap.simulation.description import (
    STAGES,
    StrikeBlock,
    features,
    is_judged,
    observables,
    with_data,
)
from pianobot_ros.piano.gap.simulation.prediction import (
    About,
    Predictor,
    scatter_places,
    start_times,
)
from pianobot_ros.piano.gap.simulation.rollouts import Rollouts
from pianobot_ros.piano.twin.reduced.splicing import Session

__all__ = ["PianoTwin"]


class PianoTwin:
    """Twin of recorded strikes. ``simulate`` works on the blocks that it made itself (``blocks``).

    Splicing: the wrist from its command; the pressure from its setpoint; the force from measured
    wrist and pressure with the key as measured (where an angle sensor is fitted: hand and contact
    alone) and with the key free; the key's angle from the measured force (key alone) and from the
    wrist; note events from the measured angle, else from measured force and wrist.
    """

    stages = STAGES

    def __init__(
        self,
        recordings: Sequence[Recording],
        *,
        strikes: int = 0,
        threads: int = 1,
        live: bool | None = None,
        without: Sequence[str] = (),
    ) -> None:
        """``without``: families that the library shall lack. ``live``: the stamps came over links,
        so each device's constant error is fitted too (``config/link.yaml``); None: as the
        recordings show. What the recordings say was adopted is part of this twin: its values are
        the nominal ones, and its effects are in every candidate.
        """
        live = any(is_live(r) for r in recordings) if live is None else live
        self.corrections = _adopted(recordings)
        blocks, data, self.sessions, self.warnings = prepare(recordings, strikes)
        self.blocks: tuple[StrikeBlock, ...] = tuple(with_data(b, data[b.name]) for b in blocks)
        self.threads = max(1, threads)
        self._pool: ThreadPoolExecutor | None = None
        self.rollouts = Rollouts(self.blocks)
        self.rig = any(b.data.angle is not None for b in self.blocks)
        self.sensor = any(b.data.reading is not None for b in self.blocks)
        scatter = note_scatter() if live else 0.0
        self.parameters: tuple[Parameter, ...] = corrected_nuisances(self.corrections) + (
            link_parameters() if live else ()
        )
        self._about = About(
            {p.name: p.nominal for p in self.parameters},
            start_times(self.blocks),
            self.rig,
            scatter,
            *scatter_places(self.blocks),
        )
        self.observables: tuple[Observable, ...] = tuple(
            observables(self.blocks, self.rig, self.sensor, scatter)
        )
        self.effects: tuple[Effect, ...] = tuple(
            e
            for e in library_without(without)
            if e.name not in self.corrections.effects and is_judged(e, self.blocks)
        )

    def features(self, block: Block) -> dict[str, Signal]:
        """What an unexplained residual may depend on."""
        return features(_own(block))

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[Prediction]:
        """Predict every block (see :class:`~pianobot_ros.gap.problem.types.Twin`)."""
        predictor = self._predictor(values, effects)
        strikes = [_own(b) for b in blocks]
        wrists = self._wrists(strikes, predictor)
        sessions = {id(b.data.session): b.data.session for b in strikes}
        pressures = {i: predictor.pressure(s) for i, s in sessions.items()}

        def one(block: StrikeBlock) -> Prediction:
            session = id(block.data.session)
            return predictor.predict(block, wrists[session], pressures[session])

        if self.threads == 1 or len(strikes) < 4:
            return [one(b) for b in strikes]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads)
        return list(self._pool.map(one, strikes))

    def whole_notes(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, float]]:
        """Events of each strike's note (see :class:`NoteSensor`) by the whole chain from the
        wrist's command on, as the live twin plays it; only the pressure is spliced in as measured.
        """
        predictor = self._predictor(values, effects)
        strikes = [_own(b) for b in blocks]
        wrists = self._wrists(strikes, predictor)
        return [predictor.whole_notes(b.data, wrists[id(b.data.session)]) for b in strikes]

    def _predictor(self, values: Mapping[str, float], effects: Sequence[str]) -> Predictor:
        """Predicts with the laws in force and every parameter's value."""
        active = [LIBRARY[name] for name in (*self.corrections.effects, *effects)]
        own = {p.name: p.nominal for e in active for p in e.parameters}
        full = self._about.nominal | own | dict(values)
        return Predictor(self._about, self.rollouts, full, active)

    def _wrists(
        self, strikes: Sequence[StrikeBlock], predictor: Predictor
    ) -> dict[int, Array | None]:
        """Predicted height of the wrist by session."""
        sessions = {id(b.data.session): b.data.session for b in strikes}
        contact = partial(self._contact, strikes)
        return {i: predictor.wrist(s, contact) for i, s in sessions.items()}

    def recentre(self, values: Mapping[str, float]) -> PianoTwin:
        """This twin with differences between repeats taken at these nuisance values (see
        :class:`~pianobot_ros.gap.problem.types.Twin`).
        """
        twin = copy.copy(self)
        adopted = [LIBRARY[name] for name in self.corrections.effects]
        numbers = mechanics(adopted, self._about.nominal | dict(values))
        twin.rollouts = self.rollouts.centred(numbers)
        return twin

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_pool": None}

    def _contact(self, blocks: Sequence[StrikeBlock], session: Session) -> Array:
        """Contact force on the session's grid: measured where it is, else of the nominal strike,
        N.
        """
        force = np.zeros(session.time.size)
        for data in dict.fromkeys(b.data for b in (*self.blocks, *blocks)):
            if data.session is session and data.nominal is not None:
                cut = session.slice(data.start, data.end)
                x = data.reading if data.reading is not None else data.nominal.force
                force[cut] += np.maximum(np.interp(session.time[cut], data.grid, x), 0.0)
        return force


def _adopted(recordings: Sequence[Recording]) -> Corrections:
    """What the twin had adopted in all of the recordings."""
    texts = {r.corrections for r in recordings}
    if len(texts) > 1:
        raise RecordingError(
            "the twin had adopted one thing in one recording and another in another: diagnose them"
            " one by one"
        )
    text = texts.pop() if texts else ""
    return parse_corrections(text, "what the twin had adopted") if text else NOTHING


def _own(block: Block) -> StrikeBlock:
    if not isinstance(block, StrikeBlock):
        raise TypeError(f"{block.name} is no strike of a piano twin: it has no data to simulate")
    return block
