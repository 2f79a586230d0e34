"""Folders of results: complete or absent, and never overwritten unasked."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from dqcontrol.errors import Error, ExistsError, ValueRangeError, writing

MARK = "spec.yaml"  # every folder of results holds what it came from
OUTSIDE = ".."  # of such a folder: what lies in it and no run wrote keeps it from being replaced
_LONGEST = 200  # bytes of a name; file systems take 255
_CONTENTS = ".dqcontrol-results"  # and the list of all that was written


def check_new(folder: str | Path, *, force: bool) -> None:
    """Raise if a folder must not be written.

    Raises
    ------
    ExistsError
        If it exists, and ``force`` is off or it holds anything but results.
    Error
        If nothing can be written there.
    """
    target = Path(folder)
    if not target.exists() and not target.is_symlink():
        near = next((parent for parent in target.absolute().parents if parent.exists()), Path("/"))
        if not near.is_dir() or not os.access(near, os.W_OK | os.X_OK):
            raise Error(f"{target}: cannot be written: {near} is no folder that may be written")
        return
    if not force:
        raise ExistsError(f"{target}: exists; choose another folder, or replace it with --force (force=True)")
    if target.is_symlink() and target.exists():
        raise ExistsError(f"{target}: is a link; it is never replaced")
    if not (target / _CONTENTS).is_file():
        raise ExistsError(f"{target}: exists and holds no results of a run; it is never replaced")
    written = set((target / _CONTENTS).read_text(encoding="utf-8").splitlines())
    if foreign := sorted(_files(target) - written - {_CONTENTS}):
        raise ExistsError(f"{target}: holds '{foreign[0]}', which no run wrote; it is not replaced")


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
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        yield draft
        note_contents(draft)
        draft.chmod(0o755)
        check_new(target, force=force)
        _replace(target, draft)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


def note_contents(folder: Path) -> None:
    """Remember all that was written to a folder by now, so that it may be replaced when asked."""
    names = sorted(_files(folder) - {_CONTENTS})
    (folder / _CONTENTS).write_text("".join(f"{name}\n" for name in names), encoding="utf-8")


def folder_names(labels: Iterable[str]) -> dict[str, str]:
    """Return a folder name for each label of a run.

    Raises
    ------
    ValueRangeError
        If a label leaves nothing for a name or makes one that is too long, or two labels make the same.
    """
    names: dict[str, str] = {}
    taken: dict[str, str] = {}  # not all file systems tell capitals
    for label in labels:
        name = re.sub(r"[^\w.+-]+", "-", label).strip("-.")
        if not name:
            raise ValueRangeError(f"'{label}': give labels with letters or digits, for the names of folders")
        if len(name.encode()) > _LONGEST:
            raise ValueRangeError(f"'{label:.80}…': makes too long a name for a folder; give shorter labels")
        if (twin := taken.setdefault(name.lower(), label)) is not label:
            raise ValueRangeError(
                f"'{twin}' and '{label}': both would be written to the folder '{name}'; rename one"
            )
        names[label] = name
    return names


def _files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}


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
