"""Charts that follow the cells: uPlot through viser, a window of the last seconds each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.piano.view.html_tables import QUIET, REAL, SIM, clock, note_name
from pianobot_ros.piano.view.tape.tape import CELLS, StageGaps, StrikeRow, Tape

__all__ = ["FINGER_COLOURS", "SPAN", "ErrorChart", "SignalChart", "StageChart", "signal_charts"]

SPAN = 6.0  # s shown
STEP = 0.0125  # s between two points
GRID = np.arange(-SPAN, 0.5 * STEP, STEP)
PALETTE = ("#e8590c", "#0a7cff", "#2b8a3e", "#9c36b5", "#c2255c", "#0b7285", "#846a00")
FINGER_COLOURS = dict(zip(FINGERS, PALETTE[2:], strict=False))  # neither real's nor the twin's
_AXIS = {
    "stroke": "#868e96",
    "grid": {"stroke": "rgba(134,142,150,.25)", "width": 1},
    "ticks": {"show": False},
}
AXES = ({**_AXIS, "size": 30}, {**_AXIS, "size": 42})
PADDING = (8, 8, 0, 0)  # px above, right, below, left: the topmost number is seen whole


class _Range:
    """The y axis of a chart: round bounds that hold all finite values and seldom change, since a
    change makes the browser build the chart anew.
    """

    def __init__(self, least: float = 1e-6) -> None:
        self._least = least
        self.low, self.high = 0.0, least

    def holds(self, columns: Sequence[Array]) -> bool:
        """Take in the values shown; False if the bounds have changed."""
        finite = [c[np.isfinite(c)] for c in columns]
        finite = [c for c in finite if c.size]
        if not finite:
            return True
        least = min(float(c.min()) for c in finite)
        most = max(float(c.max()) for c in finite)
        span = max(most - least, self._least)
        fits = self.low <= least and most <= self.high
        if fits and span > 0.35 * (self.high - self.low):
            return True
        step = 10.0 ** np.floor(np.log10(span))
        step *= next(f for f in (0.2, 0.5, 1.0) if span <= 10 * f * step)
        low, high = step * np.floor(least / step), step * np.ceil((least + span) / step)
        same = (low, high) == (self.low, self.high)
        self.low, self.high = float(low), float(max(high, low + step))
        return same

    @property
    def scale(self) -> dict[str, Any]:
        """For uPlot."""
        return {"auto": False, "range": (self.low, self.high)}


@dataclass(frozen=True)
class Curve:
    """One curve of a chart: a ``signal`` (and its ``column``) of a ``cell``, times ``scale``."""

    cell: str
    signal: str
    column: int | None
    scale: float
    colour: str
    dash: bool = False
    label: str = ""


def _resampled(tape: Tape, curve: Curve, at: Array) -> Array | None:
    """The curve at times (n,) s; before its first sample and after its last one those values hold,
    since uPlot draws nothing of a curve with a NaN. None if there is nothing in the window.
    """
    time, value = tape.window(f"{curve.cell}/{curve.signal}", at[0] - 0.2, at[-1])
    if len(time) < 2:
        return None
    if curve.column is not None:
        value = value[:, curve.column]
    good = np.isfinite(value)
    return np.interp(at, time[good], curve.scale * value[good]) if good.any() else None


@dataclass
class SignalChart:
    """Real against simulated for one signal. ``stream`` is the topic that it comes from; its y axis
    spans at least ``least``, so that noise at rest stays small.
    """

    title: str
    stream: str
    curves: tuple[Curve, ...]
    handle: Any = None
    _grey: frozenset[str] = field(default_factory=frozenset)
    _heard: tuple[bool, ...] = ()
    least: float = 1.0
    _range: _Range = field(init=False)

    def __post_init__(self) -> None:
        self._range = _Range(self.least)

    def build(self, gui: Any, height: int) -> None:
        """Add the chart to the panel that is open."""
        self._heard = (False,) * len(self.curves)
        self.handle = gui.add_uplot(
            data=(GRID, *[np.zeros(GRID.size)] * len(self.curves)),
            series=self._series(),
            title=self.title,
            height=height,
            legend={"show": False},
            scales=self._scales(),
            axes=AXES,
            padding=PADDING,
            cursor={"sync": {"key": "signals"}},
        )

    def _scales(self) -> dict[str, Any]:
        # A fixed x axis: with viser's automatic one a chart that was built anew loses its place.
        return {
            "x": {"time": False, "auto": False, "range": (-SPAN, 0.0)},
            "y": self._range.scale,
        }

    def _series(self) -> tuple[dict[str, Any], ...]:
        out: list[dict[str, Any]] = [{"label": "s"}]
        for c, heard in zip(self.curves, self._heard, strict=True):
            one: dict[str, Any] = {
                "label": f"{c.cell} {c.label}".strip(),
                "stroke": QUIET if c.cell in self._grey else c.colour,
                "width": 1.6,
                "show": heard,
                "points": {"show": False},
            }
            out.append(one | ({"dash": [5, 4]} if c.dash else {}))
        return tuple(out)

    def update(self, tape: Tape, now: float) -> None:
        """The last seconds before ``now``; silent cells grey, and said so."""
        at = now + GRID
        found = [_resampled(tape, c, at) for c in self.curves]
        since = {c: tape.silent_since(c, self.stream, now) for c in CELLS}
        grey = frozenset(c for c, t in since.items() if t is not None)
        heard = tuple(f is not None for f in found)
        if (grey, heard) != (self._grey, self._heard):
            self._grey, self._heard = grey, heard
            self.handle.series = self._series()
        said = self.title + "".join(
            f" · {c} silent since {clock(tape.epoch + t)}"
            for c, t in since.items()
            if t is not None and np.isfinite(t)
        )
        if said != self.handle.title:
            self.handle.title = said
        if not self._range.holds([f for f in found if f is not None]):
            self.handle.scales = self._scales()
        low = np.full(at.size, self._range.low)
        self.handle.data = (GRID, *(low if f is None else f for f in found))


def signal_charts(fsr_note: int) -> list[SignalChart]:
    """The charts of the page; the first says what the x axes of all are."""

    def pair(signal: str, column: int | None, scale: float) -> tuple[Curve, ...]:
        return (
            Curve("real", signal, column, scale, REAL),
            Curve("sim", signal, column, scale, SIM, dash=True),
        )

    vacuum = tuple(
        Curve(cell, "vacuum/state.measured", i, 1e-3, colour, cell == "sim", finger)
        for i, (finger, colour) in enumerate(FINGER_COLOURS.items())
        for cell in ("real", "sim")
    )
    key = note_name(fsr_note)
    return [
        SignalChart(
            f"wrist height, mm, over the last {SPAN:.0f} s",
            "wrist/state",
            pair("wrist/state.position", 2, 1e3),
            least=4.0,
        ),
        SignalChart(f"force on {key}, N", "fsr", pair("fsr.force", None, 1.0), least=0.5),
        SignalChart(
            f"angle of {key}, mrad",
            "key_angle",
            pair(f"key_angle.{fsr_note}", None, 1e3),
            least=10.0,
        ),
        SignalChart("vacuum by finger, kPa", "vacuum/state", vacuum, least=10.0),
    ]


def _strike_axis(count: int, values: _Range) -> dict[str, Any]:
    most = 8 * -(-max(count, 8) // 8)
    return {"x": {"time": False, "auto": False, "range": (0.5, most + 0.5)}, "y": values.scale}


CORRECTED_SAID = " · green: corrected twin"
_SHADE: dict[str, Any] = {
    "label": "corrected twin",
    "stroke": "#2b8a3e",
    "width": 0,
    "fill": "rgba(43,138,62,.14)",
    "points": {"show": False},
}


def _shade(corrected: Sequence[bool], values: _Range) -> Array:
    """The curve whose filled area says where the twin that played had adopted something."""
    return np.where(np.array(corrected, dtype=bool), values.high, values.low)


class ErrorChart:
    """Err of Eq. 5, a point for each strike."""

    TITLE = "Err of Eq. 5 by strike, %"

    def __init__(self, gui: Any, height: int) -> None:
        self._shown, self._range = -1, _Range(1.0)
        self.handle = gui.add_uplot(
            data=(np.zeros(0),) * 3,
            series=(
                {"label": "strike"},
                {
                    "label": "Err, %",
                    "stroke": REAL,
                    "width": 1.5,
                    "points": {"show": True, "size": 5, "fill": REAL},
                },
                _SHADE,
            ),
            title=self.TITLE,
            height=height,
            legend={"show": False},
            scales=_strike_axis(0, self._range),
            axes=AXES,
            padding=PADDING,
        )

    def update(self, rows: Sequence[StrikeRow]) -> None:
        """The strikes so far."""
        if len(rows) == self._shown:
            return
        self._shown = len(rows)
        known = [(i, r) for i, r in enumerate(rows, 1) if np.isfinite(r.err)]
        number = np.array([i for i, _ in known], dtype=float)
        err = np.array([100 * r.err for _, r in known])
        corrected = [bool(r.adopted) for _, r in known]
        self._range.holds([np.append(1.1 * err, 0.0)])
        self.handle.scales = _strike_axis(len(rows), self._range)
        self.handle.data = (number, err, _shade(corrected, self._range))
        said = self.TITLE + (CORRECTED_SAID if any(corrected) else "")
        if said != self.handle.title:
            self.handle.title = said


class StageChart:
    """The gap by stage in floors, a line each; the title says which were not measured of late."""

    TITLE = "gap by stage after each strike, × floor"

    def __init__(self, gui: Any, height: int) -> None:
        self._range = _Range(1.0)
        self._shown: tuple[int, tuple[str, ...], bool] = (-1, (), False)
        self.handle = gui.add_uplot(
            data=(np.zeros(0), np.zeros(0)),
            series=({"label": "strike"}, {"label": "gap"}),
            title=self.TITLE,
            height=height,
            legend={"show": False},
            scales=_strike_axis(0, self._range),
            axes=AXES,
            padding=PADDING,
        )

    def update(self, stages: Sequence[StageGaps], rows: Sequence[StrikeRow] = ()) -> None:
        """The stage gaps so far, after the strikes of ``rows``."""
        names = tuple(dict.fromkeys(n for s in stages for n, g in s.gaps.items() if np.isfinite(g)))
        corrected = [s.strike <= len(rows) and _corrected(rows[: s.strike]) for s in stages]
        new = (len(stages), names, any(corrected))
        if not names or new == self._shown:
            return
        if new[1:] != self._shown[1:]:
            self.handle.legend = {"show": True, "live": False}
            self.handle.series = (
                {"label": "strike"},
                *(
                    {
                        "label": name,
                        "stroke": PALETTE[i % len(PALETTE)],
                        "width": 1.6,
                        "points": {"show": True, "size": 4},
                    }
                    for i, name in enumerate(names)
                ),
                *([_SHADE] if any(corrected) else ()),
            )
        self._shown = new
        at = np.array([s.strike for s in stages])
        lines = [_held([s.gaps.get(name, np.nan) for s in stages]) for name in names]
        self._range.holds([*(1.1 * line for line in lines), np.zeros(1)])
        shade = [_shade(corrected, self._range)] if any(corrected) else []
        self.handle.scales = _strike_axis(int(at.max()), self._range)
        self.handle.data = (at, *lines, *shade)
        old = [name for name in names if not np.isfinite(stages[-1].gaps.get(name, np.nan))]
        said = f"{self.TITLE}; {', '.join(old)}: not measured now" if old else self.TITLE
        if said != self.handle.title:
            self.handle.title = said


def _corrected(rows: Sequence[StrikeRow]) -> bool:
    return bool(rows and rows[-1].adopted)


def _held(values: Sequence[float]) -> Array:
    """A line without holes, since uPlot draws nothing of one with a NaN: what was not measured
    stays at its last value, or at the first one that there is.
    """
    line = np.array(values, dtype=float)
    good = np.flatnonzero(np.isfinite(line))
    last = np.searchsorted(good, np.arange(line.size), side="right") - 1
    return np.asarray(line[good[np.maximum(last, 0)]])
