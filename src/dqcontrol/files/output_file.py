"""Files that appear whole or not at all, and plain data written as JSON and YAML."""

from __future__ import annotations

import json
import math
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import yaml

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


def finite_or_none(value: Any) -> Any:
    """Return plain data with None for NaN and infinity, which JSON has no words for; of dataclasses their fields."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite_or_none(each) for key, each in value.items()}
    if isinstance(value, tuple | list):
        return [finite_or_none(each) for each in value]
    return finite_or_none(vars(value)) if is_dataclass(value) else value


def write_json(path: Path, data: Any) -> None:
    """Write plain data into a new file; NaN and infinity become null."""
    text = json.dumps(finite_or_none(data), indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(f"{text}\n", encoding="utf-8")


def yaml_text(data: Any) -> str:
    """Return plain data as YAML in its own order, short lists and mappings in one line."""
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)
