"""The tab of the recording: played again, saved as a spec, or as a page that opens without us."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.browser.play.session import PlaySession
from dqcontrol.browser.replay import replay_page
from dqcontrol.browser.run_view_model import Track
from dqcontrol.errors import Error, writing
from dqcontrol.experiments.result_pages import clip
from dqcontrol.loop.record import Record


class RecordTab:
    """Buttons, and the names of files."""

    def __init__(self, server: Any, session: PlaySession, folder: Path) -> None:
        self._session, self._folder = session, folder
        gui = server.gui
        gui.add_markdown("What happened since the robot last began at rest.")
        self._name = gui.add_text("Name", "played")
        self._replay: Record | None = None
        self._was_paused, self._seen = False, 0.0
        self._button = gui.add_button("Replay")
        self._button.on_click(lambda _: self._end_replay() if self._replay else self._begin_replay())
        self._time = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0, visible=False)
        for label, does in (
            ("Save as YAML", self._save),
            ("Save as a page (HTML)", self._save_page),
            ("Save as a clip (WebP)", self._save_clip),
            ("Show as Python", self._show_python),
        ):
            gui.add_button(label).on_click(lambda _, does=does: self._tried(does))
        self._said = gui.add_markdown("")

    def replayed(self, now: float) -> tuple[Array, Array] | None:
        """Return configuration and desired pose of the replay at a time, s, of any clock; None if there is none."""
        record, passed, self._seen = self._replay, now - self._seen, now
        if record is None:
            return None
        at = float(self._time.value) + min(passed, 0.1)
        self._time.value = min(at, self._time.max)
        k = int(np.abs(record.time - self._time.value).argmin())
        return record.q[k], record.desired_pose[k]

    def _begin_replay(self) -> None:
        """Let the robot stand still, and show what it did."""
        session = self._session
        record = session.record()
        if len(record) < 2:
            self._said.content = "Nothing has happened yet."
            return
        self._was_paused, session.is_paused = session.is_paused, True
        self._time.max, self._time.value = float(record.time[-1]), 0.0
        self._time.visible, self._button.label = True, "End of the replay"
        self._replay = record

    def _end_replay(self) -> None:
        self._replay = None
        self._session.is_paused = self._was_paused
        self._time.visible, self._button.label = False, "Replay"

    def _tried(self, does: Any) -> None:
        try:
            self._said.content = does()
        except Error as error:
            self._said.content = f"**Not done:** {error}"

    def _path(self, ending: str) -> Path:
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in self._name.value)[:60] or "played"
        count, path = 1, self._folder / f"{name}{ending}"
        while path.exists() or path.with_suffix(".csv").exists():
            count += 1
            path = self._folder / f"{name}-{count}{ending}"
        return path

    def _save(self) -> str:
        return self._session.save(self._path(".yaml"))

    def _save_page(self) -> str:
        path = self._path(".html")
        session = self._session
        kept = session.live.law.constraints
        page = replay_page([Track(path.stem, session.robot, session.record(), constraints=kept)], path.stem)
        with writing(path):
            path.write_text(page, encoding="utf-8")
        return f"{path}: {len(page) / 1e6:.1f} MB, opens in any browser"

    def _save_clip(self) -> str:
        path, session = self._path(".webp"), self._session
        self._said.content = "The clip is being drawn …"
        (case,) = session.setting.cases
        kept = session.live.law.constraints
        clip(session.robot, case.plant, session.record(), path, kept)
        return f"{path}: {path.stat().st_size / 1e6:.1f} MB"

    def _show_python(self) -> str:
        return f"```python\n{self._session.python()}\n```"
