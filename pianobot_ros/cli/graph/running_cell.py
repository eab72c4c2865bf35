"""A running cell for the commands ``up`` and ``demo``: supervisor, observer and screen together."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live

from pianobot_ros.cell.host.claims import claim_name, current_domain
from pianobot_ros.cell.host.priority import request_high
from pianobot_ros.cell.numbers.config import config_dir
from pianobot_ros.cli.graph.comparison_table import live_view, strike_line
from pianobot_ros.cli.graph.phrase import played
from pianobot_ros.cli.graph.supervisor import (
    Emulation,
    Supervisor,
    SupervisorError,
    default_nodes,
    new_run_directory,
)
from pianobot_ros.cli.graph.view import open_in_browser

__all__ = ["Stopped", "SupervisedCell", "isolated_emulation", "midi_said", "running_cell"]

READY_TIMEOUT = 300.0  # s; a busy machine compiles for minutes, and a node that dies is noticed
TELL_WAITING = 20.0  # s between two lines about what is waited for
STOPPED = "the controller's program does not run"  # as the arm's driver says it
BEAT = 0.1  # s between two looks at the processes


class Stopped(Exception):  # noqa: N818 (no error: the user asked for it)
    """Ctrl-C or SIGTERM arrived."""


def isolated_emulation(*extra: str) -> Emulation:
    """An emulated cell at addresses of its own, so that several can run on one machine."""
    draw = random.Random(os.urandom(8))
    host = f"127.{draw.randint(1, 250)}.{draw.randint(1, 254)}.{draw.randint(1, 254)}"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    name = f"pianobot-piano-{draw.randrange(10**6)}"
    return Emulation(
        ("--host", host, "--midi-socket", f"127.0.0.1:{port}", "--midi-name", name, *extra)
    )


class SupervisedCell:
    """What a command can do with the running cell. Everything that waits calls :meth:`turn`."""

    def __init__(
        self, supervisor: Supervisor, observer: Any, console: Console, live: Live | None
    ) -> None:
        self.supervisor, self.observer = supervisor, observer
        self.console, self._live = console, live
        self.events: deque[str] = deque(maxlen=50)
        self.note = ""
        self.address = ""
        self._shown = 0
        self._drawn = 0.0
        self.stopping = False

    @property
    def on_screen(self) -> bool:
        """Whether its notes are drawn; else only what is told is seen."""
        return self._live is not None

    def tell(self, line: str) -> None:
        """One line for the user."""
        self.events.append(line)
        if self._live is None:
            self.console.print(line, highlight=False, markup=False, soft_wrap=True)

    def turn(self) -> None:
        """One beat: messages in, processes watched, screen drawn. Raises :class:`Stopped` or
        :class:`SupervisorError`.
        """
        if self.observer is None:
            time.sleep(BEAT)
        else:
            self.observer.spin(BEAT)
        if self.stopping:
            raise Stopped
        self.supervisor.poll()
        if self.observer is None:
            return
        self._tell_address()
        reports = self.observer.reports
        if self._live is None:
            for report in list(reports)[self._shown :]:
                self.console.print(
                    strike_line(report), highlight=False, markup=False, soft_wrap=True
                )
            self._shown = len(reports)
        elif time.monotonic() - self._drawn > 0.25:
            self._live.update(
                live_view(
                    reports, self.observer.states(), self.observer.twin, self.note, self.events
                ),
                refresh=True,
            )
            self._drawn = time.monotonic()

    def _tell_address(self) -> None:
        """Say once where the page is, and open it where somebody sits before a screen."""
        address = self.observer.values.get("viewer", {}).get("address", "")
        if address and not self.address:
            self.address = address
            self.tell(f"in the browser: {address}")
            open_in_browser(address)

    def wait(self, condition: Callable[[], Any], timeout: float, what: Callable[[], str]) -> Any:
        """Turn until the condition holds; raises :class:`SupervisorError` with ``what()`` after
        ``timeout`` s.
        """
        end = time.monotonic() + timeout
        while not (value := condition()):
            if time.monotonic() > end:
                raise SupervisorError(what())
            self.turn()
        return value

    def wait_ready(
        self, names: list[str], timeout: float = READY_TIMEOUT, recover: bool = False
    ) -> None:
        """Wait until every node reports itself without error.

        ``recover``: an arm whose program the controller's watchdog ended while the nodes started
        (which takes all cores of a small machine) is asked to start it again, once. Only for an
        emulated arm: a real one is for its user to release.
        """
        asked, noted = not recover, time.monotonic()

        def missing() -> list[str]:
            nonlocal asked, noted
            states = self.observer.states()
            if not asked and STOPPED in states.get("ur5_wrist", ("", ""))[1]:
                asked = self.observer.recover_arm()
            absent = [
                f"{n} ({': '.join(states[n]) if n in states else 'silent'})"
                for n in names
                if states.get(n, ("error", ""))[0] not in ("ok", "warning")
            ]
            if absent and time.monotonic() - noted > TELL_WAITING:
                noted = time.monotonic()
                self.tell(f"waiting for {', '.join(absent)}")
            return absent

        self.wait(
            lambda: not missing() and ("conductor" not in names or self.observer.conductor_ready()),
            timeout,
            lambda: (
                f"not ready after {timeout:g} s:"
                f" {', '.join(missing()) or 'conductor (no action server)'}; logs in"
                f" {self.supervisor.run}/log"
            ),
        )

    def play(self, timeout: float = 600.0, **request: Any) -> Any:
        """Play a phrase; returns the action's result. A :class:`Stopped` cancels it first."""
        from pianobot_msgs.action import PlayPhrase

        goal = PlayPhrase.Goal(**request)
        return played(self.observer, goal, self.wait, timeout, self._progress)

    def _progress(self, message: Any) -> None:
        f = message.feedback
        self.note = f"strike {f.strike} of {f.total}, note {f.note}, {100 * f.progress:.0f} %"


