"""Folders of ROS packages that robot files name, found without ROS."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

WHERE = "beside the robot's file or one of the folders above it, or in a folder of ROS_PACKAGE_PATH"


def package_folders(package: str, near: Path) -> Iterator[Path]:
    """Yield the folders that may be a package for a file: existing ones, the likeliest first.

    A package is a folder above the file or beside one of those, as its name or its ``package.xml`` says, or in
    AMENT_PREFIX_PATH or ROS_PACKAGE_PATH.
    """
    above = list(near.resolve().parents)
    named = [folder for folder in above if folder.name == package or _package_name(folder) == package]
    beside = [folder / package for folder in above]
    ament = [
        Path(p) / "share" / package for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p
    ]
    ros = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    here = [folder for folder in ros if folder.name == package]
    yield from (f for f in (*named, *beside, *ament, *here, *(f / package for f in ros)) if f.is_dir())


def _package_name(folder: Path) -> str:
    try:
        text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")[:100_000]
    except OSError:
        return ""
    return text.partition("<name>")[2].partition("</name>")[0].strip()
