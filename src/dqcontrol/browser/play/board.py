"""A sheet in the scene that the mouse draws on; the target follows the mouse there."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.browser.play.session import PlaySession
from dqcontrol.figures.robot_bodies import box
from dqcontrol.robots import describe

UPRIGHT, LEVEL = "upright", "level"
_SIZE = 0.7  # of the reach
_THICK = 0.002  # m
_SHEET, _INK = (250, 250, 245), (30, 60, 160)
_MOST = 2000  # points of ink


class Board:
    """A square sheet through the target, and what was drawn on it.

    Attributes
    ----------
    centre, axes
        Of the sheet, m; columns of ``axes`` (3, 3) are to the right, up, and out of it.
    half
        Half of its side, m.
    """

    centre: Array
    axes: Array
    half: float

    def __init__(self, server: Any, session: PlaySession) -> None:
        self._scene, self._session = server.scene, session
        self._nodes: list[Any] = []
        self._strokes: list[list[Array]] = []

    @property
    def is_shown(self) -> bool:
        """Whether there is a sheet to draw on."""
        return bool(self._nodes)

    def show(self, plane: str) -> None:
        """Put an empty sheet through the target, upright or level; take it away for any other word."""
        for node in self._nodes:
            node.remove()
        self._nodes, self._strokes = [], []
        if plane not in (UPRIGHT, LEVEL):
            return
        robot, state = self._session.robot, self._session.live.state
        reach = float(describe(robot).reach)
        self.half = 0.5 * _SIZE * (reach if np.isfinite(reach) and reach else 1.0)
        self.centre = algebra.translation(state.desired)
        ahead = self.centre - algebra.translation(robot.frames(state.q))[0]
        ahead[2] = 0.0
        ahead = ahead / length if (length := np.linalg.norm(ahead)) > 1e-6 else np.array([1.0, 0.0, 0.0])
        out, up = (-ahead, np.array([0.0, 0, 1])) if plane == UPRIGHT else (np.array([0.0, 0, 1]), ahead)
        self.axes = np.column_stack([np.cross(up, out), up, out])
        behind = self.centre - 0.5 * _THICK * out
        sheet = box([2 * self.half, 2 * self.half, _THICK], behind, self.axes)
        node = self._scene.add_mesh_simple(
            "/board", sheet.vertices, sheet.faces, color=_SHEET, opacity=0.5, side="double"
        )
        node.on_drag("left")(self._drawn)
        self._nodes = [node]

    def point(self, eye: Array, towards: Array) -> Array | None:
        """Return where a line of sight meets the sheet, m, at its nearest edge if it misses it; None if it never does.

        Parameters
        ----------
        eye, towards
            Two points of the line, (3,), m.
        """
        out, sight = self.axes[:, 2], towards - eye
        slope = float(out @ sight)
        if abs(slope) < 1e-6 * float(np.linalg.norm(sight)):
            return None
        share = float(out @ (self.centre - eye)) / slope
        if not 0.0 < share < np.inf:
            return None
        seen = self.axes.T @ (eye + share * sight - self.centre)
        return self.centre + self.axes @ np.array([*np.clip(seen[:2], -self.half, self.half), 0.0])

    async def _drawn(self, event: Any) -> None:
        """Take the target along, at once and in order."""
        seen = event.client.camera.position, event.end_position
        eye, towards = (np.asarray(each, np.float64) for each in seen)
        point = self.point(eye, towards)
        if point is None or not np.isfinite(point).all():
            return
        session = self._session
        session.drag(algebra.pose(algebra.rotation(session.live.state.desired), point))
        if event.phase == "start" or not self._strokes:
            self._strokes.append([])
        self._strokes[-1].append(point + 1e-3 * self.axes[:, 2])
        pieces = [stroke[i : i + 2] for stroke in self._strokes for i in range(len(stroke) - 1)][-_MOST:]
        if pieces:
            ink = self._scene.add_line_segments("/ink", np.array(pieces), _INK, thickness=0.004 * self.half)
            self._nodes[1:] = [ink]
