"""Units: as declared, as a header says, or as the numbers tell; every guess is said."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.axis.reading.columns.registers import counts_of_a_turn, whole
from pianobot_ros.axis.reading.headers.unit_words import SECONDS, parts_of, unit_of
from pianobot_ros.axis.signals.log_repair import comes_round, despiked, integral
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

TURNING = {"rad": 1.0, "deg": math.pi / 180, "turn": 2 * math.pi}
LINEAR = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
SPEEDS = {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60, "turn/s": 2 * math.pi}
LINEAR_SPEEDS = {"m/s": 1.0, "mm/s": 1e-3, "m/min": 1 / 60, "mm/min": 1e-3 / 60}
HOLE = 2.0
"""Times as long as others, from which a piece of a record has a hole."""
POLES = "erpm"
"""Turns a minute times pole pairs, which nobody states."""
EFFORTS = {
    "mNm": ("Nm", 1e-3),
    "cNm": ("Nm", 1e-2),
    "kNm": ("Nm", 1e3),
    "uNm": ("Nm", 1e-6),
    "kgfcm": ("Nm", 0.0980665),
    "ozin": ("Nm", 0.00706155),
    "lbin": ("Nm", 0.112985),
    "lbft": ("Nm", 1.355818),
    "mA": ("A", 1e-3),
    "kN": ("N", 1e3),
    "daN": ("N", 10.0),
    "lbf": ("N", 4.448222),
    "‰": ("%", 0.1),
}
OF_EFFORT = ("Nm", *EFFORTS, "N", "A", "V", "%", "counts")
VALID = {
    "time": (*SECONDS, "min", "h", "d"),
    "velocity": (*SPEEDS, *LINEAR_SPEEDS),
    "effort": OF_EFFORT,
}
"""Units by role that a user may say; all others are places."""
COUNTED = frozenset({*TURNING, *LINEAR})
"""What an encoder may count so many steps for (`4096/turn`)."""
COUNTS = re.compile(r"(\d+(?:\.\d*)?(?:e[-+]?\d+)?)\s*/\s*(\w+)")
MISTAKEN = {
    "deg": math.degrees(1.0),
    "mm": 1e3,
    "turn": 1 / (2 * math.pi),
    "4096/turn": 4096 / (2 * math.pi),
}
"""Numbers per rad or m of units that one column may have and the one beside it not."""
SAME_SHAPE, APART, AS_FAR = 0.98, 0.4, 0.05
"""Correlation of a command and a position that only a unit or a sign sets apart; the logarithm of
their ratio from which the first is said, and up to which the second."""
GEARED = 0.2
"""Times as far as its command, below which no position that has its shape moves by itself."""
SAME_FACTOR, MOST_WRONG = 1.25, 30.0
"""Ratio within which the joints' factors are one, and the most that a rate is thought wrong by."""
COARSE = 0.008
"""rad; half a degree."""
FULL_CIRCLE = 360.0
"""Degrees."""
HALF_TURN, WHOLE_TURN = 1.1 * math.pi, 2.1 * math.pi
MANY = 3
"""Joints of an arm."""
BESIDE = 0.1
"""Share of the largest angle of a robot that a second joint reaches where more than one moves."""
STRAYING = 0.05
"""Largest share of samples in which something jumps: it is left out where effort is compared."""
FULL_TURNS = 2.2 * math.pi
"""rad; more than twice this, and an angle without a unit is taken as degrees."""


def said_unit(role: str, said: str) -> str:
    """A unit that was said for a role, by the name that it has here; raises GapError on one that
    the role cannot have.
    """
    counts = COUNTS.fullmatch(said.strip())
    places = role not in VALID
    if places and counts and unit_of(counts[2]) in COUNTED:
        made = f"{counts[1]}/{unit_of(counts[2])}"
        angle_scale(made)
        return made
    valid = (*TURNING, *LINEAR) if places else VALID[role]
    unit = said.strip() if said.strip() in valid else unit_of(said)
    if parts_of(unit)[1] in valid:
        return unit
    also = ", or 4096/turn for encoder counts" if places else ""
    raise GapError(f"unknown unit of {role} {said!r}; valid: {', '.join(valid)}{also}")


def angle_scale(unit: str) -> tuple[float, str]:
    """Factor to SI and SI unit of a unit of position; raises GapError on an unknown one."""
    part, whole_unit = parts_of(unit)
    if whole_unit in TURNING:
        return part * TURNING[whole_unit], "rad"
    if whole_unit in LINEAR:
        return part * LINEAR[whole_unit], "m"
    raise GapError(
        f"unknown unit of position {unit!r}; valid: {', '.join([*TURNING, *LINEAR])}, or 4096/turn"
        " for encoder counts"
    )


