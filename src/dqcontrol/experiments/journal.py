"""The working folder of a study that runs: finished trials, kept so that an interrupted study can go on."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path
from types import TracebackType

from dqcontrol.errors import Error, ExistsError, FileFormatError
from dqcontrol.experiments.output import MARK
from dqcontrol.experiments.row_file import Row, import_pyarrow, read_rows, write_rows
from dqcontrol.experiments.setting import Setting
from dqcontrol.experiments.trials import Outcome, Trial
from dqcontrol.yaml_file import read_text

_FINGERPRINT = "fingerprint"
_DRAFT = f".{_FINGERPRINT}.tmp"
_LOCK = "lock"
_FIRST = {_LOCK, MARK, _DRAFT}  # what is there before the fingerprint
_EVERY = 2.0  # s between parts


class Journal:
    """A folder with the spec and the rows of its finished trials; use it in a ``with`` statement.

    Parameters
    ----------
    folder
        Made if missing.
    setting
        The study.
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

    def __init__(self, folder: Path, setting: Setting, *, force: bool = False) -> None:
        import_pyarrow()
        self.folder = folder
        self.recordings = folder / "runs"
        self._setting = setting
        self._pending: list[Row] = []
        self._written = time.monotonic()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not (folder / _FINGERPRINT).exists() and (foreign := _names(folder) - _FIRST):
                raise ExistsError(f"{folder}: holds '{foreign.pop()}' and no unfinished study; move it away")
            self._lock: int | None = _locked(folder / _LOCK)
        except Error:
            raise
        except OSError as error:
            raise Error(f"{folder}: cannot be written: {error.strerror or error}") from None
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
                    f"{self.folder}: holds finished trials of {reason}; run that to go on with them, or discard them "
                    "with --force (force=True)"
                )
            self._empty()
        for path in (*self.folder.glob(".*.tmp"), *self.recordings.glob("*/.*")):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        if not mark.exists():
            (self.folder / MARK).write_text(self._setting.text, encoding="utf-8")
            draft = self.folder / _DRAFT
            draft.write_text(self._setting.fingerprint(), encoding="utf-8")
            draft.replace(mark)
        self._next = max((int(path.stem.partition("-")[2]) for path in self._parts()), default=-1) + 1

    def _differs(self) -> str:
        """Say what the folder belongs to, if not to this study."""
        if read_text(self.folder / MARK) != self._setting.text:
            return "another spec"
        if read_text(self.folder / _FINGERPRINT) != self._setting.fingerprint():
            return "another version of dqcontrol, or of a file that the spec names"
        return ""

    def _empty(self) -> None:
        for path in self._parts():
            path.unlink()
        shutil.rmtree(self.recordings, ignore_errors=True)
        (self.folder / _FINGERPRINT).unlink()  # last: until then the rest is known to be ours

    def _parts(self) -> list[Path]:
        return sorted(self.folder.glob("part-*.parquet"))

    def finished(self) -> dict[Trial, Row]:
        """Return the rows of all finished trials.

        Raises
        ------
        FileFormatError
            If a part is damaged.
        """
        rows: dict[Trial, Row] = {}
        for path in self._parts():
            try:
                rows |= {Trial.of(row): row for row in read_rows(path)}
            except (FileFormatError, KeyError) as error:
                raise FileFormatError(
                    f"{path}: is damaged ({error}); remove it to repeat its trials"
                ) from None
        return rows

    def add(self, outcome: Outcome) -> None:
        """Note a finished trial; it reaches the disk within two seconds, or when the journal is closed."""
        self._pending.append(outcome.row)
        if time.monotonic() - self._written > _EVERY:
            self._flush()

    def _flush(self) -> None:
        if self._pending:
            write_rows(self.folder / f"part-{self._next:08d}.parquet", self._pending, {})
            self._pending, self._next = [], self._next + 1
        self._written = time.monotonic()

    def close(self) -> None:
        """Write what is noted, and let others in."""
        try:
            self._flush()
        finally:
            if self._lock is not None:
                os.close(self._lock)
                self._lock = None

    def discard(self) -> None:
        """Remove the folder."""
        self._pending = []
        self.close()
        shutil.rmtree(self.folder)

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def _locked(path: Path) -> int:
    """Return a descriptor of a file that no other living process holds; the lock ends with this process."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        import fcntl
    except ImportError:  # Windows
        return descriptor
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise Error(f"{path.parent}: another process is at work on this study") from None
    return descriptor
