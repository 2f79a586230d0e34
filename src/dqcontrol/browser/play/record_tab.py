"""What was done: played again, saved as a spec, or as a page that opens without us."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dqcontrol.browser.play.session import PlaySession
from dqcontrol.browser.replay import replay_page
from dqcontrol.browser.run_view_model import Track
from dqcontrol.errors import Error, writing


class RecordTab:
    """Buttons, and the names of files."""

    def __init__(self, server: Any, session: PlaySession, folder: Path) -> None:
        self._session, self._folder = session, folder
        gui = server.gui
        gui.add_markdown("What happened since the robot last began at rest.")
        self._name = gui.add_text("Name", "played")
        for label, does in (
            ("Save as YAML", self._save),
            ("Save as a page (HTML)", self._save_page),
            ("Copy as Python", self._show_python),
        ):
            gui.add_button(label).on_click(lambda _, does=does: self._tried(does))
        self._said = gui.add_markdown("")

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

    def _show_python(self) -> str:
        return f"```python\n{self._session.python()}\n```"