def extent(columns: Sequence[Array]) -> float:
    """Largest absolute value of some columns, but for a hundredth of the samples of each."""
    sizes = [np.abs(c[np.isfinite(c)]) for c in columns]
    return max((float(np.quantile(s, 0.99)) for s in sizes if s.size), default=0.0)


def guessed_angle(
    columns: Sequence[Array], linear: bool, notes: list[str], turning: float = 1.0
) -> str:
    """Unit of positions without one, from all columns that share it.

    `turning` is how much better effort fits their sine in rad than in degrees (a ratio of squared
    residuals, 1 where nothing is known; see `sine_in_rad`).
    """
    size = extent(columns)
    known = [c[np.isfinite(c)] for c in columns]
    if linear:
        unit = "mm" if size > 5.0 else "m"
        notes.append(f"positions taken as {unit} (up to {size:.4g}); --units position=… says else")
    elif all(whole(c) for c in known if c.size) and 400 < size < 1e9:
        counts = counts_of_a_turn(known)
        unit = f"{counts}/turn"
        notes.append(
            f"positions are whole numbers up to {size:.0f}; taken as encoder counts, {counts} a"
            " turn; --units position=…/turn says else"
        )
    elif any(_in_degrees(c) for c in known):
        unit = "deg"
        notes.append("positions taken as degrees, as they come round at 360")
    elif turning < 0.7 or (size <= _reach(known) and not _steps_of(known, 360.0)):
        unit = "rad"
        notes.append(
            f"positions taken as rad (up to {size:.3g}, no unit stated); say --units position=deg"
            " if not"
        )
    else:
        unit = "deg"
        notes.append(
            f"positions taken as degrees (up to {size:.4g}); say --units position=rad if not"
        )
    return unit


def _in_degrees(y: Array) -> bool:
    """Whether readings (n,) come round at 360."""
    period = comes_round(y)
    return abs(period - FULL_CIRCLE) < 0.01 * FULL_CIRCLE


def _reach(columns: Sequence[Array]) -> float:
    """Largest angle (rad) that joints reach: many of an arm turn once at most, but for one that
    turns on (a wrist's roll) beside others that move and stay within half a turn; and no encoder
    has steps of half a degree and more.
    """
    if max((_grain(c) for c in columns), default=0.0) >= COARSE:
        return HALF_TURN
    if len(columns) < MANY:
        return 2 * FULL_TURNS
    *_, second, largest = sorted(extent([c]) for c in columns)
    return 2 * FULL_TURNS if BESIDE * largest < second < HALF_TURN else WHOLE_TURN


def _grain(y: Array) -> float:
    """The step of which all values of y (n,) are whole multiples, to a hundredth; else 0."""
    levels = np.unique(y)
    apart = np.diff(levels)
    if apart.size < 10:
        return 0.0
    step = float(np.min(apart))
    if step < float(np.max(apart)) / 2**53:  # no number holds such a multiple
        return 0.0
    return step if np.all(np.abs(apart / step - np.round(apart / step)) < 0.01) else 0.0


