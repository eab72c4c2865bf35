"""Load tests of one key: force and angle against time, from a CSV file or a recording, cut into
presses.

A press is what Fig. 4 of "Data-driven Simulation Framework" shows: a load put on the key (F
sequence), the angle that follows (θ sequence), and the abrupt removal of the load with the bounce
after it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator, PchipInterpolator

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.motion.geometry import pivot_radius
from pianobot_ros.cell.recordings.recording import Recording

__all__ = [
    "LoadTest",
    "Press",
    "cut_presses",
    "load_test_from_csv",
    "load_test_from_recording",
    "read_load_test",
]


GRID = 1e-3  # s: everything is resampled to this spacing
LOADED = 0.08  # of the largest force: above this the key counts as loaded
AT_REST = 0.05  # of the largest angle: below this the key counts as back at rest
SATURATED_RUN = 0.03  # s at exactly the largest reading: a converter at the end of its range
BEFORE = 0.15  # s kept before it, so that the model starts with the key at rest
AFTER = 0.35  # s kept after the load is gone: the bounce


@dataclass(frozen=True)
class LoadTest:
    """``time`` (n,) s increasing, ``force`` (n,) N on the key at ``radius`` m from its hinge,
    ``angle`` (n,) rad.
    """

    time: Array
    force: Array
    angle: Array
    radius: float
    note: int
    source: str


@dataclass(frozen=True)
class Press:
    """One press on a grid of :data:`GRID` s from ``start`` s: ``force`` (n,) N, ``angle`` (n,) rad;
    the load is gone at index ``release``.
    """

    start: float
    force: Array
    angle: Array
    release: int

    @property
    def time(self) -> Array:
        """The grid (n,), s."""
        return np.asarray(self.start + GRID * np.arange(self.force.size), dtype=float)


def read_load_test(
    path: str | Path, note: int | None = None, cancelled: Callable[[], bool] | None = None
) -> LoadTest:
    """The load test in a CSV file or a bag directory. ``cancelled`` is asked while a bag is read.

    Raises :class:`RecordingError` in one line; :class:`CancelledError`.
    """
    from pianobot_ros.bags.reading.read import read_bag

    path = Path(path)
    if path.suffix.lower() in (".csv", ".txt"):
        return load_test_from_csv(path, note)
    return load_test_from_recording(read_bag(path, cancelled), note)


def load_test_from_csv(path: str | Path, note: int | None = None) -> LoadTest:
    """A CSV file with the columns time (s), force (N) and angle (rad); others are ignored. Default
    ``note``: 64 (E4).

    Raises :class:`RecordingError` in one line for missing columns, text where numbers belong, and a
    clock that jumps back.
    """
    path = Path(path)
    wanted = ("time", "force", "angle")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.DictReader(file)
            names = {name.strip().lower(): name for name in rows.fieldnames or ()}
            if missing := [name for name in wanted if name not in names]:
                have = ", ".join(names) or "nothing"
                raise RecordingError(
                    f"{path}: column {', '.join(missing)} is missing; found {have}; need time,"
                    " force, angle"
                )
            table = []
            for row in rows:
                try:
                    table.append([float(row[names[name]]) for name in wanted])
                except (TypeError, ValueError) as error:
                    raise RecordingError(
                        f"{path}, line {rows.line_num}: {error}: every cell must be a number"
                    ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(
            f"cannot read {path}: {getattr(error, 'strerror', None) or 'not a text file'}"
        ) from error
    if len(table) < 50:
        raise RecordingError(
            f"{path} holds {len(table)} samples: a press and its release need at least 50"
        )
    time, force, angle = np.array(table).T
    note = 64 if note is None else note
    return _checked(LoadTest(time, force, angle, pivot_radius(note), note, str(path)))


def load_test_from_recording(
    recording: Recording, note: int | None = None, cell: str = "real"
) -> LoadTest:
    """Force and angle of the key that carries the sensor, from a bag with a key encoder."""
    note = note or recording.fsr_note
    if note is None or f"{cell}/fsr.force" not in recording.signals:
        raise RecordingError(
            f"{recording.source}: no /{cell}/fsr in this recording: the load on the key is needed"
        )
    if note != recording.fsr_note:
        raise RecordingError(
            f"{recording.source}: the force sensor sits on note {recording.fsr_note}, not on {note}"
        )
    name = f"{cell}/key_angle.{note}"
    if name not in recording.signals:
        raise RecordingError(
            f"{recording.source}: no /{cell}/key_angle of note {note}: an encoder rig must be"
            " fitted"
        )
    for warning in recording.warnings:
        if "jumps back" in warning and ("fsr" in warning or "key_angle" in warning):
            raise RecordingError(
                f"{recording.source}: {warning}: record again, or cut the bag before the jump"
            )
    saturated = recording.signals.get(f"{cell}/fsr.saturated")
    if saturated is not None and np.any(saturated.value > 0):
        when = saturated.time[np.argmax(saturated.value > 0)]
        raise RecordingError(
            f"{recording.source}: the force sensor is saturated at {when:.2f} s: press more gently"
        )
    force, angle = recording.signal(f"{cell}/fsr.force"), recording.signal(name)
    low, high = max(force.time[0], angle.time[0]), min(force.time[-1], angle.time[-1])
    inside = (force.time >= low) & (force.time <= high)
    time = force.time[inside]
    on_force = np.interp(time, angle.time, angle.value)
    return _checked(
        LoadTest(time, force.value[inside], on_force, pivot_radius(note), note, recording.source)
    )


def _checked(test: LoadTest) -> LoadTest:
    for name in ("time", "force", "angle"):
        if not np.all(np.isfinite(getattr(test, name))):
            raise RecordingError(f"{test.source}: {name} holds NaN or infinity: remove those rows")
    steps = np.diff(test.time)
    if np.any(steps <= 0):
        i = int(np.argmax(steps <= 0))
        what = "jumps back" if steps[i] < 0 else "stands still"
        raise RecordingError(
            f"{test.source}: the clock {what} after {test.time[i]:.4f} s: cut the recording there"
        )
    if np.ptp(test.angle) < 1e-4:
        raise RecordingError(
            f"{test.source}: the key does not move (angle changes by {np.ptp(test.angle):.1e} rad)"
        )
    _refuse_saturated(test)
    return test


def _refuse_saturated(test: LoadTest) -> None:
    """Raise if the force stands at exactly its largest value for long although the load did not.

    A dead weight also gives a flat force in clean data. It is told apart by the key: where the
    readings below the top say that the angle needs more force than is read, or where the sensor has
    noise everywhere but there, it is at the end of its range.
    """
    top = float(test.force.max())
    flat = test.force >= top - 1e-9 * abs(top)
    longest = _longest_run(flat, test.time)
    if longest is None or longest[1] <= SATURATED_RUN:
        return
    bends = np.diff(test.force[~flat], 2)
    bends = np.sign(bends[np.abs(bends) > 1e-4 * top])
    noisy = bends.size > 20 and float(np.mean(bends[1:] != bends[:-1])) > 0.3
    if noisy or _more_was_needed(test, flat, top):
        start, length = longest
        raise RecordingError(
            f"{test.source}: the force sensor is saturated at {start:.2f} s ({length * 1e3:.0f} ms"
            f" at exactly {top:.2f} N): press more gently or change the sensor's range"
        )


def _more_was_needed(test: LoadTest, flat: NDArray[np.bool_], top: float) -> bool:
    """Whether a linear key, fitted to the samples below the top, needs clearly more force than
    ``top`` at the flat ones.
    """
    rate = np.gradient(test.angle, test.time)
    columns = np.column_stack([test.angle, rate, np.gradient(rate, test.time)])
    below = ~flat & (test.force > LOADED * top)
    if below.sum() < 20 or np.ptp(test.force[below]) < 0.3 * top:
        return False
    gains = np.linalg.lstsq(columns[below], test.force[below], rcond=None)[0]
    return float(np.percentile(columns[flat] @ gains, 90)) > 1.1 * top


def _longest_run(flags: NDArray[np.bool_], time: Array) -> tuple[float, float] | None:
    """Start and length of the longest run of set flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    runs = [
        (float(time[a]), float(time[b - 1] - time[a]))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    return max(runs, key=lambda run: run[1]) if runs else None


def cut_presses(test: LoadTest) -> list[Press]:
    """Cut a load test into presses, each with its release and bounce.

    Raises :class:`RecordingError` in one line when no press is there, one has no release, or two
    overlap.
    """
    grid = np.arange(test.time[0], test.time[-1], GRID)
    # Straight lines between samples 2 ms apart cut the corners of a bounce and make the key seem
    # lighter. Force may jump,
    # so its curve must not overshoot.
    force = np.asarray(PchipInterpolator(test.time, test.force)(grid))
    angle = np.asarray(Akima1DInterpolator(test.time, test.angle)(grid))
    first_load = int(np.argmax(force > LOADED * force.max()))
    if first_load == 0 and abs(angle[0]) < 0.1 * angle.max():
        # The load is put on with the first sample, and the key is still up: all the same a press
        # from rest.
        rest_before = round(BEFORE / GRID)
        force, angle = (np.concatenate([np.zeros(rest_before), x]) for x in (force, angle))
        grid = grid[0] - BEFORE + GRID * np.arange(force.size)
    elif first_load > 20:
        force, angle = (
            force - np.median(force[: first_load - 5]),
            angle - np.median(angle[: first_load - 5]),
        )
    loaded = force > LOADED * force.max()
    edges = np.flatnonzero(np.diff(loaded.astype(int))) + 1
    if loaded[0]:
        raise RecordingError(
            f"{test.source}: the recording starts with the key already loaded: start before the"
            " press"
        )
    if loaded[-1]:
        raise RecordingError(
            f"{test.source}: the recording ends without a release: keep recording until the key is"
            " back up"
        )
    starts, ends = _merge_bounces(edges[::2], edges[1::2])
    rest = AT_REST * angle.max()
    presses = []
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        until = starts[i + 1] if i + 1 < len(starts) else len(grid)
        if i > 0 and angle[ends[i - 1] : start].min(initial=np.inf) > 3 * rest:
            raise RecordingError(
                f"{test.source}: presses {i} and {i + 1} overlap at {grid[start]:.2f} s: the key"
                " was not back at rest; leave it at least 0.3 s between presses"
            )
        if np.all(angle[end:until] > rest):
            raise RecordingError(
                f"{test.source}: press {i + 1} at {grid[start]:.2f} s has no release: the key stays"
                " down"
            )
        first = max(start - round(BEFORE / GRID), ends[i - 1] + round(AFTER / GRID) if i else 0, 0)
        first, last = min(first, start), min(end + round(AFTER / GRID), until - 1)
        presses.append(Press(float(grid[first]), force[first:last], angle[first:last], end - first))
    return presses


def _merge_bounces(starts: NDArray[np.int_], ends: NDArray[np.int_]) -> tuple[list[int], list[int]]:
    """Join stretches of load with gaps under 30 ms: the finger bounces on the key within one
    press.
    """
    merged: list[list[int]] = []
    for start, end in zip(starts, ends, strict=True):
        if merged and (start - merged[-1][1]) * GRID < 0.03:
            merged[-1][1] = int(end)
        else:
            merged.append([int(start), int(end)])
    kept = [m for m in merged if (m[1] - m[0]) * GRID > 0.02]
    return [m[0] for m in kept], [m[1] for m in kept]
