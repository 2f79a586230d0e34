"""The page: a scene to drag in, and a dock with five tabs; in a browser, or in a notebook's cell."""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.browser.drawn import DrawnRobot
from dqcontrol.browser.play.end_effectors import LAW
from dqcontrol.browser.play.session import STIFFNESS, PlaySession
from dqcontrol.browser.play.tabs import Charts, LawTab, RecordTab, RobotTab, TargetTab, WorldTab, called
from dqcontrol.browser.run_view_model import Extent, viewpoint
from dqcontrol.browser.served_page import ServedPage, stop_server
from dqcontrol.experiments.driven import driven_spec
from dqcontrol.figures.style import LIMIT
from dqcontrol.robots import describe
from dqcontrol.robots.poses import pose7

_GHOST, _GHOST_TINT = 0.35, (230, 159, 0)
_ROOM = 0.15  # of the reach, around the robot where it begins
_SMALL = 0.6  # of the size of what lies between hands: their own arrows
_NUDGE = 0.02  # m, of an arrow key
_CHARTS_EVERY = 0.2  # s
_ALONE = 5.0  # s
_WORDS_WIDTH = 300.0  # px
_PULL = (230, 64, 26)


class PlayPage(ServedPage):
    """A browser page that drives a robot; ``serve`` keeps it going.

    Parameters
    ----------
    session
        The robot; started by the caller.
    folder
        Where recordings are saved.
    port
        Of this machine; the next free one if it is taken.
    server
        Where it is to be seen, as ``start_server`` makes it; one is started if omitted.

    Attributes
    ----------
    alone
        Time without any viewer after which the robot rests, s: longer than a page takes to load again.

    Raises
    ------
    MissingExtraError
        If viser is not installed.
    """

    session: PlaySession
    alone: float

    def __init__(
        self, session: PlaySession, folder: Path | None = None, port: int = 8080, *, server: Any = None
    ) -> None:
        super().__init__(port, "dqcontrol play", server)
        folder = folder or Path.cwd()
        self.session, self.alone = session, _ALONE
        self._scenery: Any = None
        self._staged = 0
        self._drawn: DrawnRobot
        self._shown_live: object = None
        self._shown_ghost: object = None
        self._ghost: DrawnRobot | None = None
        self._charted = self._seen_at = 0.0
        self._base: Any = None
        self._spring: list[Any] = []
        self._base_held = False
        self._stage()
        gui = self.server.gui
        self._words = gui.add_html("")
        # Panels beside the first one are folded on phones, where that one would hide the scene. It holds words alone,
        # and floats: docked, it would leave the charts half of their place.
        tabs, charts = gui.add_panel(), gui.add_panel()
        with tabs.add_tab("Target"):
            self._target = TargetTab(self.server, session, folder)
        with tabs.add_tab("Law"):
            self._law = LawTab(gui, session)
        with tabs.add_tab("Robot"):
            self._robot = RobotTab(gui, session)
        with tabs.add_tab("World"):
            self._world = WorldTab(self.server, session)
        with tabs.add_tab("Record"):
            self._replay = RecordTab(self.server, session, folder)
        with charts.add_tab("The last 10 s"):
            self._charts = Charts(gui)
        gui.main_panel.float(x=-12, y=-12, width=_WORDS_WIDTH)
        tabs.dock_right()
        charts.dock_below(tabs)
        self._add_keys()
        self.tick()

    def tick(self) -> None:
        """Draw what has changed."""
        session = self.session
        with session.lock:
            live, ghost = session.live, session.ghost
            q, handles, desired = live.plant.q.copy(), session.ends.handles, live.state.desired
            desired = session.ends.in_room(desired)
            ghost_q = ghost.plant.q.copy() if ghost else None
        if live.robot is not self._drawn.robot or handles.keys() != self._gizmos.keys():
            self._stage()
            self._target.refresh()
        if live is not self._shown_live:
            self._shown_live = live
            self._law.refresh()
            self._robot.refresh()
            self._world.refresh()
            self._held = None
            self._let_pull()
        now = time.monotonic()
        if (replayed := self._replay.replayed(now)) is not None:
            q, desired = replayed
        self._drawn.show(q)
        for name, pose in handles.items():
            self._gizmos[name].visible = not self._target.board.is_shown
            if name != self._held:
                _put(self._gizmos[name], pose)
        if self._base is not None and not self._base_held:
            self._base.wxyz, self._base.position = self._base_pose(q)
        self._draw_ghost(ghost, ghost_q)
        self._draw_pull()
        _put(self._desired, desired)
        self._look_after(now)
        if now - self._charted > _CHARTS_EVERY:
            self._charted = now
            self._charts.show(list(session.history), session.ends.labels)
            self._words.content = self._told()

    # The scene

    def _stage(self) -> None:
        """Draw a robot that was not there before, its floor and its gizmo."""
        robot = self.session.robot
        if self._scenery is not None:
            self._scenery.remove()
        self._scenery = self.server.scene.add_frame(self._new_name("stage"), show_axes=False)
        self._ghost = self._shown_ghost = None  # it was part of that
        root = self._scenery.name
        q = np.array(self.session.spec["start"])
        joints = algebra.translation(robot.frames(q))
        reach = describe(robot).reach
        reach = float(reach) if np.isfinite(reach) and reach else 1.0
        foot, hand = joints[0], algebra.translation(robot.fkm(q))
        low, high = (end(np.vstack([joints, hand]), axis=0) for end in (np.min, np.max))
        low, high = low - _ROOM * reach, high + _ROOM * reach
        low[2] = min(0.0, float(joints[:, 2].min()))
        box = Extent(low, high)
        position, looked_at = viewpoint(foot, [hand[None]], box)
        self._set_scene(position, looked_at, float(np.ceil(4 * reach)), float(low[2]), shadows=0.0)
        self._drawn = DrawnRobot(self.server, robot, f"{root}/robot", axes=0.1 * reach)
        size = 0.12 * reach
        self._desired = self.server.scene.add_frame(
            f"{root}/desired", axes_length=0.5 * size, axes_radius=0.015 * size, origin_radius=0.0
        )
        self._gizmos: dict[str, Any] = {}
        self._held: str | None = None
        handles = self.session.ends.handles
        for name in handles:
            part = 1.0 if name == LAW or LAW not in handles else _SMALL
            gizmo = self.server.scene.add_transform_controls(
                f"{root}/target-{name}", scale=1.6 * part * size, depth_test=False
            )
            gizmo.on_update(self._dragger(name))
            self._gizmos[name] = gizmo
        self._base, self._base_held = None, False
        if robot.bases:
            self._base = self.server.scene.add_transform_controls(
                f"{root}/base-target", scale=4 * size, active_axes=(True, True, False), depth_test=False
            )
            self._base.on_update(self._base_dragged)

    def _new_name(self, kind: str) -> str:
        """Return the name of a node that no other one had: browsers may give nodes the places of former namesakes."""
        self._staged += 1
        return f"/{kind}{self._staged}"

    def _dragger(self, name: str) -> Callable[[Any], Awaitable[None]]:
        """Return what takes the target of a gizmo along, at once and in order: threads may overtake each other."""

        async def dragged(event: Any) -> None:
            self._held = None if event.phase == "end" else name
            self.session.drag(_pose(event.target), name)

        return dragged

    def _base_pose(self, q: Array) -> tuple[Array, Array]:
        """Return where the first base stands: quaternion, and position, m."""
        first = int(self.session.robot.bases[0][0])
        x, y, heading = q[first : first + 3]
        return np.array([np.cos(heading / 2), 0, 0, np.sin(heading / 2)]), np.array([x, y, 0.0])

    def _base_dragged(self, event: Any) -> None:
        """Drive there once the base's target is let go: the hand keeps its pose relative to the base."""
        self._base_held = event.phase != "end"
        if self._base_held:
            return
        live, goal = self.session.live, _pose(event.target)
        if not np.isfinite(goal).all():
            return
        stands = algebra.pose(*self._base_pose(live.plant.q))
        carried = algebra.multiply(goal, algebra.conjugate(stands))
        hand = pose7("hand", algebra.multiply(carried, live.state.pose))
        start = {"position": hand[4:].tolist(), "quaternion": hand[:4].tolist()}
        self.session.follow({"kind": "drive-to", "start": start})

    def _let_pull(self) -> None:
        """Let links be taken by the mouse where there is physics; elsewhere that turns the view."""
        can_be_pulled = self.session.live.plant.can_be_pushed
        for row, node in self._drawn.bodies:
            node.remove_drag_callback()
            if can_be_pulled and row >= 0:
                node.on_drag("left")(self._puller(row))

    def _puller(self, row: int) -> Callable[[Any], Awaitable[None]]:
        """Return what is called, in order, while a link is held."""

        async def pull(event: Any) -> None:
            start, end = (np.asarray(each, np.float64) for each in (event.start_position, event.end_position))
            self.session.pull(row, start, np.full(3, np.nan) if event.phase == "end" else end)

        return pull

    def _draw_pull(self) -> None:
        """Draw the force on a link as an arrow, as long as the spring to the mouse is, and say how strong it is."""
        pulled = self.session.pulled
        if pulled is None:
            for node in self._spring:
                node.remove()
            self._spring = []
            return
        scene, end = self.server.scene, pulled.point + pulled.force / STIFFNESS
        sizes = {"shaft_radius": 0.006, "head_radius": 0.018, "head_length": 0.05}
        arrow = scene.add_arrows("/spring", np.array([[pulled.point, end]]), _PULL, **sizes)
        label = scene.add_label("/spring-force", f"{np.linalg.norm(pulled.force):.0f} N", position=end)
        self._spring = [arrow, label]

    def _draw_ghost(self, ghost: Any, q: Array | None) -> None:
        if ghost is not self._shown_ghost:
            self._shown_ghost = ghost
            if self._ghost is not None:
                self._ghost.remove()
                self._ghost = None
            if ghost is not None:
                look: dict[str, Any] = {"tint": _GHOST_TINT, "opacity": _GHOST, "axes": 0.05}
                name = self._scenery.name + self._new_name("ghost")
                self._ghost = DrawnRobot(self.server, ghost.robot, name, **look)
        if self._ghost is not None and q is not None:
            self._ghost.show(q)

    # The dock

    def _add_keys(self) -> None:
        session, add = self.session, self.server.gui.add_command
        axes = {"left": (1, 1), "right": (1, -1), "up": (2, 1), "down": (2, -1)}
        keys: dict[str, tuple[str, Callable[[], object]]] = {
            "space": ("Pause, go on", lambda: setattr(session, "is_paused", not session.is_paused)),
            "R": ("Reset", session.reset),
            "H": ("Hold here", session.hold),
        }
        for name, (axis, sign) in axes.items():
            keys[f"arrow{name}"] = (f"Target 2 cm {name}", lambda a=axis, s=sign: self._nudge(a, s))
        for i in range(1, 10):
            keys[str(i)] = (f"Scene {i}", lambda i=i: self._target.choose(i))
        for key, (label, does) in keys.items():
            add(label, hotkey=key).on_trigger(called(does))
        self._keys = {key: does for key, (_, does) in keys.items()}

    def _nudge(self, axis: int, sign: int) -> None:
        with self.session.lock:
            handles = self.session.ends.handles
        name = LAW if LAW in handles else next(iter(handles))
        shift = np.zeros(3)
        shift[axis] = sign * _NUDGE
        self.session.drag(algebra.multiply(algebra.pose([1, 0, 0, 0], shift), handles[name]), name)

    def _look_after(self, now: float) -> None:
        """Let the robot rest when nobody has looked for a while."""
        if self.server.get_clients():
            self._seen_at = now
        elif self._seen_at and now - self._seen_at > self.alone:
            self._seen_at, self._held = 0.0, None
            self.session.hold()

    def _told(self) -> str:
        session = self.session
        last = session.told[-1] if session.told else ""
        bad = session.live.is_stopped or "not done" in last
        style = f"color:{LIMIT};font-weight:bold" if bad else ""
        return (
            f"<div style='margin:4px 12px;font-size:0.9em'><b>{html.escape(session.robot.name)}</b>: "
            f"<span style='{style}'>{html.escape(session.words)}</span><br>"
            f"<span style='opacity:0.7'>{html.escape(last)}</span></div>"
        )


def _put(node: Any, pose: Array) -> None:
    """Show a node of the scene at a pose, shape (8,), if it is not there."""
    placed = pose7("pose", pose)
    if not np.allclose(np.append(node.wxyz, node.position), placed, rtol=0, atol=1e-9):
        node.wxyz, node.position = placed[:4], placed[4:]


def _pose(node: Any) -> Array:
    """Return the pose of a node of the scene; NaN if it is none."""
    quaternion, position = np.asarray(node.wxyz, np.float64), np.asarray(node.position, np.float64)
    norm = float(np.linalg.norm(quaternion))
    if not (np.isfinite(position).all() and np.isfinite(norm) and norm > 0.1):
        return np.full(8, np.nan)
    return algebra.pose(quaternion / norm, position)


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