def sine_in_rad(t: Array, position: Array, effort: Array) -> float:
    """Squared residual of acceleration over effort, speed and the sine of the angle: with an angle
    in rad over one in degrees. Spikes and drop-outs are left out: what is far off by either.
    """
    position, effort = despiked(position, "position", []), despiked(effort, "effort", [])
    ok = np.isfinite(position) & np.isfinite(effort)
    if ok.sum() < 200:
        return 1.0
    q, y = position[ok], effort[ok]
    width = max(3, min(q.size // 20, 15))
    box = np.ones(width) / width

    def smooth(x: Array) -> Array:
        return np.convolve(np.convolve(x, box, "same"), box, "same")

    v = np.gradient(q, t[ok])
    a, slow = smooth(np.gradient(v, t[ok])), smooth(v)
    use = np.abs(a) <= float(np.quantile(np.abs(a), 1.0 - STRAYING))
    use[: 2 * width] = use[-2 * width :] = False
    left = []
    for scale in (1.0, math.pi / 180):
        made = (y, v, np.sign(slow), np.sin(scale * q), np.cos(scale * q))
        x = np.array([smooth(one)[use] for one in made]).T
        x = np.column_stack([(x - x.mean(0)) / (np.std(x, 0) + 1e-12), np.ones(len(x))])
        beta = np.linalg.lstsq(x, a[use], rcond=None)[0]
        left.append(float(np.mean((x @ beta - a[use]) ** 2)))
    if left[1] < 0.02 * float(np.var(a[use])):  # no sine is missing in degrees
        return 1.0
    return left[0] / max(left[1], 1e-300)


def _steps_of(columns: Sequence[Array], turn: float) -> bool:
    """Whether readings have steps of a turn divided by a power of two (an encoder's)."""
    for y in columns:
        step = np.abs(np.diff(y))
        step = step[step > 1e-9]
        if step.size < 20:
            continue
        least = float(np.quantile(step, 0.02))
        power = math.log2(turn / least)
        if 8 <= round(power) <= 20 and abs(power - round(power)) < 0.003:
            return True
    return False


def between(command: Array, position: Array, notes: list[str]) -> tuple[float, float]:
    """Factors for command and position that bring them to one unit, where one is in another.

    Both (n,) on the same rows. A log of a joint that obeys has a slope of 1 between the two. None
    goes further than it is told, and one that a load holds back to less than a fifth of that, which
    would be four times as stiff as the drive, does not keep the command's shape: there is a gear
    between the two. What goes as far as a soft drive may is doubted only.
    """
    both = np.isfinite(command) & np.isfinite(position)
    if both.sum() < 20:
        return 1.0, 1.0
    u, q = command[both], position[both]
    u, q = u - u.mean(), q - q.mean()
    if min(float(np.std(u)), float(np.std(q))) <= 0:
        return 1.0, 1.0
    correlation = float(np.mean(u * q) / (np.std(u) * np.std(q)))
    if abs(correlation) < 0.8:
        return 1.0, 1.0
    ratio = float(np.std(q) / np.std(u))
    for name, factor in MISTAKEN.items():
        if abs(math.log(ratio / factor)) < 0.25:
            notes.append(f"position is in {name} beside the command; scaled by {1 / factor:.4g}")
            return 1.0, 1.0 / factor
        if abs(math.log(ratio * factor)) < 0.25:
            notes.append(f"command is in {name} beside the position; scaled by {1 / factor:.4g}")
            return 1.0 / factor, 1.0
    return _geared(ratio, notes) if correlation > SAME_SHAPE else (1.0, 1.0)


def _geared(ratio: float, notes: list[str]) -> tuple[float, float]:
    """Factors for a command and a position that has its shape, `ratio` times as large: both are
    taken to the side of the gear that moves less, where the joint's gravity turns; or it is said.
    """
    far = f"position moves {ratio:.3g} times as far as the command"
    if math.log(ratio) > APART or ratio < GEARED:
        notes.append(
            f"{far}, as on the other side of a gear: both are taken as the joint's, on the side"
            " that moves less; --units position=… command=… says so if their units differ"
        )
        return (ratio, 1.0) if ratio < 1.0 else (1.0, 1.0 / ratio)
    if math.log(ratio) < -APART:
        how = "if their units differ, --units position=… command=… says so"
        notes.append(f"{far}: {how}")
    return 1.0, 1.0


def upside_down(command: Array, position: Array) -> bool:
    """Whether a position (n,) goes as far as its command (n,) the other way: its encoder counts so.

    That it goes as far tells it from an effort, which a swinging load opposes, too.
    """
    both = np.isfinite(command) & np.isfinite(position)
    if both.sum() < 20:
        return False
    u, q = (y[both] - float(np.mean(y[both])) for y in (command, position))
    sizes = float(np.std(u)), float(np.std(q))
    if min(sizes) <= 0.0 or abs(math.log(sizes[1] / sizes[0])) > AS_FAR:
        return False
    return float(np.mean(u * q)) < -SAME_SHAPE * sizes[0] * sizes[1]


def speed_scale(
    stated: str,
    velocity: Array,
    position: Array,
    t: Array,
    linear: bool,
    notes: list[str],
    counts: str = "",
) -> float:
    """Factor of a velocity column (n,) to SI, checked against the slope of position; it may be in
    the `counts` (`4096/turn`) of its position a second.
    """
    scales = _speeds(stated, LINEAR_SPEEDS if linear else SPEEDS)
    if COUNTS.fullmatch(counts) and whole(velocity[np.isfinite(velocity)]):
        scales["counts/s"] = angle_scale(counts)[0]
    fitted = speed_ratio(velocity, position, t)
    if math.isnan(fitted):
        return scales.get(stated, 1.0)
    unit, scale = min(scales.items(), key=lambda kv: abs(math.log(max(abs(fitted), 1e-9) / kv[1])))
    if stated in scales:
        unit, scale = stated, scales[stated]
    if stated == POLES or abs(math.log(max(abs(fitted), 1e-12) / scale)) > 0.25:
        notes.append(
            f"velocity multiplied by {fitted:.4g}, so that it matches the slope of position"
        )
        return fitted
    if fitted < 0:
        notes.append("velocity counts against position; taken with the other sign")
    if unit not in {stated, "rad/s", "m/s"}:
        notes.append(f"velocity taken as {unit} because it then matches the slope of position")
    return math.copysign(scale, fitted)


def _speeds(stated: str, scales: Mapping[str, float]) -> dict[str, float]:
    """Scales of speeds with that of a stated number of one of them (`10/rpm`)."""
    part, unit = parts_of(stated)
    return {**scales, stated: part * scales[unit]} if unit in scales else dict(scales)


def unexplained(stated: str, velocity: Array, position: Array, t: Array, linear: bool) -> float:
    """How many times larger than its unit says a velocity column (n,) is beside the slope of its
    position (in SI); 1 where a unit explains that, NaN where the two do not tell.
    """
    factor = abs(speed_ratio(velocity, position, t))
    scales = _speeds(stated, LINEAR_SPEEDS if linear else SPEEDS)
    if stated in scales:
        return factor / scales[stated]
    explained = stated == POLES or any(
        abs(math.log(max(factor, 1e-12) / s)) < 0.25 for s in scales.values()
    )
    return 1.0 if explained else factor


def another_rate(factors: Sequence[float], rate: float, stamped: bool) -> str:
    """A note if all joints' velocities had to be multiplied by about one factor that no unit
    explains: another rate (in Hz) would do the same; else "". Two joints at least where the log
    has time stamps; NaN are joints that do not tell.
    """
    factors = [f for f in factors if f > 0]
    if len(factors) < 1 + stamped:
        return ""
    low, high = min(factors), max(factors)
    typical = float(np.median(factors))
    one = high < SAME_FACTOR * low and 1 / MOST_WRONG < typical < MOST_WRONG
    if not one or (low < SAME_FACTOR and high > 1 / SAME_FACTOR):
        return ""
    whose = f"the velocities of {len(factors)} joints" if len(factors) > 1 else "the velocity"
    about = f"{low:.3g} to {high:.3g}" if len(factors) > 1 else f"{low:.3g}"
    fits = f"{rate / typical:.3g}"
    also = "or their unit is another: --units time=…" if stamped else f"--rate {fits} says so"
    return (
        f"{whose} had to be multiplied by {about}: at about {fits} Hz instead of {rate:.4g} Hz, if"
        f" that is true, they fit the positions as they are ({also})"
    )


def speed_ratio(velocity: Array, position: Array, t: Array) -> float:
    """Slope of position (n,) per velocity (n,), both as they stand; NaN where the two differ. What
    the joint did in a hole of the record, its velocities at either end do not tell.
    """
    ok = np.isfinite(position) & np.isfinite(velocity)
    if ok.sum() < 20:
        return math.nan
    x, q = t[ok], position[ok]
    moved = integral(velocity[ok], np.diff(x))
    far = max(1, round(0.3 / max(float(np.median(np.diff(x))), 1e-9)))  # noise and steps count less
    if q.size < 4 * far:
        far = 1
    lasting = x[far:] - x[:-far]
    whole = lasting <= HOLE * float(np.median(lasting))
    slope, speed = (q[far:] - q[:-far])[whole], (moved[far:] - moved[:-far])[whole]
    power = float(np.sum(speed**2))
    if power <= 0:
        return math.nan
    fitted = float(np.sum(slope * speed) / power)
    likeness = fitted * math.sqrt(power / max(float(np.sum(slope**2)), 1e-300))
    return fitted if abs(likeness) >= 0.8 else math.nan  # else too noisy to judge


def by_speed(stated: str, velocity: Array, position: Array, t: Array) -> float:
    """SI per unit of a position (n,) in an unknown unit beside a velocity (n,) in a known one; NaN
    if the two do not tell.
    """
    scale = _speeds(stated, {**SPEEDS, **LINEAR_SPEEDS}).get(stated, math.nan)
    ratio = speed_ratio(velocity, position, t)
    return scale / ratio if ratio > 0 else math.nan


def effort_scale(unit: str) -> tuple[float, str]:
    """Factor and name of the unit that efforts are kept in; unknown units stay as they are."""
    part, whole_unit = parts_of(unit)
    name, factor = EFFORTS.get(whole_unit, (whole_unit, 1.0))
    return part * factor, name
