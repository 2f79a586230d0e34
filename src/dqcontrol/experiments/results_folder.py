"""Folders of results, complete or absent and never overwritten unasked, and the rows of trials in them."""

from __future__ import annotations

import glob
import io
import os
import re
import shutil
import tempfile
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Self, TypeVar

from filelock import FileLock, Timeout

from dqcontrol.errors import Error, ExistsError, FileFormatError, ValueRangeError, from_extra, writing
from dqcontrol.files.input_file import read_text
from dqcontrol.files.output_file import whole_file
from dqcontrol.measures.metric_tables import METRIC_COLUMNS, TEXTS
from dqcontrol.tables.tables import Tabled

Found = TypeVar("Found")
Row = dict[str, float | int | str | None]

SPEC_FILE = "spec.yaml"  # every folder of results holds what it came from
PARENT = ".."  # of such a folder: what lies in it and no run wrote keeps it from being replaced
_LONGEST = 200  # bytes of a name; file systems take 255
_CONTENTS = ".dqcontrol-results"  # and the list of all that was written
_SAVING = ".saving"  # in it, while something is added


def made_folder(folder: str | Path, *, force: bool) -> Path:
    """Make a new folder; with ``force`` it may exist, and what is in it stays.

    Raises
    ------
    ExistsError
        If it exists, without ``force``.
    Error
        If nothing can be written there.
    """
    made = Path(folder)
    if not force:
        check_new(made, force=False)
    made.mkdir(parents=True, exist_ok=True)
    return made


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
    _check_free(target, force=force)
    near = next((parent for parent in target.absolute().parents if parent.exists()), Path("/"))
    try:  # rights alone do not tell: the file system may be read-only or full
        Path(tempfile.mkdtemp(prefix=".dqcontrol-", dir=near)).rmdir()
    except OSError as error:
        raise Error(f"{target}: cannot be written: {near}: {error.strerror}") from None


def _check_free(target: Path, *, force: bool) -> None:
    """Raise an `ExistsError` if a folder exists, and ``force`` is off or it holds anything but results."""
    _clear_up(target)
    if not target.exists() and not target.is_symlink():
        return
    if not force:
        raise ExistsError(f"{target}: exists; choose another folder, or replace it with --force (force=True)")
    if target.is_symlink() and target.exists():
        raise ExistsError(f"{target}: is a link; it is never replaced")
    if not (target / _CONTENTS).is_file():
        raise ExistsError(f"{target}: exists and holds no results of a run; it is never replaced")
    try:
        written = set((target / _CONTENTS).read_text(encoding="utf-8").splitlines())
    except (OSError, UnicodeDecodeError) as error:
        why = "is no text" if isinstance(error, UnicodeDecodeError) else error.strerror
        raise ExistsError(
            f"{target}: what a run wrote is not known, as {_CONTENTS} {why}; it is not replaced"
        ) from None
    if foreign := sorted(_files(target) - written - {_CONTENTS} - _being_saved(target)):
        raise ExistsError(f"{target}: holds '{foreign[0]}', which no run wrote; it is not replaced")


@contextmanager
def told_first(computed: Callable[[Found], None] | None, found: Found) -> Iterator[None]:
    """Tell what was found, then save it, whatever became of telling: whom it is told to may have closed the pipe."""
    try:
        if computed:
            computed(found)
    finally:
        yield


@contextmanager
def new_folder(folder: str | Path, *, force: bool) -> Iterator[Path]:
    """Give a hidden folder beside the target and move it into place when everything has been written.

    Raises
    ------
    ExistsError
        As for `check_new`.
    """
    target = Path(folder)
    _check_free(target, force=force)
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
        lock = FileLock(_lock_of(draft))
        try:
            lock.acquire()
            (draft / _CONTENTS).touch()  # says that it is ours, if this process is killed
            yield draft
            note_contents(draft)
            draft.chmod(0o755)
            _check_free(target, force=force)
            _replace(target, draft)
        except BaseException:
            shutil.rmtree(draft, ignore_errors=True)
            raise
        finally:
            lock.release()
            _lock_of(draft).unlink(missing_ok=True)


