"""What viser 1.1.1 lacks: what other threads say reaches a browser, and pages of other sites stay
out.

viser sets an :class:`asyncio.Event` from whatever thread draws, and once more from its own loop's
thread. Where the first falls between the loop's look at the flag and its waiting, the loop waits
with the flag set; every later call then does nothing, since the flag is set, and that browser is
sent nothing more for good. On a busy machine this happened once in some hours of pages
(``tests/piano/view/test_viser_mends.py`` brings it about in seconds).

A browser lets any page open a websocket to this machine, and says which page it was (the header
Origin; RFC 6455, 10.2). viser does not look at it.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections.abc import Collection, Mapping
from http import HTTPStatus
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio import server

__all__ = ["WakingEvent", "deliver_whatever_the_thread", "is_own", "let_only_own_pages_in"]

_serve = server.serve


class WakingEvent(asyncio.Event):
    """An event that other threads may set: the flag is seen at once, and who waits is woken by a
    call on the loop's own thread, whether the flag was set by then or not.
    """

    _loop: asyncio.AbstractEventLoop | None

    def set(self) -> None:
        """Set the flag; on the thread of the loop that waits also wake who waits. Any other thread
        may have a loop of its own.
        """
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            here = None
        if here is None or here is not self._loop:  # bound to a loop since somebody waited
            self._value = True
            return
        self._value = False  # or the call would not wake who began to wait meanwhile
        super().set()


class _Buffer(AsyncMessageBuffer):  # type: ignore[misc]
    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.message_event = WakingEvent()


def deliver_whatever_the_thread() -> None:
    """Let every server made from now on, and its connections, wait for messages with that event."""
    _infra.AsyncMessageBuffer = _Buffer


def is_own(headers: Mapping[str, str], names: Collection[str]) -> bool:
    """Whether a request comes from a page that this server has sent, or from no page at all.

    The server must have been asked for by an address or one of its ``names``: a foreign name may
    be made to lead here (DNS rebinding).
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    asked = urlsplit(f"//{host}").hostname or ""
    try:
        ipaddress.ip_address(asked)
    except ValueError:
        if asked not in (name.lower() for name in names):
            return False
    return origin is None or urlsplit(origin).netloc == host


def let_only_own_pages_in(host: str) -> None:
    """Let every server made from now on, which is to listen at ``host``, refuse others."""
    names = {"localhost", host, socket.gethostname()}
    # Meanwhile: where no server of names answers, looking it up takes ten seconds.
    look = Thread(target=lambda: names.add(socket.getfqdn()), name="full name", daemon=True)
    look.start()

    def serve(handler: Any, *where: Any, process_request: Any = None, **options: Any) -> Any:
        def looked_at(connection: Any, request: Any) -> Any:
            if is_own(request.headers, tuple(names)):
                return process_request and process_request(connection, request)
            return connection.respond(HTTPStatus.FORBIDDEN, "this page is of another site\n")

        return _serve(handler, *where, process_request=looked_at, **options)

    server.serve = serve  # type: ignore[assignment,misc]
