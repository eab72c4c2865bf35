"""The page: one viser server that draws a tape as of a moment, for any number of browsers."""

from __future__ import annotations

import contextlib
import io
import threading
from pathlib import Path
from typing import Any

import numpy as np
import viser

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.piano.view import html_tables
from pianobot_ros.piano.view.address import DEFAULT_HOST, DEFAULT_PORT, check_address
from pianobot_ros.piano.view.charts import FINGER_COLOURS, ErrorChart, StageChart, signal_charts
from pianobot_ros.piano.view.scene.cell_view import (
    CellView,
    Surroundings,
    build_solver_model,
    magnified,
)
from pianobot_ros.piano.view.scene.posture import Measured, Posture, PostureSolver
from pianobot_ros.piano.view.tape.tape import CELLS, STREAMS, Tape
from pianobot_ros.piano.view.viser_mends import deliver_whatever_the_thread, let_only_own_pages_in

__all__ = ["Page"]

CHART_EVERY = 4  # beats between two updates of the charts
ROLL = 8.0  # s of the piano roll
FRESH = 600.0  # s after its last word in which a job counts as running; its end is told before
HEIGHTS = {"signal": 112, "error": 118, "stage": 168}
FALLBACK_NOTE = 64
ABOVE = 0.02  # m above its key, where nothing was heard of the wrist yet


