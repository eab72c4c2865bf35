"""Pages of other sites stay out.

A browser lets any page open a websocket to this machine, and says which page it was (the header
Origin; RFC 6455, 10.2). viser 1.1.1 does not look at it.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio import server

__all__ = ["is_own", "let_only_own_pages_in"]

_serve = server.serve


def is_own(headers: Mapping[str, str], names: tuple[str, ...]) -> bool:
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
    names = ("localhost", host, socket.gethostname(), socket.getfqdn())

    def serve(handler: Any, *where: Any, process_request: Any = None, **options: Any) -> Any:
        def looked_at(connection: Any, request: Any) -> Any:
            if is_own(request.headers, names):
                return process_request and process_request(connection, request)
            return connection.respond(HTTPStatus.FORBIDDEN, "this page is of another site\n")

        return _serve(handler, *where, process_request=looked_at, **options)

    server.serve = serve  # type: ignore[assignment,misc]