class SavedTable(Tabled):
    """A result with files of its own beside its table."""

    @abstractmethod
    def write(self, folder: Path) -> None:
        """Write its files into an existing folder."""

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write its files into a new folder.

        Raises
        ------
        ExistsError
            If the folder exists (without ``force``).
        """
        with new_folder(folder, force=force) as new:
            self.write(new)
        return Path(folder)


@contextmanager
def added_files(folder: Path, results: Path | None = None) -> Iterator[Path]:
    """Give a hidden folder inside one of results; what was written to it is then moved there.

    Killed at any moment, the folder holds what it held before, and may be replaced when asked. If it is only a part of
    a folder of ``results``, that one remembers what was written.
    """
    results = results or folder
    inside = folder.relative_to(results)
    draft = folder / _SAVING
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    try:
        yield draft
        note_contents(results, more=((inside / name).as_posix() for name in _files(draft)))
        for name in _files(draft):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (draft / name).replace(folder / name)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    note_contents(results)


def _being_saved(folder: Path) -> set[str]:
    """Return the files of `added_files` that a killed process left."""
    return {name for name in _files(folder) if f"{_SAVING}/" in name or name.endswith(f".{_CONTENTS}")}


def _clear_up(target: Path) -> None:
    """Remove the hidden folders that killed processes left beside a target; an earlier one is put back in its place."""
    if not target.parent.is_dir():
        return
    for draft in target.parent.glob(f".{glob.escape(target.name)}-*"):
        if not re.fullmatch(r"\w{8}(-old)?", draft.name[len(target.name) + 2 :]) or draft.is_symlink():
            continue
        if not (draft / _CONTENTS).is_file():
            continue
        with suppress(OSError), FileLock(_lock_of(draft), blocking=False):  # a `Timeout`, one too, if in use
            if draft.name.endswith("-old") and not target.exists():
                draft.rename(target)
            else:
                shutil.rmtree(draft)
        if not draft.exists():
            _lock_of(draft).unlink(missing_ok=True)


def _lock_of(draft: Path) -> Path:
    """Return what the maker of a hidden folder locks: a file beside it, as Windows moves no folder with one in use."""
    return draft.with_name(f"{draft.name.removesuffix('-old')}.lock")


def note_contents(folder: Path, more: Iterable[str] = ()) -> None:
    """Remember what was written to a folder by now, and what more will be, so that it may be replaced when asked."""
    names = sorted({*_files(folder), *more} - {_CONTENTS} - _being_saved(folder))
    with whole_file(folder / _CONTENTS, overwrite=True) as draft:
        draft.write_text("".join(f"{name}\n" for name in names), encoding="utf-8")


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


def import_pyarrow() -> ModuleType:
    """Return pyarrow, or say how to install it.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    from_extra("pyarrow.parquet", "data", "tables of trials")
    return from_extra("pyarrow", "data", "tables of trials")


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], notes: Mapping[str, str]) -> None:
    """Write rows to a Parquet file, which appears whole or not at all.

    Parameters
    ----------
    path
        The file.
    rows, notes
        As for `parquet`.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    Error
        If the file cannot be written.
    """
    write_whole(path, parquet(rows, notes))


def parquet(rows: Sequence[Mapping[str, Any]], notes: Mapping[str, str]) -> bytes:
    """Return rows as the content of a Parquet file.

    Parameters
    ----------
    rows
        One mapping a row; what one lacks is missing there.
    notes
        Texts for the file's metadata. The units of the metrics are in those of their columns.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    """
    arrow = import_pyarrow()
    names = list(dict.fromkeys(name for row in rows for name in row))
    arrays = [arrow.array([row.get(name) for row in rows]) for name in names]
    arrays = [
        array.cast(arrow.string() if name in TEXTS else arrow.float64())
        if array.type == arrow.null()
        else array
        for name, array in zip(names, arrays, strict=True)
    ]
    schema = arrow.schema(
        [
            arrow.field(name, array.type, metadata=_unit(name))
            for name, array in zip(names, arrays, strict=True)
        ],
        metadata=dict(notes),
    )
    content = io.BytesIO()
    arrow.parquet.write_table(arrow.table(arrays, schema=schema), content)
    return content.getvalue()


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, which appears whole or not at all.

    Raises
    ------
    Error
        If it cannot be written.
    """
    draft = path.with_name(f".{path.name}.tmp")
    with writing(path):
        with open(draft, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(path)


def join_files(parts: Sequence[Path], target: Path, notes: Mapping[str, str]) -> None:
    """Write the rows of Parquet files one after the other to a new one, in memory only one at a time.

    Raises
    ------
    FileFormatError
        If one cannot be read.
    """
    arrow = import_pyarrow()
    schemas = []
    for path in parts:
        try:
            schemas.append(arrow.parquet.read_schema(path))
        except (OSError, arrow.ArrowException) as error:
            reason = " ".join(str(error).split())[:200]
            raise FileFormatError(f"{path}: is damaged ({reason}); remove it to repeat its trials") from None
    schema = arrow.unify_schemas(schemas, promote_options="permissive").with_metadata(dict(notes))
    with arrow.parquet.ParquetWriter(target, schema) as writer:
        for path in parts:
            table = arrow.parquet.read_table(path)
            for field in schema:
                if field.name not in table.column_names:
                    table = table.append_column(field, arrow.nulls(len(table), field.type))
            writer.write_table(table.select(schema.names).cast(schema))


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a Parquet file.

    Raises
    ------
    FileFormatError
        If it cannot be read.
    """
    arrow = import_pyarrow()
    try:
        return arrow.parquet.read_table(path).to_pylist()
    except (OSError, arrow.ArrowException) as error:
        raise FileFormatError(f"{path}: cannot be read: {' '.join(str(error).split())[:200]}") from None


def _unit(name: str) -> dict[str, str] | None:
    column = METRIC_COLUMNS.get(name)
    return {"unit": column.unit} if column and column.unit else None


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
            if not (folder / _FINGERPRINT).exists() and (
                foreign := {path.name for path in folder.iterdir()} - _FIRST
            ):
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
