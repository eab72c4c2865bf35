"""From a score to setpoints: where the wrist has to be at every cycle of the arm, and when the
vacuum changes.

Between strikes the wrist moves along half a cosine from key to key and hops over the key tops on a
full one; a strike is the paper's sinusoidal down and up (:class:`StrikeMotion`). Position and
velocity are continuous throughout, and every move is as slow as the arm's limits ask for. The
conductor plays a plan live; offline it feeds plant and twin alike.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.motion.limits import WristLimits, wrist_limits
from pianobot_ros.cell.motion.wrist_poses import WristPose, wrist_pose
from pianobot_ros.cell.recordings.commands import CYCLE, Commands
from pianobot_ros.cell.recordings.recording import Strike
from pianobot_ros.cell.score.types import WINDOW_TAIL, Score, ScoreStrike, onset_delay

__all__ = ["Plan", "plan_retreat", "plan_score", "travel_time"]

Coordinates = Callable[[Array], Array]

HOP = 0.012  # m over the key tops while moving to another key: as much as a black key stands out
LEAST_MOVE = 0.12  # s
USED = 0.8  # share of the arm's limits that moves between keys use
SETTLE = 0.3  # s between a step of the vacuum and the strike that wants it
LEAD = 0.5  # s before the first strike, at the first key
LONGEST = 3600.0  # s of a plan: it is computed as a whole before it is played
PARK = 0.03  # m above the keys at the end
IDLE_SHARE = 2 / 3  # of the vacuum, for the fingers that do not strike: they need not be stiff


@dataclass(frozen=True, kw_only=True)
class Plan(Commands):
    """Setpoints of a score on a time axis that starts at 0 s.

    Adds to :class:`Commands` the ``velocity`` (n, 6) m/s and rad/s, the score's ``name`` and a line
    for each note that was left out.
    """

    name: str
    velocity: Array
    unreachable: tuple[str, ...] = ()


def travel_time(a: WristPose, b: WristPose, limits: WristLimits | None = None) -> float:
    """Least time for the move between two poses (s) with the limits kept; 0 if they are the
    same.
    """
    limits = limits or wrist_limits()
    distance = float(np.linalg.norm(b.position - a.position))
    turned = (a.roll, a.pitch, a.yaw) != (b.roll, b.pitch, b.yaw)
    angle = float((b.rotation * a.rotation.inv()).magnitude()) if turned else 0.0
    if distance < 1e-9 and angle < 1e-9:
        return 0.0
    speed, acceleration = USED * limits.speed, USED * limits.acceleration
    times = [LEAST_MOVE]
    # Half cosine of amplitude d: peak speed pi d / 2T, peak acceleration pi^2 d / 2T^2. The hop, a
    # full cosine of height
    # HOP, adds pi HOP / T and 2 pi^2 HOP / T^2.
    times += [
        np.pi * (distance / 2 + HOP) / speed,
        np.pi * np.sqrt((distance / 2 + 2 * HOP) / acceleration),
    ]
    times += [
        np.pi * angle / (2 * USED * limits.angular_speed),
        np.pi * np.sqrt(angle / (2 * USED * limits.angular_acceleration)),
    ]
    return float(max(times))


class _Track:
    """A path in the six coordinates x, y, z, roll, pitch, yaw, made of pieces that follow one
    another.
    """

    def __init__(self, start: Array) -> None:
        self.end = 0.0
        self.last = start
        self._pieces: list[tuple[float, Coordinates]] = []  # begin and path, end to end

    def add(self, duration: float, path: Coordinates) -> None:
        if duration > 0:
            self._pieces.append((self.end, path))
            self.end += duration
            self.last = path(np.array([duration]))[0]

    def rest(self, duration: float) -> None:
        place = self.last
        self.add(duration, lambda t: np.tile(place, (len(t), 1)))

    def move(self, to: Array, duration: float, hop: float = 0.0) -> None:
        start = self.last

        def path(t: Array) -> Array:
            phase = np.clip(t / duration, 0.0, 1.0)[:, None]
            blend = 0.5 * (1 - np.cos(np.pi * phase))
            moved = start + (to - start) * blend
            moved[:, 2:3] += 0.5 * hop * (1 - np.cos(2 * np.pi * phase))
            return np.asarray(moved)

        self.add(duration, path)

    def at(self, time: Array) -> Array:
        """Coordinates (n, 6) at ``time`` (n,), ascending."""
        out = np.tile(self.last, (len(time), 1))
        borders = np.searchsorted(time, [start for start, _ in self._pieces] + [self.end]).tolist()
        for (start, path), low, high in zip(self._pieces, borders, borders[1:], strict=False):
            if high > low:
                out[low:high] = path(time[low:high] - start)
        before = np.searchsorted(time, 0.0)
        if before and self._pieces:
            out[:before] = self._pieces[0][1](np.zeros(1))
        return out


def plan_score(
    score: Score,
    start: WristPose | None = None,
    *,
    period: float = CYCLE,
    limits: WristLimits | None = None,
    number: int = 0,
    in_time: bool = True,
) -> Plan:
    """The plan that plays ``score``, beginning and ending at rest.

    ``start`` is where the wrist is; by default above the first key. ``period`` of the setpoints in
    s. ``number`` is that of the first strike. Raises :class:`ScoreError` if strikes do
    not fit one after the other as a phrase asks; with ``in_time`` False they come later instead.
    """
    if not score.strikes:
        raise ScoreError(f"{score.name}: there is nothing to play")
    limits = limits or wrist_limits()
    poses = _postures(score)
    first = _raised(poses[0], score.strikes[0])
    track = _Track(_coordinates(start or first))
    if start is not None and (needed := travel_time(start, first, limits)):
        track.move(_coordinates(first), max(needed, LEAD), HOP)
    track.rest(LEAD)
    marks: list[Strike] = []
    vacuum: list[tuple[float, Array]] = [(0.0, _pressures(score.strikes[0]))]
    beat = _Beat(score.name, in_time)
    for strike, touching in zip(score.strikes, poses, strict=True):
        delay = onset_delay(strike.motion, strike.notes[0]) if strike.motion else 0.0
        above, here = _raised(touching, strike), _pose(track.last)
        needed = travel_time(here, above, limits) if beat.last is not None else 0.0
        wanted = beat.start(strike, track.end + needed, delay)
        pressure = _pressures(strike)
        if beat.last is not None:
            if np.any(pressure != vacuum[-1][1]):
                vacuum.append((track.end, pressure))
                if beat.last.note_length == 0 and np.isnan(strike.onset):
                    wanted = max(wanted, track.end + SETTLE)
            _approach(track, here, above, needed, wanted)
        begin = track.end
        _play(track, strike, touching)
        beat.onset, beat.last = begin + delay, strike
        if np.isnan(strike.onset) and strike.note_length == 0:
            track.rest(WINDOW_TAIL)
        marks += _marks(strike, begin, number + len(marks), score.name)
        if not track.end < LONGEST:
            raise ScoreError(
                f"{score.name} takes more than {LONGEST / 60:g} minutes: play less at a time, or"
                " faster"
            )
    track.rest(WINDOW_TAIL)
    parked = track.last.copy()
    parked[2] = min(parked[2] + PARK, limits.high[2])
    track.move(parked, 0.4)
    track.rest(2 * period)
    return _sampled(score, track, period, _closed(marks), vacuum)


def _postures(score: Score) -> list[WristPose]:
    """Where the hand touches the keys of each strike. To find a posture takes long; a score of
    thousands of strikes has few.
    """
    hands = [(s.fingers, s.notes) for s in score.strikes]
    found = {keys: _touching(*keys) for keys in dict.fromkeys(hands)}
    return [found[keys] for keys in hands]


@dataclass
class _Beat:
    """When strikes begin: ``last`` is the strike before, ``onset`` when it sounded, ``zero`` where
    the score's time starts; ``in_time`` False where a strike may come later than asked.
    """

    name: str
    in_time: bool = True
    last: ScoreStrike | None = None
    onset: float = -np.inf
    zero: float = np.nan

    def start(self, strike: ScoreStrike, earliest: float, delay: float) -> float:
        """When the motion of ``strike`` is to begin, so that it sounds ``delay`` later at its time
        in the score.

        ``earliest`` is when the wrist can be there. Raises :class:`ScoreError` if that is too late.
        """
        wanted = earliest
        if not np.isnan(strike.onset):
            self.zero = earliest + delay - strike.onset if np.isnan(self.zero) else self.zero
            wanted = self.zero + strike.onset - delay
        elif self.last is not None and self.last.note_length:
            wanted = self.onset + self.last.note_length - delay
        if wanted >= earliest - 1e-6:
            return wanted
        if not self.in_time:
            return earliest
        if self.last is not None and not np.isnan(strike.onset):
            which = f"{strike.name} at {strike.onset:.2f} s"
        else:
            which = (
                f"{strike.name} after a note length of"
                f" {self.last.note_length if self.last else 0:g} s"
            )
        late = earliest - wanted
        raise ScoreError(
            f"{self.name}: {which} comes {late:.2f} s too early for the hand: play slower (tempo)"
            " or hold shorter"
        )


def _approach(
    track: _Track, here: WristPose, above: WristPose, needed: float, wanted: float
) -> None:
    """Travel and wait, so that the wrist is above the keys at ``wanted`` s."""
    spare = max(wanted - track.end, 0.0)
    if needed:
        other = not np.allclose(here.position[:2], above.position[:2], atol=1e-4)
        move = min(max(needed, min(spare, 0.4)), spare) if spare >= needed else needed
        track.move(_coordinates(above), move, HOP if other else 0.0)
        spare -= move
    track.rest(max(spare, 0.0))


def _touching(fingers: tuple[str, ...], notes: tuple[int, ...]) -> WristPose:
    return wrist_pose(dict(zip(fingers, notes, strict=True)))


def _raised(pose: WristPose, strike: ScoreStrike) -> WristPose:
    return pose.raised(strike.motion.clearance)


def _pose(coordinates: Array) -> WristPose:
    x, y, z, roll, pitch, yaw = map(float, coordinates)
    return WristPose(x=x, y=y, z=z, roll=roll, pitch=pitch, yaw=yaw)


def _coordinates(pose: WristPose) -> Array:
    return np.array([pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw])


def _pressures(strike: ScoreStrike) -> Array:
    return np.array(
        [strike.pressure * (1.0 if f in strike.fingers else IDLE_SHARE) for f in FINGERS]
    )


def _play(track: _Track, strike: ScoreStrike, touching: WristPose) -> None:
    """The strike itself; a glissando moves sideways while it is down."""
    base, motion = _coordinates(touching), strike.motion
    target = base
    if strike.slide:
        target = _coordinates(wrist_pose({strike.fingers[0]: strike.slide[-1]}))
    slide_start = motion.down_time + motion.hold / 2

    def path(t: Array) -> Array:
        blend = 0.0 * t
        if strike.slide_time:
            blend = 0.5 * (
                1 - np.cos(np.pi * np.clip((t - slide_start) / strike.slide_time, 0.0, 1.0))
            )
        out = base + (target - base) * blend[:, None]
        # While the wrist slides, the vertical motion waits at the bottom.
        out[:, 2] += motion.height(t - np.clip(t - slide_start, 0.0, strike.slide_time))
        return np.asarray(out)

    track.add(strike.duration, path)


def _marks(strike: ScoreStrike, begin: float, index: int, phrase: str) -> list[Strike]:
    """One mark for each key; the keys of a glissando have their windows one after the other."""
    motion = strike.motion

    def mark(i: int, finger: str, note: int, start: float, end: float) -> Strike:
        return Strike(
            index=index + i,
            phrase=phrase,
            condition=strike.condition,
            finger=finger,
            note=note,
            start=start,
            end=end,
            speed=motion.speed,
            depth=motion.depth,
            hold=motion.hold,
            pressure=strike.pressure,
            note_length=strike.note_length or strike.duration + WINDOW_TAIL,
        )

    end = begin + strike.duration + WINDOW_TAIL
    if not strike.slide:
        return [
            mark(i, f, n, begin, end)
            for i, (f, n) in enumerate(zip(strike.fingers, strike.notes, strict=True))
        ]
    down = begin + motion.down_time + motion.hold / 2
    # Where the cosine of the slide is half-way between two keys.
    shares = (np.arange(1, len(strike.slide)) - 0.5) / (len(strike.slide) - 1)
    borders = [begin, *(down + strike.slide_time * np.arccos(1 - 2 * shares) / np.pi), end]
    return [
        mark(i, strike.fingers[0], note, float(borders[i]), float(borders[i + 1]))
        for i, note in enumerate(strike.slide)
    ]


def _closed(marks: list[Strike]) -> tuple[Strike, ...]:
    """Windows that end where the next one begins at the latest."""
    starts = sorted({m.start for m in marks})
    closed = []
    for m in marks:
        following = bisect_right(starts, m.start + 1e-9)
        closed.append(
            replace(m, end=min(m.end, starts[following])) if following < len(starts) else m
        )
    return tuple(closed)


def _sampled(
    score: Score,
    track: _Track,
    period: float,
    marks: tuple[Strike, ...],
    vacuum: Iterable[tuple[float, Array]],
) -> Plan:
    time: Array = period * np.arange(int(np.ceil(track.end / period - 1e-9)) + 1, dtype=np.float64)
    h = 1e-4
    near = track.at((time[:, None] + [-h, 0.0, h]).ravel()).reshape(-1, 3, 6)
    before, poses, after = near[:, 0], near[:, 1], near[:, 2]
    rotation, turning = _turned(near[:, :, 3:])
    velocity = np.hstack([after[:, :3] - before[:, :3], turning]) / (2 * h)
    steps = list(vacuum)
    return Plan(
        time=time,
        position=poses[:, :3],
        rotation=rotation,
        vacuum_time=np.array([t for t, _ in steps]),
        pressure=np.array([p for _, p in steps]),
        strikes=marks,
        name=score.name,
        velocity=velocity,
        unreachable=score.unreachable,
    )


def _turned(angles: Array) -> tuple[Array, Array]:
    """Rotation vectors of the orientation and of the turn from before to after, each (n, 3) rad,
    of roll, pitch, yaw before, at and after each sample (n, 3, 3).
    """
    # The wrist mostly keeps its orientation, and converting one costs more than all the rest.
    new = np.ones(len(angles), dtype=bool)
    new[1:] = np.any(angles[1:] != angles[:-1], axis=(1, 2))
    before, at, after = (Rotation.from_euler("xyz", angles[new, i]) for i in range(3))
    run = np.cumsum(new) - 1
    return at.as_rotvec()[run], (after * before.inv()).as_rotvec()[run]


def plan_retreat(
    position: ArrayLike,
    velocity: ArrayLike,
    *,
    height: float = PARK,
    period: float = CYCLE,
    limits: WristLimits | None = None,
) -> tuple[Array, Array]:
    """From any state of motion smoothly to rest ``height`` m higher: positions and velocities, each
    (n, 3), the first one period from now. A cubic, as long as the arm's limits ask for."""
    limits = limits or wrist_limits()
    p, v = np.asarray(position, dtype=float), np.asarray(velocity, dtype=float)
    goal = p + np.array([0.0, 0.0, min(height, max(limits.high[2] - p[2], 0.0))])
    for duration in np.arange(0.2, 3.0, 0.05):
        t = np.arange(1, int(np.ceil(duration / period)) + 1) * period
        s = np.clip(t / duration, 0.0, 1.0)[:, None]
        # Hermite polynomials, and a share of the initial velocity that carries the wrist on while
        # it slows down.
        blend = 3 * s**2 - 2 * s**3
        carry = (s - 2 * s**2 + s**3) * duration
        path = p + (goal - p) * blend + v * carry
        speeds = (goal - p) * (6 * s - 6 * s**2) / duration + v * (1 - 4 * s + 3 * s**2)
        accelerations = (goal - p) * (6 - 12 * s) / duration**2 + v * (6 * s - 4) / duration
        if (
            np.linalg.norm(accelerations, axis=1).max() <= limits.acceleration
            and np.linalg.norm(speeds, axis=1).max() <= limits.speed
        ):
            break
    speeds[-1] = 0.0
    return path, speeds
