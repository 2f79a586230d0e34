"""Folders of results: complete or absent, and never overwritten unasked."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dqcontrol.errors import Error, ExistsError

MARK = "spec.yaml"  # every folder of results holds it


def check_new(folder: str | Path, *, force: bool) -> None:
    """Raise if a folder must not be written.

    Raises
    ------
    ExistsError
        If it exists, and ``force`` is off or it holds no results.
    """
    target = Path(folder)
    if not target.exists() and not target.is_symlink():
        return
    if not force:
        raise ExistsError(f"{target}: exists; choose another folder, or replace it with --force (force=True)")
    if target.is_symlink() and target.exists():
        raise ExistsError(f"{target}: is a link; it is never replaced")
    if not (target / MARK).is_file():
        raise ExistsError(f"{target}: exists and holds no results of a run (no {MARK}); it is never replaced")


@contextmanager
def new_folder(folder: str | Path, *, force: bool) -> Iterator[Path]:
    """Give a hidden folder beside the target and move it into place when everything has been written.

    Raises
    ------
    ExistsError
        As for `check_new`.
    """
    target = Path(folder)
    check_new(target, force=force)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise Error(f"{target}: cannot be written: {error.strerror or error}") from None
    try:
        yield draft
        draft.chmod(0o755)
        check_new(target, force=force)
        _replace(target, draft)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


def _replace(target: Path, draft: Path) -> None:
    """Move the draft into place; what was there is deleted only after that."""
    if not target.exists():
        draft.rename(target)
        return
    old = draft.with_name(f"{draft.name}-old")
    target.rename(old)
    try:
        draft.rename(target)
    except BaseException:
        old.rename(target)
        raise
    shutil.rmtree(old)
