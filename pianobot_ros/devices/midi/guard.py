"""A small process that releases the notes of a driver that was killed.

RtMidi sends no note-off when a client dies. The guard is told of every held note through a pipe;
when the pipe ends without a farewell it opens the instrument itself, sends the note-offs and
leaves. It costs no time while nothing happens.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence

from pianobot_ros.cell.host.closing import wait_or_kill
from pianobot_ros.devices.base import DeviceUnavailableError
from pianobot_ros.devices.midi.silence import note_off, silence_messages
from pianobot_ros.devices.midi.transport.ports import open_transport

__all__ = ["Guard", "main"]

_ATTEMPTS, _PAUSE = 20, 0.5  # JACK may stall for 5 s after a client was killed
_SETTLE = 0.2  # s between the last message and the end, so that it gets out
_STALL = 6.0  # the same where a server passes messages on: one that stalls does so when it goes on


class Guard:
    """The driver's side."""

    def __init__(self, kind: str, *, client: str, port: str, socket: str) -> None:
        start = "import sys; from pianobot_ros.devices.midi.guard import main; sys.exit(main())"
        command = [sys.executable, "-c", start, kind, client, port, socket]
        # A session of its own: Ctrl-C and a kill of the process group do not reach it.
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True)
        assert self._process.stdin is not None
        self._pipe = self._process.stdin
        os.set_blocking(self._pipe.fileno(), False)

    @property
    def running(self) -> bool:
        """Whether the process is there."""
        return self._process.poll() is None

    def hold(self, channel: int, note: int) -> None:
        """A note begins to sound."""
        self._tell(f"+{channel},{note}\n")

    def release(self, channel: int, note: int) -> None:
        """A note has ended."""
        self._tell(f"-{channel},{note}\n")

    def dismiss(self) -> None:
        """Farewell: nothing sounds any more."""
        self._tell("bye\n")
        with contextlib.suppress(OSError):
            self._pipe.close()
        wait_or_kill(self._process, 2.0)

    def _tell(self, text: str) -> None:
        with contextlib.suppress(OSError):  # a dead guard shows in `running`
            os.write(self._pipe.fileno(), text.encode())


def main(arguments: Sequence[str] | None = None) -> int:
    """The process: arguments KIND CLIENT PORT SOCKET, fed through standard input by
    :class:`Guard`.
    """
    kind, client, port, socket = sys.argv[1:] if arguments is None else arguments
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends with its driver, after it
    held: dict[str, None] = {}
    for line in sys.stdin:
        word = line.strip()
        if word == "bye":
            return 0
        if word.startswith("+"):
            held[word[1:]] = None
        elif word.startswith("-"):
            held.pop(word[1:], None)
    if not held:
        return 0
    notes = [(int(channel), int(note)) for channel, note in (text.split(",") for text in held)]
    for _ in range(_ATTEMPTS):
        try:
            transport = open_transport(
                kind, lambda _: None, client=client, port=port, socket=socket
            )
        except DeviceUnavailableError:
            time.sleep(_PAUSE)
            continue
        for _ in range(2):  # what a server gets before it has connected both ends goes nowhere
            for channel, note in notes:
                transport.send(note_off(channel, note))
            for channel in {channel for channel, _ in notes}:
                transport.send(silence_messages(channel)[0])
            time.sleep(_SETTLE)
        if kind != "socket":
            time.sleep(_STALL)
        transport.close()
        print(f"midi guard: released {len(notes)} note(s) of a driver that died", file=sys.stderr)
        return 0
    print("midi guard: the piano could not be reached to release its notes", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