class Page:
    """Serves from construction until :meth:`close`. Raises PianobotError for an address that is not
    of this machine; a port that is taken gives the next free one.
    """

    def __init__(self, tape: Tape, *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT) -> None:
        check_address(host, port)
        self.tape = tape
        deliver_whatever_the_thread()
        let_only_own_pages_in(host)
        with contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host=host, port=port, label="pianobot", verbose=False)
        self.host = host
        self._beats = 0
        self.drawings = 0
        """How often the charts and the words were drawn."""
        self._html: dict[str, Any] = {}
        self._estimates = False
        self._lock = threading.Lock()
        server: Any = self.server
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.set_panel_label("The gap")
        self._stage = Surroundings(server)
        self._cells = {c: CellView(server, c, ghost=c == "sim") for c in CELLS}
        self._solvers = {c: PostureSolver(build_solver_model()) for c in CELLS}
        self._postures: dict[str, Posture] = {}
        self._show_at_rest()
        self._charts = signal_charts(tape.fsr_note or FALLBACK_NOTE)
        self._build_signals(server.gui)
        self._build_gap(server.gui)

    def _show_at_rest(self) -> None:
        """Until a cell is heard of it stands above the middle of the keyboard, grey."""
        pose = wrist_pose({FINGERS[-1]: FALLBACK_NOTE})
        place = np.array([pose.x, pose.y, pose.z + ABOVE])
        measured = Measured(np.concatenate([place, pose.rotation.as_rotvec()]))
        for cell, view in self._cells.items():
            view.silence(True)
            view.show(self._solvers[cell].solve(measured))

    @property
    def address(self) -> str:
        """Where the page is."""
        host = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host
        return f"http://{host}:{self.server.get_port()}"

    @property
    def clients(self) -> int:
        """Browsers that are looking."""
        return len(self.server.get_clients())

    def _build_signals(self, gui: Any) -> None:
        panel = gui.add_panel()
        with panel.add_tab("Signals"):
            self._put(gui, "legend", html_tables.legend(False, 1.0))
            for chart in self._charts:
                chart.build(gui, HEIGHTS["signal"])
            self._put(gui, "fingers", html_tables.fingers(FINGER_COLOURS))
            self._put(gui, "roll", "")
            self._put(gui, "streams", "")
        panel.dock_left()
        panel.set_width(390)

    def _build_gap(self, gui: Any) -> None:
        self.magnify = gui.add_slider(
            "Ghost ×",
            min=1,
            max=20,
            step=1,
            initial_value=1,
            hint="shows the ghost's distance from the real cell so many times as large",
        )
        dark = gui.add_checkbox("Dark", initial_value=False)
        dark.on_update(
            lambda _: gui.configure_theme(
                dark_mode=dark.value, show_logo=False, show_share_button=False
            )
        )
        self._put(gui, "strikes", html_tables.strike_table(()))
        self._errors = ErrorChart(gui, HEIGHTS["error"])
        self._stages = StageChart(gui, HEIGHTS["stage"])
        self._put(gui, "map", html_tables.gap_table(None))
        self._put(gui, "job", "")
        self._put(gui, "verdict", html_tables.verdict_text(None, ""))
        self._report = gui.add_button("Report", visible=False, hint="gives a link to the report")
        self._report.on_click(self._send_report)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(390)

    def _put(self, gui: Any, name: str, content: str) -> None:
        self._html[name] = gui.add_html(content)

    def _say(self, name: str, content: str) -> None:
        handle = self._html[name]
        if handle.content != content:
            handle.content = content

    def update(self, now: float) -> None:
        """Draw the tape as of ``now``: the scene at every call, the charts at every fourth."""
        with self._lock:
            self._draw_scene(now)
            if self._beats % CHART_EVERY == 0:
                for chart in self._charts:
                    chart.update(self.tape, now)
                self._draw_words(now)
                self.drawings += 1
            self._beats += 1

    def refresh(self) -> None:
        """Let the next update draw everything."""
        self._beats = 0

    # The scene.

    def _draw_scene(self, now: float) -> None:
        for cell in CELLS:
            measured = self._measured(cell, now)
            if measured is not None:
                with contextlib.suppress(PianobotError):  # out of reach: it stays where it was
                    self._postures[cell] = self._solvers[cell].solve(measured)
        with self.server.atomic():
            for cell, view in self._cells.items():
                self._draw_cell(cell, view, now)

    def _draw_cell(self, cell: str, view: CellView, now: float) -> None:
        posture = self._postures.get(cell)
        if posture is None:
            return
        view.silence(self.tape.silent_since(cell, "wrist/state", now) is not None)
        real = self._postures.get("real")
        if cell == "sim" and real is not None:
            posture = magnified(real, posture, float(self.magnify.value))
        view.show(posture)
        view.light(self.tape.sounding(cell, now))

    def _measured(self, cell: str, now: float) -> Measured | None:
        tape = self.tape

        def value(name: str) -> Any:
            found = tape.latest(f"{cell}/{name}", now)
            return None if found is None else found[1]

        position, rotation = value("wrist/state.position"), value("wrist/state.rotation")
        if position is None or rotation is None:
            return None
        pressure = value("vacuum/state.measured")
        keys = {}
        for note in keyboard().notes:
            angle = value(f"key_angle.{note}")
            if angle is not None and np.isfinite(angle):
                keys[note] = float(angle)
        force = value("fsr.force")
        self._estimates |= not keys
        return Measured(
            np.concatenate([position, rotation]),
            value("joint_states.position"),
            np.zeros(3) if pressure is None else np.nan_to_num(pressure),
            keys,
            None if force is None else float(force),
            tape.fsr_note,
        )

    def _send_report(self, event: Any) -> None:
        """Give the browser that asks the report; it may run on another machine than this."""
        path = Path(self.tape.report)
        if event.client is not None and path.is_file():
            event.client.send_file_download(path.name, path.read_bytes())

    # The tables.

    def _draw_words(self, now: float) -> None:
        tape = self.tape
        rows, stages = tape.until(now)
        self._errors.update(rows)
        self._stages.update(stages, rows)
        self._say("strikes", html_tables.strike_table(rows))
        self._say("map", html_tables.gap_table(stages[-1].table if stages else None))
        silent = {(c, s): tape.silent_since(c, s, now) for s in STREAMS for c in CELLS}
        self._say("streams", html_tables.streams(silent, tape.epoch))
        self._say("legend", html_tables.legend(self._estimates, float(self.magnify.value)))
        start = now - ROLL
        with tape.lock:
            notes = {c: [e for e in tape.notes[c] if start - 2 < e.time <= now] for c in CELLS}
            jobs = [j for j in tape.jobs if now - FRESH < j.time <= now]
            verdicts = [v for t, v in tape.verdicts if t <= now]
            said = [text for t, text in tape.said if t <= now]
        self._say("roll", html_tables.piano_roll(notes, start, now, keyboard().notes))
        self._say("job", html_tables.job_text(jobs[-1] if jobs else None))
        verdict = verdicts[-1] if verdicts else None
        self._say(
            "verdict", html_tables.verdict_text(verdict, tape.report, said[-1] if said else "")
        )
        if self._report.visible != (linked := verdict is not None and bool(tape.report)):
            self._report.visible = linked

    def close(self) -> None:
        """Stop serving."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
