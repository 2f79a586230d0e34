"""The tab of the target: scenes, shapes, drawings by mouse or file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.browser.play.board import LEVEL, UPRIGHT, Board
from dqcontrol.browser.play.learnt import learn_in
from dqcontrol.browser.play.scenes import SCENES
from dqcontrol.browser.play.session import PlaySession
from dqcontrol.errors import Error, writing
from dqcontrol.robots import describe

_OWN = "Free"
_OFF = "off"
_DRAWINGS = (".txt", ".svg")


class TargetTab:
    """A scene to choose, and buttons.

    Attributes
    ----------
    board
        To draw on.
    """

    board: Board

    def __init__(self, server: Any, session: PlaySession, folder: Path) -> None:
        self._session, self._folder, self._own = session, folder, dict(session.spec)
        self.board = Board(server, session)
        gui = server.gui
        gui.add_markdown("Drag the arrows and rings in the scene.")
        titles = (_OWN, *(f"{i}. {scene.title}" for i, scene in enumerate(SCENES, 1)))
        self._scene = gui.add_dropdown("Scene", titles)
        self._look_for = gui.add_markdown("")
        self._scene.on_update(lambda _: self._chosen())
        for label, does in (
            ("Hold here", session.hold),
            ("Circle", lambda: self._shape("circle")),
            ("Square", lambda: self._shape("square")),
            ("Reset (R)", session.reset),
        ):
            gui.add_button(label).on_click(called(does))
        self._plane = gui.add_dropdown("Draw with the mouse", (_OFF, UPRIGHT, LEVEL))
        self._plane.on_update(lambda _: self.board.show(self._plane.value))
        file = gui.add_upload_button("Follow a drawing file (.svg, .txt)", mime_type=",".join(_DRAWINGS))
        file.on_upload(lambda _: self._follow(file.value.name, file.value.content))

    def choose(self, number: int) -> None:
        """Choose a scene, from 1; 0: what the page was opened for."""
        self._scene.value = self._scene.options[number]

    def refresh(self) -> None:
        """Put the sheet where another robot can reach it."""
        self._plane.value = _OFF
        self.board.show(_OFF)

    def _chosen(self) -> None:
        at = self._scene.options.index(self._scene.value)
        scene = SCENES[at - 1] if at else None
        self._look_for.content = scene.look_for if scene else ""
        if scene is None:
            self._session.play(self._own)
        else:
            self._session.play(dict(scene.spec), scene.ghost)
            if scene.learns:
                learn_in(self._session, scene.learns)

    def _shape(self, kind: str) -> None:
        reach = float(describe(self._session.robot).reach)
        size = round(0.1 * reach, 3) if np.isfinite(reach) else 0.1
        shapes: dict[str, dict[str, Any]] = {
            "circle": {"radius": size, "duration": 60.0, "turns": 12.0, "plane": "yz"},
            "square": {"side": size, "duration": 12.0, "plane": "yz"},
        }
        self._session.follow({"kind": kind, **shapes[kind]})

    def _follow(self, name: str, content: bytes) -> None:
        """Keep a drawing file beside the recordings, which name it, and follow it."""
        path = self._folder / Path(name).name
        try:
            if path.suffix.lower() not in _DRAWINGS:
                raise Error(f"{path.name}: expected a drawing, {' or '.join(_DRAWINGS)}")
            count = 1
            while path.exists() and path.read_bytes() != content:
                count += 1
                path = self._folder / f"{Path(name).stem}-{count}{path.suffix}"
            with writing(path):
                path.write_bytes(content)
        except Error as error:
            self._session.tell(f"not done: {error}")
            return
        self._session.follow({"kind": "drawing", "file": str(path.resolve())})


def called(does: Callable[[], object]) -> Callable[[Any], None]:
    """Return it as what viser calls."""

    def call(_: Any) -> None:
        does()

    return call
