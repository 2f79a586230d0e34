"""What the tests of commands share."""

import pytest

from dqcontrol.cli import screen


@pytest.fixture(autouse=True)
def _own_columns(monkeypatch):
    """Forget after each test what ``--wide`` and ``--columns`` said: a command is a process of its own."""
    for name in (screen.WIDE, screen.COLUMNS):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
