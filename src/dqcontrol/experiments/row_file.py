"""Rows of numbers and texts in Parquet files."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from dqcontrol.errors import FileFormatError, from_extra, writing
from dqcontrol.measures.metric_tables import METRIC_COLUMNS, TEXTS

Row = dict[str, float | int | str | None]


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
