"""The base of all pages: a server for this machine, a stage with a floor, and a loop that keeps them going."""

from __future__ import annotations

import contextlib
import io
import time
from abc import ABC, abstractmethod
from typing import Any

from dqcontrol.arrays import Array
from dqcontrol.browser.layout import FIELD
from dqcontrol.browser.loop_events import use_loop_events
from dqcontrol.browser.own_origin import only_own_pages
from dqcontrol.errors import from_extra

HOST = "127.0.0.1"  # nobody else's machine: there is no password
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
