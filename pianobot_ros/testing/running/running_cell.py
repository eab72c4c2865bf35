"""The whole cell for a test: emulated devices, every node, the twin, in a domain of its own."""

from __future__ import annotations

import contextlib
import json
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

from pianobot_ros.cell.host.closing import Closing
from pianobot_ros.emulator.faults import send_fault
from pianobot_ros.nodes.base.domain import claim_domain
from pianobot_ros.nodes.graph import MODULES, NODES
from pianobot_ros.testing.running.alone import Alone
from pianobot_ros.testing.running.process import Process, Processes
from pianobot_ros.testing.running.ros_context import Ros

__all__ = ["RunningCell"]

READY = 300.0  # s, on a busy machine; the supervisor itself gives up sooner, and says why
READY_LINE = "ready; Ctrl-C stops everything"


class RunningCell(Closing):
    """``pianobot up --emulated`` in a process, and a view of its graph in this one. Ready when the
    constructor returns; a context manager that ends it.

    Args:
        folder: for the run directory ``run`` and the supervisor's log ``up.log``.
        words: further words for ``pianobot up``.
        environment: variables for its processes, beside those of this one.

    Attributes:
        run: the run directory, with the logs of the nodes and the bag.
        domain: ``ROS_DOMAIN_ID`` of the graph.
        ros: a :class:`Ros` in that domain.
        observer: what ``pianobot`` itself knows of the graph: comparisons, states of the nodes.
        processes: for further processes in that domain.
        wait_for: waits for a condition or a future while messages come in, see
            :meth:`Ros.wait_for`; fails at once if the cell's supervisor has ended.

    Raises:
        NotInTime: the graph is not ready in time, with what the supervisor said.
    """

    def __init__(
        self, folder: Path, *words: str, environment: dict[str, str] | None = None
    ) -> None:
        self._held = contextlib.ExitStack()
        self._held.enter_context(Alone())
        self._claim = claim_domain()
        self.domain = self._claim.number
        self.run = folder / "run"
        own = {**(environment or {}), "ROS_DOMAIN_ID": str(self.domain)}
        self.processes = Processes(folder, own)
        self._held.callback(self._claim.close)
        self._held.callback(self.processes.close)
        self._held.callback(self._end_all)
        self.process: Process = self.processes.python(
            "pianobot_ros.cli.app",
            *("up", "--emulated", "--no-tui", "--no-view", "--run", str(self.run), *words),
            log="up",
        )
        self._family: dict[int, psutil.Process] = {}
        self._devices = ""
        try:
            self._join()
        except BaseException:
            self.close()
            raise

    def _join(self) -> None:
        from pianobot_ros.nodes.watching.observer import Observer

        self.ros = self._held.enter_context(Ros(self.domain, self.processes.trouble))
        self.wait_for = self.ros.wait_for
        self.observer = Observer("observer", self.ros.executor)
        self._held.callback(self.observer.close)
        self.wait_for(lambda: READY_LINE in self.said(), lambda: f"ready\n{self.said()}", READY)
        self.wait_for(lambda: not self.unwell(), lambda: f"well: {', '.join(self.unwell())}", READY)

    # The graph.

    def said(self) -> str:
        """What the supervisor has told its user so far."""
        return self.process.output()

    def unwell(self) -> Sequence[str]:
        """Names of the nodes that are silent or report an error."""
        states = self.observer.states()
        names = [spec.name for spec in NODES if not (spec.job or spec.optional)]
        bad = [n for n in names if states.get(n, ("", ""))[0] not in ("ok", "warning")]
        return bad if bad or self.observer.conductor_ready() else ["conductor"]

    def trouble(self) -> str:
        """Why the cell cannot be used for another test; an empty string if it can."""
        if self.process.poll() is not None:
            return f"the supervisor has ended:\n{self.said()}"
        return ", ".join(self.unwell())

    def node(self, name: str) -> psutil.Process | None:
        """The living process of a node of the graph."""
        for child in psutil.Process(self.process.pid).children():
            with contextlib.suppress(psutil.NoSuchProcess):
                if MODULES[name] in child.cmdline() and child.status() != psutil.STATUS_ZOMBIE:
                    return child
        return None

    def family(self) -> dict[int, psutil.Process]:
        """Every process of the cell seen so far, by its id: also those of drivers and devices."""
        with contextlib.suppress(psutil.NoSuchProcess):
            children = psutil.Process(self.process.pid).children(recursive=True)
            self._family |= {p.pid: p for p in children}
        return self._family

    def record(self, kind: Any, topic: str, qos: Any = None) -> list[Any]:
        """A list that fills with the messages of ``topic``, see :meth:`Ros.record`."""
        return self.ros.record(kind, topic, qos)

    # Playing.

    def start(self, phrase: str) -> Any:
        """Start a phrase (YAML); returns the goal's handle once the conductor has accepted it."""
        from pianobot_msgs.action import PlayPhrase

        handle = self.wait_for(
            self.observer.send(PlayPhrase.Goal(phrase_yaml=phrase)), "the conductor's answer"
        )
        assert handle.accepted, "the conductor is playing already"
        return handle

    def play(self, phrase: str, timeout: float = 60.0) -> Any:
        """Play a phrase (YAML) to its end; returns the result of the action."""
        future = self.start(phrase).get_result_async()
        return self.wait_for(future, "the end of the phrase", timeout).result

    # The devices.

    def devices(self) -> Path:
        """Directory with the control sockets and serial ports of the emulated devices."""
        for child in [] if self._devices else self.family().values():
            with contextlib.suppress(psutil.NoSuchProcess):
                if "pianobot_ros.emulator" in (words := child.cmdline()):
                    self._devices = words[words.index("--directory") + 1]
        return Path(self._devices)

    def fault(self, device: str, command: str) -> str:
        """Inject a fault into ``wrist``, ``vacuum``, ``fsr`` or ``midi``, in the words of
        ``pianobot_ros.emulator.faults``; returns the device's answer.
        """
        return send_fault(f"unix:{self.devices() / (device + '.ctl')}", command)

    def status(self, device: str) -> dict[str, Any]:
        """What a device says of itself, for example which notes sound."""
        return dict(json.loads(self.fault(device, "status")))

    # The end.

    def _end_all(self) -> None:
        """The supervisor first, in order; then what it has not ended."""
        family = self.family()
        if self.process.poll() is None:
            with contextlib.suppress(Exception):
                self.process.end(signal.SIGTERM)
        for child in family.values():
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()

    def close(self) -> None:
        """Stop the cell as Ctrl-C does and leave nothing behind. Safe to call twice."""
        self._held.close()
