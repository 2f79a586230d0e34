"""Folders of ROS packages that robot files name, found without ROS."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from dqcontrol.errors import FileFormatError

PACKAGES = "DQCONTROL_PACKAGE_PATH"  # of the environment: folders that ``--package`` names
WHERE = (
    "beside the robot's file or one of the folders above it, or in a folder of ROS_PACKAGE_PATH, "
    "or name its folder: --package FOLDER"
)


def add_packages(folders: Iterable[str]) -> None:
    """Let this process and those that it starts look for packages in some folders first.

    Parameters
    ----------
    folders
        Packages, or folders that hold them.

    Raises
    ------
    FileFormatError
        If one is no folder.
    """
    found = []
    for folder in folders:
        if not Path(folder).is_dir():
            raise FileFormatError(
                f"--package: '{folder}' is no folder; give that of a package, or one that holds packages"
            )
        found.append(str(Path(folder).resolve()))
    if found:
        os.environ[PACKAGES] = os.pathsep.join([*found, *filter(None, [os.environ.get(PACKAGES)])])


def package_folders(package: str, near: Path) -> Iterator[Path]:
    """Yield the folders that may be a package for a file: existing ones, the likeliest first.

    A package is what `add_packages` named, or a folder in that; a folder above the file or beside one of those, as its
    name or its ``package.xml`` says; or in AMENT_PREFIX_PATH or ROS_PACKAGE_PATH.
    """
    above, given = list(near.resolve().parents), _listed(PACKAGES)
    first = [*(folder for folder in given if _is(folder, package)), *(folder / package for folder in given)]
    named = [folder for folder in above if _is(folder, package)]
    beside = [folder / package for folder in above]
    ament = [folder / "share" / package for folder in _listed("AMENT_PREFIX_PATH")]
    ros = _listed("ROS_PACKAGE_PATH")
    here = [folder for folder in ros if folder.name == package]
    places = *first, *named, *beside, *ament, *here, *(folder / package for folder in ros)
    yield from (folder for folder in places if folder.is_dir())


def _listed(name: str) -> list[Path]:
    """Return the folders of a variable of the environment."""
    return [Path(each) for each in os.environ.get(name, "").split(os.pathsep) if each]


def _is(folder: Path, package: str) -> bool:
    return folder.name == package or _package_name(folder) == package


def _package_name(folder: Path) -> str:
    try:
        text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")[:100_000]
    except OSError:
        return ""
    return text.partition("<name>")[2].partition("</name>")[0].strip()
