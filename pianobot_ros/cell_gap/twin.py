"""The piano cell as a twin of the diagnosis engine: what it predicts at each stage, its nuisances, its library of effects."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.geometry import Midi
from pianobot_ros.cell.keystroke import Keystroke
from pianobot_ros.cell.recording import Recording
from pianobot_ros.cell_gap.blocks import StrikeData, prepare, quiet
from pianobot_ros.cell_gap.effects import LIBRARY, Family
from pianobot_ros.cell_gap.effects.base import shifted
from pianobot_ros.cell_gap.likeness import likenesses
from pianobot_ros.cell_gap.link import is_live, link_parameters, note_scatter, stamp_parameter
from pianobot_ros.cell_gap.midi import note_events
from pianobot_ros.gap import Block, Effect, Observable, Parameter, Signal, Stage
from pianobot_ros.gap.types import Prediction
from pianobot_ros.twin.session import Session
from pianobot_ros.twin.strike import Stroke, key_strokes
from pianobot_ros.twin.strike_laws import NULLS

__all__ = ["PianoTwin"]

Array = NDArray[np.float64]

PRECISION = 0.003  # of a signal's spread: what the reduced model may be wrong by (0.1 % against another implementation)
SPLICED = 0.005  # likewise where the key moves as measured: the encoder's noise passes through a stiff contact
DRIVEN = 0.008  # likewise where the key moves under the measured force, which is sampled too rarely for the first touch
SCATTER = 3e-4  # s: what the moment of a note scatters by for reasons of measurement alone
ENCODER_ERROR = 1e-4  # rad: a step of the key's encoder (567 counts/cm at the key's front) and its noise
KEPT = 24  # sets of rollouts remembered, by kind
_HAND = (
    "joint_stiffness", "joint_damping", "joint_friction", "joint_friction_static", "joint_friction_rest", "joint_backlash",
    "joint_hardening", "joint_hardening_power", "jamming_hysteresis", "jamming_yield", "joint_creep", "joint_creep_time",
    "pad_stiffness", "pad_softening", "tip_slip", "tip_slip_weakening", "tip_drop", "tip_reach",
)  # fmt: skip
_KEY = (
    "key_stiffness", "key_damping", "key_inertia", "key_friction", "key_friction_static", "key_preload", "hammer",
    "hammer_coupling", "hammer_weight", "hammer_escape", "let_off", "let_off_angle", "let_off_width", "felt_exponent",
    "felt_thickness", "tip_reach",
)  # fmt: skip


class PianoTwin:
    """Twin of recorded strikes. ``simulate`` works on the blocks that it made itself (``blocks``).

    Splicing: the wrist from its command; the pressure from its setpoint; the force from measured wrist and pressure with the
    key as measured (where an angle sensor is fitted: hand and contact alone) and with the key free; the key's angle from the
    measured force (key alone) and from the wrist; note events from the measured angle, else from measured force and wrist.
    """

    stages = (
        Stage("wrist", "arm and servo: command to wrist motion"), Stage("pneumatics", "vacuum setpoint to pressure"),
        Stage("hand", "finger joints"), Stage("contact", "fingertip on key"), Stage("key", "key and action"),
        Stage("sensing", "force sensor, key contacts and MIDI"), Stage("clock", "time stamps"),
    )  # fmt: skip

    def __init__(
        self, recordings: Sequence[Recording], *, strikes: int = 0, threads: int = 1, live: bool | None = None
    ) -> None:
        """``live``: the stamps came over links, so each device's constant error is fitted too (``config/link.yaml``); None: as
        the recordings show.
        """
        live = any(is_live(r) for r in recordings) if live is None else live
        blocks, self.data, self.sessions, self.warnings = prepare(recordings, strikes)
        self.blocks: tuple[Block, ...] = tuple(blocks)
        self.threads = max(1, threads)
        self._pool: ThreadPoolExecutor | None = None
        self._repeats = {c: np.array([self.data[b.name].start for b in self.blocks if b.condition == c])
                         for c in {b.condition for b in self.blocks}}  # fmt: skip
        self._likeness = likenesses(self.data, self.blocks)
        self._centre: dict[str, float] = dict(NULLS)
        self._central: dict[str, dict[str, Stroke]] = {}
        self._keystrokes: dict[tuple[str, float, float], list[Keystroke]] = {}
        self._unstable: dict[str, frozenset[str]] = {}
        self._kept: dict[str, OrderedDict[tuple[object, ...], dict[str, Stroke]]] = {}
        self.rig = any(d.angle is not None for d in self.data.values())
        self.sensor = any(d.reading is not None for d in self.data.values())
        self._link_scatter = note_scatter() if live else 0.0
        self.parameters: tuple[Parameter, ...] = _nuisances() + (link_parameters() if live else ())
        self.observables: tuple[Observable, ...] = tuple(self._observables())
        self.effects: tuple[Effect, ...] = tuple(f.effect for f in LIBRARY.values() if self._judged(f))

    # -- description ----------------------------------------------------------------------------------------------------
    def _observables(self) -> list[Observable]:
        out = [Observable("wrist.z", "wrist", "wrist.z", "m", tolerance=5e-6),
               Observable("pressure", "pneumatics", "pressure", "Pa", tolerance=20.0)]  # fmt: skip
        force, angle = self._spread("force"), self._spread("angle")
        if self.rig and self.sensor:
            out.append(
                Observable("force | key as measured", "hand", "force", "N", mode="inverse", tolerance=SPLICED * force)
            )
            out.append(Observable("angle | measured force", "key", "angle", "rad", tolerance=DRIVEN * angle))
        if self.sensor:
            out.append(Observable("force", "contact", "force", "N", tolerance=PRECISION * force))
        if self.rig:
            out.append(Observable("angle", "key", "angle", "rad", tolerance=PRECISION * angle))
        source = " | measured angle" if self.rig else ""
        stage = "sensing" if self.rig else "key"
        out += _note_observables(source, stage)
        if self.sensor and not self.rig:
            out += _note_observables(" | measured force", "key")
        out.append(Observable("note.count", "sensing", "note.count", "1", "event", floor_hint=0.1))
        out.append(
            Observable(
                "note.scatter",
                "sensing",
                "note.scatter",
                "s",
                "event",
                floor_hint=2e-4,
                tolerance=0.6 * float(np.hypot(SCATTER if self.rig else 2 * SCATTER, self._link_scatter)),
            )
        )
        return out

    def _spread(self, signal: str) -> float:
        values = [b.outputs[signal].y for b in self.blocks if signal in b.outputs]
        return float(np.std(np.concatenate(values))) if values else 1.0

    def _judged(self, family: Family) -> bool:
        """Whether anything was recorded in which the family could show."""
        signals = {s for b in self.blocks for s in b.outputs}
        events = {e for b in self.blocks for e in b.events}
        if family.wrist:
            return "wrist.z" in signals or bool(events)
        if family.pressure:
            return "pressure" in signals
        if family.read:
            return "force" in signals
        if family.jitter:
            return "note.scatter" in events
        if family.velocity or family.triggers or family.note_delay:
            return bool(events)
        return True

    def features(self, block: Block) -> dict[str, Signal]:
        """What an unexplained residual may depend on."""
        data = self.data[block.name]
        t = data.grid
        stroke = data.nominal
        out = {"time in the strike": Signal(t, t - t[0], "s"), "time in the session": Signal(t, t, "s")}
        if stroke is not None:
            angle = data.angle if data.angle is not None else stroke.angle
            rate = data.rate if data.rate is not None else stroke.rate
            force = data.reading if data.reading is not None else stroke.force
            out |= {"key angle": Signal(t, angle, "rad"), "key speed": Signal(t, rate, "rad/s"),
                    "contact force": Signal(t, force, "N")}  # fmt: skip
        if data.given is not None:
            out["wrist height"] = Signal(t, data.given.position[:, 2], "m")
            out["wrist speed"] = Signal(t, data.given.velocity[:, 2], "m/s")
        out["pressure"] = Signal(t, np.broadcast_to(np.asarray(data.pressure, dtype=float), t.shape), "Pa")
        return out

    # -- simulation -----------------------------------------------------------------------------------------------------
    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[Prediction]:
        """Predict every block (see :class:`~pianobot_ros.gap.types.Twin`)."""
        laws = [LIBRARY[name] for name in effects]
        full = {p.name: p.nominal for p in self.parameters} | {
            p.name: p.nominal for law in laws for p in law.effect.parameters
        } | dict(values)  # fmt: skip
        mechanics = _plain_mechanics(full)
        for law in laws:
            if law.mechanics:  # two laws may move one number
                mechanics |= {name: mechanics[name] + x - NULLS[name] for name, x in law.mechanics(full).items()}
        sessions = {self.data[b.name].session.index: self.data[b.name].session for b in blocks}
        wrists = {i: self._wrist(s, full, laws) for i, s in sessions.items()}
        pressures = {i: self._pressure(s, full, laws) for i, s in sessions.items()}

        def one(block: Block) -> Prediction:
            data = self.data[block.name]
            return self._predict(
                block, data, full, laws, mechanics, wrists[data.session.index], pressures[data.session.index]
            )

        if self.threads == 1 or len(blocks) < 4:
            return [one(b) for b in blocks]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads)
        return list(self._pool.map(one, blocks))

    def recentre(self, values: Mapping[str, float]) -> None:
        """Take differences between repeats at these nuisance values from now on (see :class:`~pianobot_ros.gap.types.Twin`)."""
        self._centre = _plain_mechanics({p.name: p.nominal for p in self.parameters} | dict(values))
        self._central = {}

    def adopt(self, block: Block, data: StrikeData) -> None:
        """Learn to simulate another block, for example a proposed strike. It does not join ``blocks``."""
        if data.session not in self.sessions:
            data.session.index = len(self.sessions)
            self.sessions.append(data.session)
        self.data[block.name] = data

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_pool": None, "_kept": {}, "_central": {}, "_keystrokes": {}}

    def _wrist(self, session: Session, full: Mapping[str, float], laws: list[Family]) -> Array | None:
        """Predicted height of the wrist on the session's grid."""
        if session.wrist is None:
            return None
        z = session.wrist[:, 2]
        for law in laws:
            if law.wrist:
                z = law.wrist(full, session.time, z, self._contact(session))
        return z

    def _pressure(self, session: Session, full: Mapping[str, float], laws: list[Family]) -> Array | None:
        if session.setpoint is None:
            return None
        if not any(law.pressure for law in laws):
            return session.setpoint
        columns = [np.ascontiguousarray(c) for c in session.setpoint.T]
        for law in laws:
            if law.pressure:
                columns = [law.pressure(full, session.time, c) if np.all(np.isfinite(c)) else c for c in columns]
        return np.column_stack(columns)

    def _contact(self, session: Session) -> Array:
        """Contact force on the session's grid: measured where it is, else of the nominal strike, N."""
        force = np.zeros(session.time.size)
        for data in self.data.values():
            if data.session is session and data.nominal is not None:
                cut = session.slice(data.start, data.end)
                x = data.reading if data.reading is not None else data.nominal.force
                force[cut] += np.maximum(np.interp(session.time[cut], data.grid, x), 0.0)
        return force

    def _predict(self, block: Block, data: StrikeData, full: Mapping[str, float], laws: list[Family],
                 mechanics: Mapping[str, float], wrist: Array | None, pressure: Array | None) -> Prediction:  # fmt: skip
        out: dict[str, Array | float] = {}

        def true_time(t: Array, device: str) -> Array:
            t = t - full.get(stamp_parameter(device), 0.0)
            for law in laws:
                if law.clock:
                    t = law.clock(full, t, device)
            return t

        def read(force: Array) -> Array:
            x = full["fsr_gain"] * force
            for law in laws:
                if law.read:
                    x = law.read(full, data.grid, x)
            return x

        session = data.session
        # how much later than its stamps the board's readings are: what is spliced in must be in its true place too
        late = float(true_time(np.array([data.start]), "fsr")[0]) - data.start
        if wrist is not None and "wrist.z" in block.outputs:
            out["wrist.z"] = np.interp(true_time(block.outputs["wrist.z"].t, "wrist"), session.time, wrist)
        if pressure is not None and "pressure" in block.outputs:
            column = pressure[:, int(block.attributes["finger"])]
            out["pressure"] = np.interp(true_time(block.outputs["pressure"].t, "vacuum"), session.time, column)
        if side := sum(law.side(full) for law in laws if law.side):
            mechanics = {**mechanics, "joint_stiffness": mechanics["joint_stiffness"] * (1.0 + side * data.side)}
        stroke = self._stroke(data, mechanics, wrist)
        if "force" in block.outputs:
            stamps = true_time(block.outputs["force"].t, "fsr")
            out["force"] = np.interp(stamps, data.grid, read(stroke.force))
            if data.angle is not None and data.given is not None:
                held = self._held(data, mechanics, late)
                out["force | key as measured"] = np.interp(stamps, data.grid, read(held.force))
        if "angle" in block.outputs:
            stamps = true_time(block.outputs["angle"].t, "fsr")
            out["angle"] = np.interp(stamps, data.grid, stroke.angle)
            if data.reading is not None:
                driven = self._driven(data, mechanics, full, laws, late)
                out["angle | measured force"] = np.interp(stamps, data.grid, driven.angle)
        if block.events:
            out |= self._notes(block, data, stroke, full, laws, mechanics, late)
            if any(law.clock for law in laws):
                apart = self._apart(block, lambda t: true_time(t, "fsr") - true_time(t, "midi"))
                out["note.scatter"] = float(np.hypot(out["note.scatter"], apart))
        return out

    def _apart(self, block: Block, offset: Callable[[Array], Array]) -> float:
        """How far clocks that run apart move a note's delay from its repeats', s; ``offset``: between stamps at times (n,) s."""
        times = self._repeats.get(block.condition)
        if times is None or times.size < 3:
            return 0.0
        own, all_of_them = offset(np.array([self.data[block.name].start])), offset(times)
        return float(abs(own[0] - all_of_them.mean()) * np.sqrt(times.size / (times.size - 1)))

    def _notes(self, block: Block, data: StrikeData, stroke: Stroke, full: Mapping[str, float], laws: list[Family],
               mechanics: Mapping[str, float], late: float) -> dict[str, float]:  # fmt: skip
        out: dict[str, float] = {}
        note, radius = data.mark.note, data.model.key.radius
        if self.rig:
            if data.motion is not None:
                events = note_events(
                    data.motion, note, radius, full, laws, partial(self._measured_keystrokes, data.name)
                )
                events["note.onset"] += late
                shaky = self._shaky_angle(data)
                out |= {f"{k} | measured angle": v for k, v in events.items() if k not in shaky}
            else:
                events = note_events(stroke, note, radius, full, laws)
        else:
            events = note_events(stroke, note, radius, full, laws)
            out |= events
            if data.reading is not None:
                driven = self._driven(data, mechanics, full, laws, late)
                found = note_events(driven, note, radius, full, laws)
                shaky = self._shaky(data)
                out |= {f"{k} | measured force": v for k, v in found.items() if k not in shaky}
        out["note.count"] = events["note.count"]
        jitter = [law.jitter(full) for law in laws if law.jitter]
        own = np.hypot(SCATTER if data.angle is not None else 2 * SCATTER, self._link_scatter)
        scatter = float(np.hypot(own, sum(jitter)))
        out["note.scatter"] = 0.8 * scatter
        return out

    # -- rollouts, remembered by the numbers that they depend on ----------------------------------------------------------
    def _stroke(self, data: StrikeData, mechanics: Mapping[str, float], wrist: Array | None) -> Stroke:
        if data.given is not None:
            return self._by_likeness("strike", tuple(mechanics.values()), data, mechanics)
        # the wrist was not measured: it moves as predicted
        assert wrist is not None and data.session.wrist is not None
        cut = data.session.slice(data.start - 0.1, data.end + 0.1)
        moved = data.session.wrist[cut].copy()
        moved[:, 2] = wrist[cut]
        given = data.input(data.session.time[cut], moved)
        key = (*mechanics.values(), float(wrist[cut].sum()))
        return self._remember("strike", key, data, lambda: data.model.strike(given, mechanics, data.resting))

    def _held(self, data: StrikeData, mechanics: Mapping[str, float], late: float) -> Stroke:
        key = tuple(mechanics[n] for n in _HAND)
        if late:
            return self._remember("press", (*key, late), data, lambda: self._roll("press", data, mechanics, late))
        return self._by_likeness("press", key, data, mechanics)

    def _roll(self, kind: str, data: StrikeData, mechanics: Mapping[str, float], late: float = 0.0) -> Stroke:
        assert data.given is not None
        if kind == "strike":
            return data.model.strike(data.given, mechanics, data.resting)
        assert data.angle is not None and data.rate is not None
        angle, rate = (
            (shifted(data.grid, x, late) for x in (data.angle, data.rate)) if late else (data.angle, data.rate)
        )
        return data.model.press(data.given, angle, rate, mechanics)

    def _by_likeness(
        self, kind: str, key: tuple[object, ...], data: StrikeData, mechanics: Mapping[str, float]
    ) -> Stroke:
        """The rollout of the strike's example among its repeats, plus what sets the strike apart from it in the cell of
        :meth:`recentre`.

        Repeats have almost one input, so the difference between their rollouts hardly depends on the parameters (a control
        variate); this saves three rollouts of four where every condition is played four times.
        """
        likeness = self._likeness.get(data.name)
        if likeness is None:
            return self._remember(kind, key, data, lambda: self._roll(kind, data, mechanics))
        example = self.data[likeness.example]
        if kind == "press" and (example.angle is None or data.angle is None):
            return self._remember(kind, key, data, lambda: self._roll(kind, data, mechanics))
        rolled = self._remember(kind, key, example, lambda: self._roll(kind, example, mechanics))
        own, other = self._at_centre(kind, data), self._at_centre(kind, example)
        i = np.clip(np.arange(own.angle.size) + likeness.shift, 0, other.angle.size - 1)
        return Stroke(
            data.start, own.angle + (rolled.angle - other.angle)[i], own.rate + (rolled.rate - other.rate)[i],
            np.maximum(own.force + (rolled.force - other.force)[i], 0.0), own.lever,
        )  # fmt: skip

    def _at_centre(self, kind: str, data: StrikeData) -> Stroke:
        shelf = self._central.setdefault(kind, {})
        if data.name not in shelf:
            shelf[data.name] = self._roll(kind, data, self._centre)
        return shelf[data.name]

    def _driven(self, data: StrikeData, mechanics: Mapping[str, float], full: Mapping[str, float], laws: list[Family],
                late: float) -> Stroke:  # fmt: skip
        assert data.reading is not None
        reading, lever = data.reading, data.model.key.radius - mechanics["tip_reach"]
        sensor = [law for law in laws if law.unread]
        own = (full[p.name] for law in sensor for p in law.effect.parameters)
        key = (*(law.name for law in sensor), *own, *(mechanics[n] for n in _KEY), full["fsr_gain"], late)

        def drive() -> Stroke:
            force = shifted(data.grid, reading, late) if late else reading
            for law in sensor:
                force = law.unread(full, data.grid, force)  # type: ignore[misc]
            push = quiet(force) if late or sensor else data.push
            assert push is not None
            return data.model.drive(data.start, push / full["fsr_gain"], lever, mechanics, data.resting)

        return self._remember("drive", key, data, drive)

    def _measured_keystrokes(self, name: str, motion: Stroke, note: int, radius: float, midi: Midi) -> list[Keystroke]:
        """Keystrokes of a measured motion: they depend on nothing but the triggers."""
        key = (name, midi.trigger_on, midi.trigger_off)
        if key not in self._keystrokes:
            while len(self._keystrokes) > 20 * len(self.data):
                self._keystrokes.pop(next(iter(self._keystrokes)))
            self._keystrokes[key] = key_strokes(motion, note, radius, midi)
        return self._keystrokes[key]

    def _shaky_angle(self, data: StrikeData) -> frozenset[str]:
        """Events that cannot be predicted from the measured angle: the encoder's error moves them by more than is told apart, as
        where the key only just reaches the trigger and hovers there.
        """
        name = f"{data.name} angle"
        if name not in self._unstable:
            assert data.angle is not None and data.rate is not None
            full = {p.name: p.nominal for p in self.parameters}
            still = np.zeros_like(data.angle)
            seen = [
                note_events(Stroke(data.start, data.angle + x, data.rate, still, still), data.mark.note, data.model.key.radius,
                            full, [])
                for x in (-ENCODER_ERROR, ENCODER_ERROR)
            ]  # fmt: skip
            limits = {"note.onset": 1.2e-3, "note.hold": 1.6e-3, "note.velocity": 1.5, "note.release": 1.5}
            self._unstable[name] = frozenset(k for k, most in limits.items() if not abs(seen[0][k] - seen[1][k]) < most)
        return self._unstable[name]

    def _shaky(self, data: StrikeData) -> frozenset[str]:
        """Events that cannot be predicted from the measured force: 2 % more or less of it moves them by more than is told
        apart, as when a slow or shallow strike hardly reaches the trigger.
        """
        if data.name not in self._unstable:
            assert data.reading is not None
            full = {p.name: p.nominal for p in self.parameters}
            seen = [
                note_events(data.model.drive(data.start, quiet(data.reading) * x, data.model.key.radius), data.mark.note,
                            data.model.key.radius, full, [])
                for x in (0.98, 1.02)
            ]  # fmt: skip
            limits = {"note.onset": 2.5e-3, "note.hold": 4e-3, "note.velocity": 3.0, "note.release": 4.0}
            self._unstable[data.name] = frozenset(
                k for k, most in limits.items() if not abs(seen[0][k] - seen[1][k]) < most
            )
        return self._unstable[data.name]

    def _remember(self, kind: str, key: tuple[object, ...], data: StrikeData, make: object) -> Stroke:
        store = self._kept.setdefault(kind, OrderedDict())
        shelf = store.get(key)
        if shelf is None:
            shelf = store[key] = {}
            while len(store) > KEPT:
                store.popitem(last=False)
        stroke = shelf.get(data.name)
        if stroke is None:
            stroke = shelf[data.name] = make()  # type: ignore[operator]
        return stroke


