"""Only pages that a server has sent itself may open its WebSocket: browsers let any page try that on any machine."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from dqcontrol.browser.drawn_in_software import told
from dqcontrol.errors import Error

_LOOPBACK = {"127.0.0.1", "localhost", "::1"}


def is_own_page(host: str | None, origin: str | None) -> bool:
    """Return whether a request comes from a page of ours, or from a program that is no browser and names no page.

    Parameters
    ----------
    host
        Header ``Host``: what the browser takes our address for. Names other than those of this machine are refused:
        whoever owns a name may let it mean 127.0.0.1. The port may be that of a tunnel.
    origin
        Header ``Origin``: where the page comes from that asks.

    Examples
    --------
    >>> is_own_page("localhost:8080", "http://localhost:8080"), is_own_page("localhost:8080", "http://elsewhere.org")
    (True, False)
    """
    if origin is None:
        return True
    return urlsplit(f"//{host}").hostname in _LOOPBACK and origin == f"http://{host}"


@contextmanager
def only_own_pages() -> Iterator[None]:
    """Let the WebSocket server that starts meanwhile refuse pages of others; viser has no option for it.

    Raises
    ------
    Error
        If none started that can be told so.
    """
    server: Any = importlib.import_module("websockets.asyncio.server")
    serve, started = server.serve, []

    def guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            headers = request.headers
            if not is_own_page(headers.get("Host"), headers.get("Origin")):
                return connection.respond(403, "only pages of this server may ask it\n")
            headers.pop("Accept-Encoding", None)  # a zipped page could not be told
            return told(process_request(connection, request))

        started.append(arguments)
        return serve(*arguments, process_request=process, **options)

    server.serve = guarded
    try:
        yield
    finally:
        server.serve = serve
    if not started:
        raise Error("view: this viser starts its server in another way; install viser 1.1")
