"""``dqcontrol --install-completion``: a file of its own, as its imports take a tenth of the time of ``--help``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cyclopts.completion.install import create_install_completion_command

from dqcontrol.cli import app

install_completion: Callable[..., Any] = create_install_completion_command(app.install_completion, True)