def _plain_mechanics(values: Mapping[str, float]) -> dict[str, float]:
    """Numbers of the strike model without any effect."""
    own = ("joint_stiffness", "joint_damping", "key_stiffness", "key_damping", "key_inertia")
    return NULLS | {name: values[name] for name in own}


def _note_observables(source: str, stage: str) -> list[Observable]:
    return [
        Observable(f"note.onset{source}", stage, "note.onset", "s", "event", floor_hint=2e-4, tolerance=1e-4),
        Observable(f"note.velocity{source}", stage, "note.velocity", "1", "event", floor_hint=0.4, tolerance=0.3),
        Observable(f"note.hold{source}", stage, "note.hold", "s", "event", floor_hint=2e-4, tolerance=2e-4),
        Observable(f"note.release{source}", stage, "note.release", "1", "event", floor_hint=0.4, tolerance=0.35),
    ]


def _nuisances() -> tuple[Parameter, ...]:
    def factor(name: str, stage: str, sd: float = 0.25) -> Parameter:
        return Parameter(name, 1.0, 0.4, 2.5, "1", stage, sd, log=True)

    return (
        factor("joint_stiffness", "hand"), factor("joint_damping", "hand"), factor("key_stiffness", "key"),
        factor("key_damping", "key"), factor("key_inertia", "key"), factor("fsr_gain", "sensing"),
        factor("midi_velocity_gain", "sensing"),
    )  # fmt: skip
