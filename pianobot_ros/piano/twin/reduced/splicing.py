"""A recording prepared for splicing: nominal servo and setpoints on a uniform grid, smooth measured
signals by strike.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline, make_smoothing_spline

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.numbers.nominal import wrist_servo
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.piano.twin.reduced.strike_model import GRID

__all__ = ["STEP", "Session", "open_session", "smooth_angle"]

STEP = 1e-3  # s: grid of commands
LONGEST = 12 * 3600.0  # s of one recording
PRESSED = 4e-3  # s between the force sensor's readings of the past
SETPOINT_STEP = 100.0  # Pa: what a regulator may round its setpoint by


@dataclass(eq=False)
class Session:
    """One recording on a grid of :data:`STEP` s: ``time`` (n,) s; ``wrist`` (n, 3) m after the
    nominal servo, None without commands; ``setpoint`` (n, 3) Pa by finger; ``notes`` (warnings) in
    one line each.
    """

    index: int
    recording: Recording
    time: Array
    wrist: Array | None
    setpoint: Array | None
    warnings: list[str] = field(default_factory=list)

    @cached_property
    def pressed(self) -> tuple[Array, Array]:
        """Times (n,) s and readings (n,) N of the force sensor throughout, each of some
        :data:`PRESSED` s; none where it was not recorded.
        """
        signal = self.recording.signals.get("real/fsr.force")
        if signal is None:
            return np.zeros(0), np.zeros(0)
        good = np.isfinite(signal.value)
        t, y = signal.time[good], signal.value[good]
        every = (
            max(1, round(PRESSED / max(float(np.median(np.diff(t))), 1e-6))) if t.size > 1 else 1
        )
        return np.ascontiguousarray(t[::every]), np.ascontiguousarray(y[::every])

    def slice(self, start: float, end: float) -> slice:
        """Grid points from ``start`` to ``end``."""
        low, high = np.searchsorted(self.time, [start - 1e-9, end + 1e-9])
        return slice(int(low), int(high))

    def wrist_between(
        self, start: float, end: float, margin: float = 0.05
    ) -> tuple[Array, Array] | None:
        """Time (n,) and wrist position (n, 3) m as measured, smoothed: the nominal servo plus a
        spline of the difference.

        Samples at the arm's rate are too coarse for the finger's inertia; the servo's own motion
        between them is known. None if the wrist was not measured there.
        """
        measured = self.recording.signals.get("real/wrist/state.position")
        if measured is None:
            return None
        part = measured.between(start - margin - 0.02, end + margin + 0.02)
        good = np.all(np.isfinite(part.value), axis=1) if len(part.time) else np.zeros(0, bool)
        t, x = part.time[good], part.value[good]
        if len(t) < 8 or t[0] > start + 0.1 or t[-1] < end - 0.2:
            return None
        grid = np.arange(start - margin, end + margin, GRID)
        if self.wrist is None:
            return grid, np.column_stack([_smooth(t, x[:, i], grid) for i in range(3)])
        cut = self.slice(grid[0] - 0.05, grid[-1] + 0.05)
        out = np.empty((grid.size, 3))
        for i in range(3):
            nominal = np.interp(t, self.time[cut], self.wrist[cut, i])
            servo = np.interp(grid, self.time[cut], self.wrist[cut, i])
            out[:, i] = servo + _smooth(t, x[:, i] - nominal, grid)
        return grid, out

    def pressure_between(self, finger: str, start: float, end: float) -> Array | None:
        """Measured pressure of a finger on the strike's grid, smoothed over 50 ms, Pa; the setpoint
        if not measured.
        """
        grid = start + GRID * np.arange(max(2, round((end - start) / GRID) + 1))
        column = FINGERS.index(finger)
        measured = self.recording.signals.get("real/vacuum/state.measured")
        if measured is not None:
            part = measured.between(start - 0.1, end + 0.1)
            good = np.isfinite(part.value[:, column]) if len(part.time) else np.zeros(0, bool)
            if good.sum() >= 3:
                value = part.value[good, column]
                width = min(9, value.size)
                padded = np.pad(value, width // 2, mode="edge")
                value = np.convolve(padded, np.ones(width) / width, mode="valid")[: good.sum()]
                return np.asarray(np.interp(grid, part.time[good], value))
        if self.setpoint is not None:
            value = np.interp(grid, self.time, self.setpoint[:, column])
            return value if np.all(np.isfinite(value)) else None
        return None


def open_session(recording: Recording, index: int = 0) -> Session:
    """Prepare a recording. Raises :class:`RecordingError` where neither command nor motion of the
    wrist is in it.
    """
    command = recording.signals.get("command/wrist.position")
    measured = recording.signals.get("real/wrist/state.position")
    if command is None and measured is None:
        raise RecordingError(
            f"{recording.source or 'recording'}: diagnosis needs /command/wrist or"
            " /real/wrist/state, and the bag holds neither: without the wrist's motion no strike"
            " can be simulated"
        )
    moves = [s.time for s in (command, measured) if s is not None and len(s.time)]
    if not moves:
        raise RecordingError(f"{recording.source or 'recording'}: the wrist's topics are empty")
    start, end = min(t[0] for t in moves), max(t[-1] for t in moves)
    if not end - start < LONGEST:
        raise RecordingError(
            f"{recording.source or 'recording'}: it lasts {(end - start) / 3600:.1f} h: cut it"
        )
    time = np.arange(start, end + STEP, STEP)
    warnings = list(recording.warnings)
    wrist = None
    if command is not None and len(command.time) >= 8:
        servo = wrist_servo()
        held = _held(command, time)
        wrist = np.column_stack(
            [
                servo_response(
                    np.ascontiguousarray(held[:, i]),
                    STEP,
                    servo.natural_frequency,
                    servo.damping_ratio,
                )
                for i in range(3)
            ]
        )
    else:
        warnings.append("no /command/wrist in the recording: the wrist's own gap cannot be judged")
    signal = _setpoints(recording)
    setpoint = None if signal is None else _held(signal, time)
    return Session(index, recording, time, wrist, setpoint, warnings)


def _setpoints(recording: Recording) -> TimeSeries | None:
    """The setpoints (n, 3) Pa that the regulators had, each since its command: reports are too rare
    to tell when.

    On the grid each is whole at the report that has it first, and not there yet at the one before.
    None if neither reports nor commands were recorded.
    """
    nothing = TimeSeries(np.zeros(0), np.zeros((0, 3)), "Pa")
    reported, command = (
        recording.signals.get(n, nothing)
        for n in ("real/vacuum/state.setpoint", "command/vacuum.pressure")
    )
    if len(reported.time) == 0:
        return command if len(command.time) else None
    time = reported.time.copy()
    for k in np.flatnonzero(np.any(np.diff(reported.value, axis=0) != 0, axis=1)) + 1:
        at = time[k]
        last = int(np.searchsorted(command.time, at, side="right")) - 1
        if last >= 0 and np.allclose(command.value[last], reported.value[k], atol=SETPOINT_STEP):
            at = command.time[last]
        time[k] = min(max(at, reported.time[k - 1] + STEP), reported.time[k] - STEP)
    return TimeSeries(time, reported.value, reported.unit)


def _held(signal: TimeSeries, time: Array) -> Array:
    """The values (n, m) that hold at times (n,) s: each from its stamp on, the first also before
    it.
    """
    at = np.searchsorted(signal.time, time + 1e-6, side="right") - 1
    return np.asarray(signal.value[np.clip(at, 0, len(signal.time) - 1)])


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def servo_response(target: Array, dt: float, omega: float, zeta: float) -> Array:
    """Second-order response (n,) to a target held over each step, by ten exact-enough Runge-Kutta
    free steps of order 4.
    """
    out = np.empty_like(target)
    x, v = target[0], 0.0
    for i in range(target.size):
        out[i] = x
        u = target[i]
        a1 = omega * omega * (u - x) - 2 * zeta * omega * v
        v2 = v + 0.5 * dt * a1
        a2 = omega * omega * (u - x - 0.5 * dt * v) - 2 * zeta * omega * v2
        v3 = v + 0.5 * dt * a2
        a3 = omega * omega * (u - x - 0.5 * dt * v2) - 2 * zeta * omega * v3
        v4 = v + dt * a3
        a4 = omega * omega * (u - x - dt * v3) - 2 * zeta * omega * v4
        x += dt / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return out


def smooth_angle(time: Array, angle: Array, grid: Array) -> tuple[Array, Array]:
    """Measured key angle (n,) at ``time`` as smooth angle and rate on the uniform grid (m,), rad
    and rad/s.
    """
    from scipy.signal import savgol_filter  # takes a second, and no node needs it at its start

    dt = float(np.median(np.diff(time)))
    fine = np.arange(grid[0] - 0.02, grid[-1] + 0.02, GRID)
    raw = (
        np.interp(fine, time, angle)
        if dt <= 1.5 * GRID
        else CubicSpline(time, angle)(np.clip(fine, time[0], time[-1]))
    )
    window = 9 if dt <= 2 * GRID else 2 * int(2 * dt / GRID) + 1
    smooth = savgol_filter(raw, window, 3)
    rate = savgol_filter(raw, window, 3, deriv=1, delta=GRID)
    return np.interp(grid, fine, smooth), np.interp(grid, fine, rate)


def _smooth(t: Array, x: Array, grid: Array) -> Array:
    """Smoothing spline of the samples x (n,) on the grid; a plain mean where nothing but noise is
    left.

    A cubic smoothing spline of penalty lam passes what is slower than (lam dt)^(-1/4) rad/s. Little
    more than the servo's band is kept; more where the deviation stands far out of the noise.
    """
    if np.ptp(x) < 1e-9:
        return np.full(grid.size, float(x.mean()))
    white = float(np.sqrt(np.mean(np.diff(x, 2) ** 2) / 6.0))
    spread = float(np.std(x))
    if spread < 1.2 * white:
        return np.full(grid.size, float(x.mean()))
    cutoff = 250.0 if spread > 10 * white else 90.0
    lam = 1.0 / (float(np.median(np.diff(t))) * cutoff**4)
    return np.asarray(make_smoothing_spline(t, x, lam=lam)(np.clip(grid, t[0], t[-1])))
