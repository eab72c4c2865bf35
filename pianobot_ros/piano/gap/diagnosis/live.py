"""Live diagnosis without ROS: samples are collected into a recording; a worker process maps and
diagnoses it.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.priority import request_background
from pianobot_ros.cell.messages.refusals import Refusal
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries
from pianobot_ros.piano.gap.evidence.session_clocks import CLOCKS, MARGIN, ahead_at

if TYPE_CHECKING:
    from pianobot_ros.gap import Diagnosis
    from pianobot_ros.piano.gap.diagnosis.investigate import Decision

__all__ = [
    "Collector",
    "StageMap",
    "background_stage_map",
    "decide_in_worker",
    "diagnose_in_worker",
    "stage_map",
    "start_worker",
    "write_found",
]


UNITS = {
    "position": "m",
    "rotation": "rad",
    "pressure": "Pa",
    "setpoint": "Pa",
    "measured": "Pa",
    "force": "N",
}
LATEST = 8  # strikes in the stage map, which is made anew after each


@dataclass
class Collector:
    """Samples of the last ``memory`` s by signal, notes and strikes; stamps in s since the
    epoch.
    """

    memory: float = 600.0
    signals: dict[str, deque[tuple[Array, Array]]] = field(default_factory=dict)
    notes: deque[NoteEvent] = field(default_factory=deque)
    strikes: deque[Strike] = field(default_factory=deque)
    fsr_note: int | None = None
    corrections: str = ""
    sights: dict[str, deque[tuple[int, float]]] = field(default_factory=dict)
    refusals: deque[Refusal] = field(default_factory=deque)

    def sight(self, device: str, stamp: int, sent: int) -> None:
        """``device`` gave the stamp ``stamp`` to what was sent at ``sent``, ns since the epoch; of
        some tenths of a second the one that came with the least delay.
        """
        seen = self.sights.setdefault(device, deque())
        seen.append((sent, 1e-9 * (stamp - sent)))
        while seen[0][0] < sent - 1e9 * self.memory:
            seen.popleft()

    def add(self, name: str, stamps: Array, values: Array) -> None:
        """Samples of the signal ``name`` (as in :class:`Recording`): ``stamps`` (n,) increasing,
        ``values`` (n,) or (n, m).
        """
        if not len(stamps):
            return
        batches = self.signals.setdefault(name, deque())
        batches.append((stamps, values))
        while batches[0][0][-1] < stamps[-1] - self.memory:
            batches.popleft()

    def strike(self, strike: Strike) -> None:
        """One announced strike, its times since the epoch."""
        self.strikes.append(strike)
        while self.strikes[0].start < strike.start - self.memory:
            self.strikes.popleft()

    def note(self, event: NoteEvent) -> None:
        """One note event of the real cell."""
        self.notes.append(event)
        while self.notes[0].time < event.time - self.memory:
            self.notes.popleft()

    def refusal(self, refusal: Refusal) -> None:
        """A command that the real cell did not obey as given."""
        self.refusals.append(refusal)
        while self.refusals[0].time < refusal.time - self.memory:
            self.refusals.popleft()

    def finished(self, now: float) -> list[Strike]:
        """Strikes whose windows have ended."""
        return [s for s in self.strikes if s.end < now]

    def recording(
        self, strikes: Sequence[Strike] | None = None, margin: float = MARGIN
    ) -> Recording:
        """What was collected around ``strikes`` (all by default), on an axis that starts there,
        with every device's clock set right at its start. Empty signals are left out.
        """
        chosen = list(self.strikes if strikes is None else strikes)
        low = min((s.start for s in chosen), default=-np.inf) - margin
        high = max((s.end for s in chosen), default=np.inf) + margin
        cut, clocks = {}, ahead_at(self.sights, low)
        for name, batches in self.signals.items():
            ahead = clocks.get(CLOCKS.get(name.split(".")[0], ""), 0.0)
            near = [(t, v) for t, v in batches if t[-1] >= low + ahead and t[0] <= high + ahead]
            if near:
                time, value = (
                    np.concatenate([t for t, _ in near]) - ahead,
                    np.concatenate([v for _, v in near]),
                )
                inside = (time >= low) & (time <= high)
                if inside.any():
                    cut[name] = time[inside], value[inside]
        epoch = float(min((time[0] for time, _ in cut.values()), default=0.0))
        signals = {}
        for name, (time, value) in cut.items():
            new = np.diff(np.maximum.accumulate(time), prepend=-np.inf) > 0
            unit = UNITS.get(name.rsplit(".", 1)[-1], "rad" if "key_angle" in name else "1")
            signals[name] = TimeSeries(time[new] - epoch, value[new], unit)
        notes = [replace(n, time=n.time - epoch) for n in self.notes if low <= n.time <= high]
        marks = [replace(s, start=s.start - epoch, end=s.end - epoch) for s in chosen]
        return Recording(
            signals,
            {"real": notes},
            marks,
            self.fsr_note,
            epoch,
            "live",
            refusals=tuple(
                (r.time - epoch, r.time - epoch + r.lasting, r.topic)
                for r in self.refusals
                if r.shows(low, high)
            ),
            corrections=self.corrections,
        )


@dataclass(frozen=True)
class StageMap:
    """Gap by stage in units of the floor (NaN: not measured) over the latest strikes; ``text`` in
    words; ``phases`` the map stage × phase as in diagnosis.json, if there is one.
    """

    stages: tuple[tuple[str, float, float], ...]
    strikes: int
    text: str
    phases: dict[str, Any] | None = None


Said = tuple[str, float, tuple[tuple[str, float], ...]]
"""What a diagnosis does, the share that is done, and the leading effects with their weights."""
_said: SimpleQueue[Said] | None = None


def start_worker(said: SimpleQueue[Said] | None = None) -> None:
    """For worker processes: compile or load all that a stage map needs. ``said`` gets what
    :func:`diagnose_in_worker` does meanwhile.

    That takes seconds, and a minute where nothing was compiled yet: not while strikes wait for
    their map.
    """
    global _said  # noqa: PLW0603 (a queue reaches a worker only when it is started)
    _said = said
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    background_stage_map(_practice())


def _end_with_parent() -> None:
    """End this process when its parent has, also if that was killed: the pool's own pipe would
    never tell.
    """
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(0)


def _practice() -> Recording:
    """Two equal strikes with every signal that a stage map looks at; what they show does not
    matter.
    """
    motion, period = StrikeMotion(0.15, 0.014, 0.15), 1.5
    note, finger = keyboard().notes[len(keyboard().notes) // 2], FINGERS[0]
    strikes = [
        Strike(
            i,
            "",
            "practice",
            finger,
            note,
            begin,
            begin + 1.0,
            motion.speed,
            motion.depth,
            motion.hold,
            -5e4,
            1.0,
        )
        for i, begin in enumerate((1.0, 1.0 + period))
    ]
    slow, fast = (np.arange(0.0, 2.0 * period + 1.0, step) for step in (0.008, 0.002))
    pose = wrist_pose({finger: note})

    def path(time: Array) -> Array:
        return np.asarray(
            sum(motion.height(time - s.start - 0.1) - motion.clearance for s in strikes)
        )

    place = np.column_stack(
        [np.full_like(slow, pose.x), np.full_like(slow, pose.y), pose.z + path(slow)]
    )
    press = np.maximum(-path(fast) - motion.clearance, 0.0) / motion.depth
    pressure = np.full((slow.size, len(FINGERS)), -5e4)
    signals: dict[str, TimeSeries] = {}
    for name in ("command/wrist", "real/wrist/state"):
        signals[f"{name}.position"] = TimeSeries(slow, place, "m")
        signals[f"{name}.rotation"] = TimeSeries(slow, 0.0 * place, "rad")
    vacuum = ("command/vacuum.pressure", "real/vacuum/state.setpoint", "real/vacuum/state.measured")
    signals |= dict.fromkeys(vacuum, TimeSeries(slow, pressure, "Pa"))
    signals["real/fsr.force"] = TimeSeries(fast, 4.0 * press, "N")
    signals[f"real/key_angle.{note}"] = TimeSeries(fast, 0.04 * press, "rad")
    notes = [
        NoteEvent(s.start + at, on, note, 60)
        for s in strikes
        for at, on in ((0.3, True), (0.5, False))
    ]
    return Recording(signals, {"real": notes}, strikes, note, 0.0, "live")


def stage_map(recording: Recording) -> StageMap | str:
    """The gap by stage of the nominal twin, against the floor of the repeats seen so far; a string
    says why there is none.
    """
    from pianobot_ros.gap import GapError, Options
    from pianobot_ros.gap.explain import breakdown
    from pianobot_ros.gap.floor.measure import Gauge
    from pianobot_ros.gap.floor.noise import NoiseModel
    from pianobot_ros.gap.problem.problem import Problem
    from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

    try:
        twin = PianoTwin([recording])
        problem = Problem(twin, twin.blocks)
        prediction = problem.predict(problem.nominal(), ())
        gauge = Gauge(problem, NoiseModel.by(problem, problem.y - prediction, Options()))
        rows = breakdown.stages(gauge, prediction, {})
        phases = breakdown.stage_by_phase(gauge, prediction, prediction)
    except (PianobotError, GapError) as error:
        return str(error)
    excess = [max(r.gap**2 - 1.0, 0.0) if np.isfinite(r.gap) else 0.0 for r in rows]
    total = sum(excess) or 1.0
    stages = tuple((r.name, float(r.gap), e / total) for r, e in zip(rows, excess, strict=True))
    worst = max(stages, key=lambda s: s[1] if np.isfinite(s[1]) else 0.0)
    text = (
        f"{len(twin.blocks)} strikes, largest gap at {worst[0]}: {worst[1]:.1f} × floor; not"
        " diagnosed yet"
    )
    table = None if phases is None else phases.to_json()
    return StageMap(stages, len(twin.blocks), text, table)


def write_found(found: Diagnosis, folder: str) -> str:
    """Write a diagnosis and its report into ``folder``; returns the report's path."""
    from pianobot_ros.piano.gap.diagnosis.diagnose import write_results

    return str(write_results(found, folder))