def _table(console: Console) -> Live:
    return Live(console=console, auto_refresh=False, screen=False, transient=True)


@contextlib.contextmanager
def running_cell(
    *,
    emulated: Emulation | None,
    parameters: dict[str, dict[str, object]] | None = None,
    jobs: bool = True,
    without: Sequence[str] = (),
    screen: bool = True,
    run: Path | None = None,
    view: bool = False,
    domain: int | None = None,
) -> Iterator[SupervisedCell]:
    """A started and ready cell that is brought down in order at the end, whatever happens. Nodes
    ``without`` are not started.
    """
    if domain is not None:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
    if emulated is not None:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    config_dir()  # a wrong one is said before anything starts
    claim = claim_name("graph", current_domain())
    # First of all: importing the ROS wheels may start this Python anew with another environment.
    from pianobot_ros.nodes.watching.observer import Observer

    console = Console(stderr=True)
    folder = new_run_directory() if run is None else run.absolute()
    live = _table(console) if screen and console.is_terminal else None
    supervisor = Supervisor(folder, lambda line: cell.tell(line))  # noqa: PLW0108 (the cell comes after)
    cell = SupervisedCell(supervisor, None, console, live)

    def stop(*_: object) -> None:
        cell.stopping = True

    # Whoever restarts a node must come to run on a busy machine too; its threads inherit this.
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    request_high()
    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with live or contextlib.nullcontext():
            cell.tell(f"run directory: {folder}")
            if emulated is not None:
                supervisor.start_emulation(emulated)
            if cell.stopping:
                raise Stopped
            nodes = default_nodes(supervisor, parameters or {}, jobs, view, without)
            supervisor.start_nodes(nodes)
            cell.observer = Observer()
            needed = [spec.name for spec in nodes if not spec.optional]
            cell.wait_ready(needed, recover=emulated is not None)
            cell.tell(f"MIDI: {midi_said(cell.observer)}")
            yield cell
    finally:
        try:
            supervisor.stop()
        finally:
            if cell.observer is not None:
                cell.observer.close()
            for number, handler in before.items():
                signal.signal(number, handler)
            os.setpriority(os.PRIO_PROCESS, 0, nice)
            claim.close()


def midi_said(observer: Any) -> str:
    """Which way MIDI goes, in the words of the bridge's diagnostics: ALSA, JACK or sockets."""
    return str(observer.values.get("midi_bridge", {}).get("transport", "no bridge"))
