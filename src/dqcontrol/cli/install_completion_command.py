"""``dqcontrol --install-completion``: a file of its own, as its imports take a tenth of the time of ``--help``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from cyclopts.completion.install import create_install_completion_command

from dqcontrol.cli import whole_app
from dqcontrol.errors import ExistsError


def _write(
    *, shell: Literal["zsh", "bash", "fish", "powershell"], output: Path | None, add_to_startup: bool
) -> Path:
    if output is not None and output.exists():
        raise ExistsError(f"{output}: exists already; choose another name or remove it")
    return whole_app().install_completion(shell=shell, output=output, add_to_startup=add_to_startup)


install_completion: Callable[..., Any] = create_install_completion_command(_write, True)
