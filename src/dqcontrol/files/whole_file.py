"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dqcontrol.errors import ExistsError


@contextmanager
def whole_file(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Give another name in the same folder to write to; after that what was written takes its place.

    If writing fails or is interrupted, an earlier file stays as it is and nothing new is left.

    Raises
    ------
    ExistsError
        If the file appeared meanwhile and may not be replaced.
    """
    draft = path.with_name(f".{secrets.token_hex(4)}.{path.name}")  # writers go by the suffix
    try:
        yield draft
        if path.exists() and not overwrite:
            raise ExistsError(f"{path}: appeared meanwhile; choose another name")
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
