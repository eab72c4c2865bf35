"""A tape played again: timeline, seek, pause, speed, and the jump to the worst strike."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from html import escape
from itertools import pairwise
from typing import Any

from pianobot_ros.piano.view.html_tables import STYLE, clock, note_name
from pianobot_ros.piano.view.page import Page
from pianobot_ros.piano.view.tape.tape import StrikeRow, Tape

__all__ = ["Player", "Replay", "timeline"]

BEAT = 0.05  # s between two updates
SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")


class Player:
    """Where a replay stands: ``position`` s from ``start`` to ``end``, moved by :meth:`advance`."""

    def __init__(self, start: float, end: float) -> None:
        self.start, self.end = start, end
        self.position, self.speed, self.playing = start, 1.0, False

    def advance(self, seconds: float) -> float:
        """Let ``seconds`` of the wall's time pass; the new position. Stops at the end."""
        if self.playing:
            self.position = min(self.end, self.position + self.speed * seconds)
            if self.position >= self.end:
                self.playing = False
        return self.position

    def seek(self, position: float) -> None:
        """Go to a moment, s."""
        self.position = min(max(position, self.start), self.end)


class Replay:
    """Plays the page's tape until :meth:`close`. All browsers see the same moment."""

    def __init__(self, page: Page, start: float, end: float) -> None:
        self.page, self.tape = page, page.tape
        self.player = Player(start, end)
        self._closing = threading.Event()
        self._shown = -1.0
        self._clients = 0
        self._lock = threading.Lock()
        gui: Any = page.server.gui
        panel = gui.add_panel()
        with panel.add_tab("Replay"):
            self._line = gui.add_html("")
            self._slider = gui.add_slider(
                "time, s", min=0.0, max=round(end - start, 2), step=0.01, initial_value=0.0
            )
            self._buttons = gui.add_button_group(
                "go", ("play/pause", "start", "previous", "next", "worst")
            )
            self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        panel.float(x=12, y=12)  # of what the panels at both sides leave
        panel.set_width(468)
        panel.expand()  # on a telephone, too, where it is a section of the sheet
        self._slider.on_update(self._slid)
        self._buttons.on_click(self._pressed)
        self._speed.on_update(lambda _: setattr(self.player, "speed", float(self._speed.value)))
        self._thread = threading.Thread(target=self._run, name="replay", daemon=True)
        self._thread.start()

    def show_strike(self, row: StrikeRow) -> None:
        """Go to the end of a strike's window, where its numbers are known, and pause."""
        self.player.playing = False
        self.player.seek(row.time + 1e-6)

    def redraw(self) -> None:
        """Draw the moment again, as when more has become known of it."""
        self._shown = math.nan

    def worst(self) -> StrikeRow | None:
        """The strike with the largest Err; one that did not sound on both cells counts most."""
        if not self.tape.rows:
            return None
        return max(self.tape.rows, key=lambda r: math.inf if math.isnan(r.err) else r.err)

    def close(self) -> None:
        """Stop playing."""
        self._closing.set()
        self._thread.join()

    def _pressed(self, event: Any) -> None:
        word, rows, now = event.target.value, self.tape.rows, self.player.position
        with self._lock:
            if word == "play/pause":
                if self.player.position >= self.player.end:
                    self.player.seek(self.player.start)
                self.player.playing = not self.player.playing
            elif word == "start":
                self.player.seek(self.player.start)
            elif word == "worst" and (row := self.worst()) is not None:
                self.show_strike(row)
            elif word == "next":
                after = [r for r in rows if r.time > now + 1e-3]
                self.show_strike(after[0]) if after else None
            elif word == "previous":
                before = [r for r in rows if r.time < now - 1e-3]
                self.show_strike(before[-1]) if before else None

    def _slid(self, event: Any) -> None:
        if event.client is not None:  # moved by a person, not by the replay
            with self._lock:
                self.player.seek(self.player.start + float(self._slider.value))

    def _run(self) -> None:
        last = time.monotonic()
        while not self._closing.is_set():
            now = time.monotonic()
            with self._lock:
                position = self.player.advance(now - last)
            last = now
            clients = self.page.clients
            if clients and (position != self._shown or clients != self._clients):
                if not self.player.playing:
                    self.page.refresh()
                self._show(position)
            self._clients = clients
            self._closing.wait(max(0.005, BEAT - (time.monotonic() - now)))

    def _show(self, position: float) -> None:
        self._shown = position
        self.page.update(position)
        at = round(position - self.player.start, 2)
        if self._slider.value != at:
            self._slider.value = at
        text = timeline(self.tape, self.player.start, self.player.end, position)
        words = f"{text}<div class='pb'>{clock(self.tape.epoch + position)}</div>"
        if self._line.content != words:
            self._line.content = words


def timeline(tape: Tape, start: float, end: float, now: float) -> str:
    """A strip with a mark for each strike (as high as its Err), faults below, where the twin
    adopted or forgot something, and where the replay is.
    """
    width, height = 540.0, 46.0

    def x(at: float) -> float:
        return width * (at - start) / max(end - start, 1e-9)

    rows, faults = tape.rows, tape.faults
    known = [r.err for r in rows if math.isfinite(r.err)]
    most = max(known, default=0.0) or 1.0
    marks = [_strike_mark(row, x, most, now) for row in rows]
    for fault in faults:
        marks.append(
            f'<rect x="{x(fault.time):.1f}" y="34" height="6" fill="#c2255c" width='
            f'"{max(x(fault.end) - x(fault.time), 3):.1f}"><title>{escape(fault.text)}</title>'
            "</rect>"
        )
    for before, row in pairwise(rows):
        if row.adopted != before.adopted:
            said = f"the twin adopted {', '.join(row.adopted)}" if row.adopted else "it forgot"
            marks.append(
                f'<rect x="{x(0.5 * (before.time + row.start)):.1f}" y="0" height="40" width="2"'
                f' fill="#2f9e44"><title>{escape(said)}</title></rect>'
            )
    below = (
        ""
        if not faults
        else f" · {len(faults)} {'fault' if len(faults) == 1 else 'faults'} below the line"
    )
    said = "".join(f"<br><span class='dim'>{escape(text)}</span>" for text in tape.remarks)
    here = x(now)
    return (
        f'{STYLE}<div class="pb" data-part="timeline" data-at="{now - start:.3f}">'
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="100%"><line x1="0" x2="{width}" y1="31" y2="31" stroke="currentColor" '
        f'opacity=".4"/>{"".join(marks)}<line x1="{here:.1f}" x2="{here:.1f}" y1="0" '
        f'y2="{height}" stroke="currentColor" stroke-width="1.5"/></svg>'
        f"<span class='dim'>{len(rows)} strikes, higher means larger Err{below}</span>{said}</div>"
    )


def _strike_mark(row: StrikeRow, x: Callable[[float], float], most: float, now: float) -> str:
    lost = not math.isfinite(row.err)
    tall = 26.0 if lost else 4.0 + 22.0 * row.err / most
    colour = "#c2255c" if lost else "#e8590c"
    err = f"Err {100 * row.err:.1f} %"
    if lost:
        err = "not sounded" if None in (row.real, row.sim) else "not comparable"
    return (
        f'<rect x="{x(row.start):.1f}" y="{30 - tall:.1f}" height="{tall:.1f}" width='
        f'"{max(x(row.time) - x(row.start) - 1, 2):.1f}" fill="{colour}" opacity='
        f'"{1.0 if row.start <= now else 0.35}"><title>strike {row.index + 1}, '
        f"{note_name(row.note)} {escape(row.condition)}: {err}</title></rect>"
    )
