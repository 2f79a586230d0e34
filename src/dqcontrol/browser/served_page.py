"""The base of all pages: a server for this machine, a stage with a floor, and a loop that keeps them going."""

from __future__ import annotations

import asyncio
import contextlib
import io
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from importlib import import_module
from typing import Any, Literal
from urllib.parse import urlsplit

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, from_extra

HOST = "127.0.0.1"  # nobody else's machine: there is no password
_LOOPBACK = {HOST, "localhost", "::1"}
FIELD = 0.7  # rad; of view, from bottom to top
_TICK = 1 / 30  # s
_AMBIENT = 1.2  # beside viser's own lights: shadows are not black


def import_viser() -> Any:
    """Return the viser package.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    return from_extra("viser", "view", "pages in a browser")


def start_server(port: int, title: str = "dqcontrol") -> Any:
    """Return a server (``viser.ViserServer``) of pages for this machine alone, with an empty scene.

    Parameters
    ----------
    port
        Of this machine; the next free one if it is taken.
    title
        Of the browser's tab.

    Raises
    ------
    MissingExtraError
        If viser is not installed.
    """
    viser = import_viser()
    use_loop_events()
    with contextlib.redirect_stdout(io.StringIO()), only_own_pages():  # without its banner
        server: Any = viser.ViserServer(host=HOST, port=port, label=title, verbose=False)
    # The usual map of light takes half a minute to draw without a graphics card.
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/light", intensity=_AMBIENT)
    server.gui.configure_theme(control_width="large", show_share_button=False)
    return server


def stop_server(server: Any) -> None:
    """Stop a server, once or more, without a word of viser's."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def address(server: Any) -> str:
    """Return where browsers find a server."""
    return f"http://{HOST}:{server.get_port()}"


class ServedPage(ABC):
    """A browser page; `serve` keeps it going.

    Parameters
    ----------
    port, title
        As for `start_server`.
    server
        Where it is to be seen; one is started if omitted.

    Raises
    ------
    MissingExtraError
        If viser is not installed.
    """

    def __init__(self, port: int, title: str = "dqcontrol", server: Any = None) -> None:
        self.server: Any = server or start_server(port, title)

    @property
    def url(self) -> str:
        """Address of the page."""
        return address(self.server)

    def serve(self) -> None:
        """Keep the page going until interrupted."""
        try:
            while True:
                self.tick()
                time.sleep(_TICK)
        finally:
            stop_server(self.server)

    @abstractmethod
    def tick(self) -> None:
        """Draw what has changed."""

    def _set_scene(
        self, position: Array, looked_at: Array, side: float, height: float, shadows: float
    ) -> None:
        """Look from a position at a point, m, at a floor of a height and with sides of a length, m.

        Without shadows (0) pictures take half the time where no graphics card draws them.
        """
        server = self.server
        server.scene.configure_default_lights(cast_shadow=shadows > 0)
        server.scene.set_up_direction("+z")
        server.initial_camera.position, server.initial_camera.look_at = position, looked_at
        server.initial_camera.fov = FIELD
        server.scene.add_grid(
            "/floor",
            side,
            side,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(228, 230, 234),
            section_color=(196, 200, 206),
            shadow_opacity=shadows,
            position=(0.0, 0.0, min(0.0, height)),
        )


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


@contextlib.contextmanager
def only_own_pages() -> Iterator[None]:
    """Let the WebSocket server that starts meanwhile refuse pages of others; viser has no option for it.

    Browsers let any page try to open a WebSocket on any machine.

    Raises
    ------
    Error
        If none started that can be told so.
    """
    server: Any = import_module("websockets.asyncio.server")
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


# The viewer asks for smooth edges, which take half of each picture there, and has no option for it. What draws is known
# once the viewer itself has looked, with a first context that draws nothing.
_TOLD = b"""
<script>
(() => {
  const own = HTMLCanvasElement.prototype.getContext;
  let isSlow;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    const context = own.call(this, kind, isSlow ? { ...options, antialias: false } : options);
    if (isSlow === undefined && kind === "webgl2" && context) {
      const known = context.getExtension("WEBGL_debug_renderer_info");
      const name = known ? context.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
      isSlow = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
    }
    return context;
  };
})();
</script>
"""
_HEAD = b"<head>"


def told(answer: Any) -> Any:
    """Return an answer of the viewer's server (``websockets.http11.Response``); of its page one that is told."""
    if answer is not None and _HEAD in answer.body:
        answer.body = answer.body.replace(_HEAD, _HEAD + _TOLD, 1)
        del answer.headers["Content-Length"]
        answer.headers["Content-Length"] = str(len(answer.body))
    return answer


class LoopEvent(asyncio.Event):
    """An event that other threads than that of its loop leave alone: messages of pages may come from any.

    Viser sets the event of a buffer of messages where a message comes from, and once more in the loop. The first is an
    error of threads: with two pages it raised now and then, "deque mutated during iteration", which ended the program.
    """

    def __init__(self) -> None:
        super().__init__()
        self._home: asyncio.AbstractEventLoop | None = None

    async def wait(self) -> Literal[True]:
        """Wait in a loop; from now on the event belongs to that."""
        self._home = asyncio.get_running_loop()
        return await super().wait()

    def set(self) -> None:
        """Wake who waits, if this is the thread of their loop."""
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            return
        if self._home in (None, here):
            super().set()


def use_loop_events() -> None:
    """Let all servers of viser that start from now on have such events.

    Raises
    ------
    Error
        If this viser keeps its messages in another way.
    """
    infra: Any = import_module("viser.infra._infra")
    buffer: Any = getattr(infra, "AsyncMessageBuffer", None)
    if "message_event" not in getattr(buffer, "__dataclass_fields__", ()):
        raise Error("view: this viser keeps its messages in another way; install viser 1.1")
    if hasattr(buffer, "has_loop_events"):
        return

    class Buffer(buffer):
        has_loop_events = True

        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.message_event = LoopEvent()

    infra.AsyncMessageBuffer = Buffer
