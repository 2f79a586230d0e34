"""The hidden folder of a study that runs: what is finished stays in it, so that an interrupted study can be resumed."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import TracebackType
from typing import Self

from filelock import FileLock, Timeout

from dqcontrol.errors import Error, ExistsError, writing
from dqcontrol.experiments.results_folder import SPEC_FILE
from dqcontrol.experiments.row_file import import_pyarrow
from dqcontrol.files.yaml_file import read_text

_FINGERPRINT = "fingerprint"
_DRAFT = f".{_FINGERPRINT}.tmp"
_LOCK = "lock"
_FIRST = {_LOCK, SPEC_FILE, _DRAFT}  # what is there before the fingerprint


class WorkingFolder:
    """A folder with a spec and parts of the results; use it in a ``with`` statement.

    Parameters
    ----------
    folder
        Made if missing.
    text
        Of the spec.
    fingerprint
        Hash of what results depend on beside the spec's text.
    force
        Discard what the folder holds of another study.

    Raises
    ------
    ExistsError
        If the folder holds trials of another spec or version (without ``force``), or no trials at all but other files.
    Error
        If another process is at work in it.
    MissingExtraError
        If pyarrow is not installed.
    """

    def __init__(self, folder: Path, text: str, fingerprint: str, *, force: bool = False) -> None:
        import_pyarrow()
        self.folder = folder
        self.recordings: Path = folder / "runs"
        self._text, self._fingerprint = text, fingerprint
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            if not (folder / _FINGERPRINT).exists() and (foreign := _names(folder) - _FIRST):
                raise ExistsError(f"{folder}: holds '{foreign.pop()}' and no unfinished study; move it away")
            self._lock = FileLock(folder / _LOCK, thread_local=False)
            try:
                self._lock.acquire(blocking=False)
            except Timeout:
                raise Error(f"{folder}: another process is at work on this study") from None
        try:
            self._begin(force)
        except BaseException:
            self.close()
            raise

    def _begin(self, force: bool) -> None:
        """Make sure that the folder is this study's, and rid it of what was half-written."""
        mark = self.folder / _FINGERPRINT
        if mark.exists() and (reason := self._differs()):
            if not force:
                raise ExistsError(
                    f"{self.folder}: holds finished trials of {reason}; run that to resume it, or discard them "
                    "with --force (force=True)"
                )
            self._empty()
        for path in (*self.folder.glob(".*.tmp"), *self.recordings.glob("*/.*")):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        if not mark.exists():
            (self.folder / SPEC_FILE).write_text(self._text, encoding="utf-8")
            draft = self.folder / _DRAFT
            draft.write_text(self._fingerprint, encoding="utf-8")
            draft.replace(mark)

    def _differs(self) -> str:
        """Say what the folder belongs to, if not to this study."""
        if read_text(self.folder / SPEC_FILE) != self._text:
            return "another spec"
        if read_text(self.folder / _FINGERPRINT) != self._fingerprint:
            return "another version of dqcontrol, or of a file that the spec names"
        return ""

    def _empty(self) -> None:
        for path in self.folder.glob("part-*"):
            path.unlink()
        shutil.rmtree(self.recordings, ignore_errors=True)
        (self.folder / _FINGERPRINT).unlink()  # last: until then the rest is known to be ours

    def part(self, number: int) -> Path:
        """Return the file of a part."""
        return self.folder / f"part-{number:08d}.parquet"

    def parts(self) -> dict[int, Path]:
        """Return the files of all finished parts by their numbers."""
        return {int(path.stem.partition("-")[2]): path for path in sorted(self.folder.glob("part-*.parquet"))}

    def close(self) -> None:
        """Release the lock."""
        self._lock.release()

    def discard(self) -> None:
        """Remove the folder."""
        self.close()
        shutil.rmtree(self.folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def working_folder(folder: Path) -> Path:
    """Return where the finished trials of a study are kept until its folder is complete."""
    return folder.parent / f".{folder.name}.part"


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}
