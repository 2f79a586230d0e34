"""A robot under a person's hand in a notebook's cell."""

from __future__ import annotations

import threading
from pathlib import Path

from dqcontrol.browser.play.play_page import PlayPage
from dqcontrol.browser.play.session import PlaySession
from dqcontrol.browser.served_page import stop_server
from dqcontrol.experiments.driven import driven_spec


def play(
    source: str = "panda", *, folder: Path | None = None, port: int = 8080, height: int = 640
) -> ShownPlay:
    """Drag the target of a simulated robot, in a notebook's cell or in any browser, while the program goes on.

    Parameters
    ----------
    source
        A robot's name or file; a spec of one run; or the folder of a run.
    folder
        Where recordings are saved; the working directory if omitted.
    port
        Of this machine, where only its own users reach it; the next free one if it is taken.
    height
        Of the cell, pixels.

    Raises
    ------
    Error
        If the source is none of these, or viser is not installed.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> shown = dqc.play("ur5")  # doctest: +SKIP
    >>> shown.session.live.state.pose  # of the hand now, shape (8,)  # doctest: +SKIP
    >>> shown.close()  # doctest: +SKIP
    """
    spec, where = driven_spec(source)
    session = PlaySession(spec, where)
    return ShownPlay(session, PlayPage(session, folder, port), height)


class ShownPlay:
    """A session of play and its page, both in threads of their own; notebooks show it in a cell.

    Attributes
    ----------
    session
        The robot and what it does.
    url
        Of the page, on this machine.
    """

    session: PlaySession
    url: str

    def __init__(self, session: PlaySession, page: PlayPage, height: int) -> None:
        self.session, self.url = session, page.url
        self._page, self._height = page, height
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._work, name="play page", daemon=True)
        session.__enter__()
        self._thread.start()

    def close(self) -> None:
        """Let the robot rest and end the page."""
        if not self._closed.is_set():
            self._closed.set()
            self._thread.join()
            stop_server(self._page.server)
            self.session.__exit__(None, None, None)

    def __repr__(self) -> str:
        return f"ShownPlay({self.url})"

    def _repr_html_(self) -> str:
        """Return what notebooks show."""
        return f'<iframe src="{self.url}" width="100%" height="{self._height}" style="border:none"></iframe>'

    def _work(self) -> None:
        while not self._closed.wait(1 / 30):
            self._page.tick()