def decide_in_worker(
    recordings: Sequence[Recording], probability: float, strikes: int, seed: int
) -> Decision:
    """What an investigation does next (see
    :func:`pianobot_ros.piano.gap.diagnosis.investigate.decide`).
    """
    from pianobot_ros.piano.gap.diagnosis.investigate import Goal, decide

    return decide(recordings, Goal(probability, strikes, seed=seed))


def background_stage_map(recording: Recording) -> StageMap | str:
    """:func:`stage_map` in a thread that leaves the processor to the cell, which may be playing; a
    diagnosis that somebody waits for has ordinary priority.
    """
    with ThreadPoolExecutor(1, initializer=request_background) as pool:
        return pool.submit(stage_map, recording).result()


def diagnose_in_worker(
    source: Recording | str, output: str, seed: int, strikes: int, budget: int
) -> dict[str, Any] | str:
    """Diagnosis of a bag or of a recording as the dictionary of diagnosis.json; a string says why
    there is none.
    """
    from pianobot_ros.piano.gap.diagnosis.diagnose import diagnose_bag, diagnose_recordings

    queue = _said
    leaders: tuple[tuple[str, float], ...] = ()

    def progress(doing: str, share: float) -> None:
        if queue is not None:
            queue.put((doing, share, leaders))

    def leading(now: tuple[tuple[str, float], ...]) -> None:
        nonlocal leaders
        leaders = now

    asked: dict[str, Any] = {
        "output": Path(output) if output else None,
        "seed": seed,
        "strikes": strikes,
        "budget": budget,
        "progress": progress,
        "leading": leading,
    }
    try:
        if isinstance(source, str):
            found = diagnose_bag(source, **asked)
        else:
            found = diagnose_recordings([source], **asked)
    except PianobotError as error:
        return str(error)
    return found.to_json()
