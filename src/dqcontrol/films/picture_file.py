"""Where a picture of physics is to be saved."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.errors import ExistsError, FileFormatError


def check_picture_file(target: Path, *, overwrite: bool) -> None:
    """Say why a picture cannot be saved there, if it cannot.

    Raises
    ------
    FileFormatError
        If its folder does not exist.
    ExistsError
        If the file exists and may not be replaced.
    """
    if not target.parent.is_dir():
        raise FileFormatError(f"{target.parent}: there is no such folder for {target.name}")
    if target.exists() and not overwrite:
        raise ExistsError(
            f"{target}: exists already; choose another name, or replace it with --force (overwrite=True)"
        )
