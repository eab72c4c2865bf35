"""A pseudo-terminal that looks like a serial device with a stable name, and whose cable can be
pulled.
"""

from __future__ import annotations

import contextlib
import os
import tty
from pathlib import Path

from pianobot_ros.cell.errors import DeviceError

__all__ = ["SerialPort"]


class SerialPort:
    """The device's end of a pseudo-terminal; ``link`` is a symbolic link to the host's end.

    The slave is kept open here too, so that a host may open and close it without the device
    noticing, as with a cable. Raises :class:`DeviceError` if ``link`` exists and is not a symbolic
    link, or if the system gives no terminal.
    """

    def __init__(self, link: str | Path) -> None:
        self.link = Path(link).expanduser()
        self._master = -1
        self._slave = -1
        self.overruns = 0
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether the cable is in."""
        return self._master >= 0

    def fileno(self) -> int:
        """Descriptor for ``select``; -1 while unplugged."""
        return self._master

    def plug(self) -> None:
        """Put the cable in: a new terminal appears under the same link."""
        if self.plugged:
            return
        if self.link.exists() and not self.link.is_symlink():
            raise DeviceError(
                f"{self.link} exists and is no symbolic link: remove it or choose another --link"
            )
        try:
            self._master, self._slave = os.openpty()
        except OSError as error:
            raise DeviceError(
                f"no pseudo-terminal for {self.link} ({error.strerror}): mount devpts at /dev/pts,"
                " with /dev/ptmx for this user, or end what holds too many"
            ) from error
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.link.parent.mkdir(parents=True, exist_ok=True)
        fresh = self.link.with_name(f"{self.link.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self.link)

    def unplug(self) -> None:
        """Pull the cable: the terminal is gone, and a host that reads it gets an error at once."""
        if not self.plugged:
            return
        self._remove_link()
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def _remove_link(self) -> None:
        with contextlib.suppress(OSError):
            # Another device may have taken the name meanwhile; its link stays.
            if self.link.readlink() == Path(os.ttyname(self._slave)):
                self.link.unlink()

    def write(self, data: bytes) -> None:
        """Send; what a host that does not read leaves no room for is lost, as on a wire."""
        if not self.plugged:
            return
        try:
            if os.write(self._master, data) < len(data):
                self.overruns += 1
        except BlockingIOError:
            self.overruns += 1
        except OSError:  # the host's end is in an odd state for a moment
            self.overruns += 1

    def read(self) -> bytes:
        """What has come from the host, or nothing."""
        if not self.plugged:
            return b""
        try:
            return os.read(self._master, 4096)
        except OSError:
            return b""

    def close(self) -> None:
        """Unplug for good."""
        self.unplug()
