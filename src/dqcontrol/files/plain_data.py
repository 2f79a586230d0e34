"""Plain data written as JSON and YAML."""

from __future__ import annotations

import json
import math
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import yaml


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
