"""The page: a scene and its controls, drawn by viser in a browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.browser.drawn import DrawnRobot, DrawnThings
from dqcontrol.browser.run_view_model import Track, extent, numbers, places, step_back, viewpoint
from dqcontrol.browser.served_page import ServedPage
from dqcontrol.figures.robot_bodies import Colour
from dqcontrol.figures.style import COLOURS, DESIRED

SPEEDS = ("0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "5 ×", "10 ×")

_NEWS = 0.2  # s between looks for new samples of a run in progress
_GHOST = 0.35  # opacity of all but the first of runs in one place


class Page(ServedPage):
    """A browser page that shows runs; ``serve`` keeps it going.

    Parameters
    ----------
    tracks
        At least one run.
    port
        Of this machine; the next free one if it is taken.
    news
        Called some times a second while runs last: gives their tracks longer records and tells whether they still go.
    title
        Of the browser's tab.

    Attributes
    ----------
    viewpoint
        Where the viewer stands and what is looked at, both of shape (3,), m.

    Raises
    ------
    MissingExtraError
        If viser is not installed.
    """

    tracks: list[Track]
    viewpoint: tuple[Array, Array]

    def __init__(
        self,
        tracks: Sequence[Track],
        port: int = 8080,
        news: Callable[[], bool] | None = None,
        title: str = "dqcontrol",
    ) -> None:
        super().__init__(port, title)
        self.server.gui.main_panel.dock_right()
        self.tracks, self._news = list(tracks), news
        self._box = extent(tracks)
        self._set_stage()
        self._runs = [
            DrawnRun(self.server, i, track, self._box.size, alone=len(tracks) == 1)
            for i, track in enumerate(tracks)
        ]
        self._add_controls()
        self._seen: object = None
        self._last = self._asked = time.monotonic()
        self.tick()

    @property
    def time(self) -> float:
        """What the slider shows, s."""
        return float(self._time.value)

    def tick(self) -> None:
        """Let the time pass, and draw what has changed."""
        now = time.monotonic()
        passed, self._last = now - self._last, now
        fresh = self._look_for_news(now)
        if self._playing and not self._is_live:
            speed = float(self._speed.value.split()[0])
            self._time.value = min(self._time.value + passed * speed, self._time.max)
            if self._time.value >= self._time.max:
                self._set_playing(False)
        shown = (self._time, self._joint_frames, self._beside, *self._visible)
        wanted = [each.value for each in shown]
        if fresh or wanted != self._seen:
            self._draw()
            self._seen = wanted

    def show_at(self, time: float) -> None:
        """Show a moment, s."""
        self._time.value = min(max(time, 0.0), self._time.max)
        self._draw()

    def show_beside(self) -> None:
        """Put the runs side by side."""
        self._beside.value = True

    def _set_stage(self) -> None:
        box = self._box
        position, looked_at = self.viewpoint = viewpoint(
            self.tracks[0].frames(0)[0, 4:], [track.target for track in self.tracks], box
        )
        self._apart = places(len(self.tracks), box, position - looked_at)
        self._farther = step_back(self._apart, box, position - looked_at)
        side = float(np.ceil(4 * box.size))
        self._set_scene(position, looked_at, side, float(box.lower[2]), shadows=0.25)

    def _add_controls(self) -> None:
        gui = self.server.gui
        self._playing, many = False, len(self.tracks) > 1
        time = self.tracks[0].record.time
        period = float(np.median(np.diff(time))) if len(time) > 1 else 0.01
        self._time = gui.add_slider("Time [s]", 0.0, self._end(), max(round(period, 6), 1e-4), 0.0)
        self._button = gui.add_button("Play")
        self._button.on_click(lambda _: self._set_playing(not self._playing))
        self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1 ×")
        self._live = gui.add_checkbox("Live", self._news is not None, visible=self._news is not None)
        self._beside = gui.add_checkbox("Side by side", False, visible=many)
        self._beside.on_update(lambda _: self._step())
        self._joint_frames = gui.add_checkbox("Frames of all joints", False)
        self._visible = [gui.add_checkbox(track.label, True, visible=many) for track in self.tracks]
        self._numbers = gui.add_html("")

    def _end(self) -> float:
        return max(float(track.record.time[-1]) for track in self.tracks) or 1e-3

    @property
    def _is_live(self) -> bool:
        return self._news is not None and self._live.value

    def _set_playing(self, playing: bool) -> None:
        if playing and self._time.value >= self._time.max:
            self._time.value = 0.0
        self._playing = playing
        self._button.label = "Pause" if playing else "Play"

    def _step(self) -> None:
        """Let all viewers, and those to come, step back from runs side by side, or near again."""
        farther = self._farther if self._beside.value else 1 / self._farther
        cameras = [client.camera for client in self.server.get_clients().values()]
        for camera in (self.server.initial_camera, *(c for c in cameras if c.update_timestamp)):
            looked_at = camera.look_at
            camera.position = looked_at + farther * (camera.position - looked_at)
            camera.look_at = looked_at  # which viser moves along

    def _look_for_news(self, now: float) -> bool:
        """Take over new samples; say whether there were any."""
        if self._news is None or now - self._asked < _NEWS:
            return False
        self._asked = now
        goes_on = self._news()
        if self._end() > self._time.max:
            self._time.max = self._end()
        if self._live.value:
            self._time.value = self._time.max
        for run in self._runs:
            run.redraw_paths()
        if not goes_on:
            self._news, self._live.value, self._live.visible = None, False, False
        return True

    def _draw(self) -> None:
        moved = self._apart if self._beside.value else np.zeros_like(self._apart)
        readings, first = [], True
        with self.server.atomic():
            for run, place, box in zip(self._runs, moved, self._visible, strict=True):
                k = run.track.index(self._time.value)
                run.show(k, place, visible=box.value, joint_frames=self._joint_frames.value)
                run.robot.set_opacity(1.0 if first or self._beside.value else _GHOST)
                first = first and not box.value
                if box.value:
                    readings.append((run.track.label, run.css, run.track.reading(k)))
            self._numbers.content = numbers(readings)


class DrawnRun:
    """The nodes of one run in the scene."""

    def __init__(self, server: Any, i: int, track: Track, size: float, *, alone: bool) -> None:
        self.track = track
        self.css: str = COLOURS[i % len(COLOURS)]
        self._scene, self._name, self._thickness = server.scene, f"/run{i}", 0.0022 * size
        self._colour = rgb(self.css)
        length = min(0.09 * size, 0.12)
        self.robot = DrawnRobot(
            server, track.robot, self._name, tint=None if alone else self._colour, axes=length
        )
        self._desired = self._scene.add_frame(
            f"{self._name}/desired", axes_length=length, axes_radius=0.015 * length, origin_radius=0.0
        )
        self._around = DrawnThings(self._scene, self._name, track, size)
        self.redraw_paths()

    def redraw_paths(self) -> None:
        """Draw the paths of the record as it is now."""
        for name, path, colour, thickness in (
            ("desired_path", self.track.desired_path(), rgb(DESIRED), 0.7 * self._thickness),
            ("hand_path", self.track.hand_path(), self._colour, self._thickness),
        ):
            if len(path):
                self._scene.add_line_segments(f"{self._name}/{name}", path, colour, thickness=thickness)
        for k, made in enumerate(self.track.plans):
            if made.cause:
                node, radius = f"{self._name}/plan{k}", 4 * self._thickness
                self._scene.add_icosphere(node, radius=radius, color=rgb(DESIRED), position=made.place)
                self._scene.add_label(f"{node}/why", made.cause, anchor="bottom-left")

    def show(self, k: int, place: Array, *, visible: bool, joint_frames: bool) -> None:
        """Show a sample."""
        self.robot.set_place(place, visible=visible)
        self.robot.place(self.track.frames(k))
        self.robot.set_joint_frames(shown=joint_frames)
        pose = self.track.desired(k)
        self._desired.wxyz, self._desired.position = pose[:4], pose[4:]
        self._around.show(k)


def rgb(css: str) -> Colour:
    """Return red, green and blue of ``#rrggbb``."""
    r, g, b = (int(css[i : i + 2], 16) for i in (1, 3, 5))
    return r, g, b
