"""The output of `dqcontrol` alone: what lies in the working folder, and the commands for it."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import dqcontrol

_MOST = 8  # files and folders shown
_LOOKED_AT = 20_000  # bytes of a file
_KEY = re.compile(r"^(\w+):", re.MULTILINE)
_SPEC, _ROBOT = {"robot", "robots", "reference"}, {"joints", "parts"}
_START = (
    ("dqcontrol play", "take a robot's target in the hand, in a browser"),
    ("dqcontrol new my.yaml", "five questions make an experiment to run and to change"),
    ("dqcontrol list robots", "bundled robots; any .urdf file will do as well"),
    ("dqcontrol list laws", "also references, plants: what an experiment may name"),
    ("dqcontrol doctor", "what is installed, what is missing"),
    ("dqcontrol --help", "all commands; COMMAND --help says more of one"),
)


def print_start_page() -> None:
    """Print which files and results are here and what to do with them, and how to start."""
    print(
        f"dqcontrol {dqcontrol.__version__}: pose control with dual quaternions: simulate, compare, deploy."
    )
    if found := list(_what_is_here(Path())):
        print("\nHere:")
        _print_pairs(found[:_MOST])
        if len(found) > _MOST:
            print(f"  … and {len(found) - _MOST} more")
    print("\nTo start:")
    _print_pairs(_START)


def _print_pairs(pairs: list[tuple[str, str]] | tuple[tuple[str, str], ...]) -> None:
    width = max(len(command) for command, _ in pairs)
    for command, meaning in pairs:
        sys.stdout.write(f"  {command:<{width}}   {meaning}\n")


def _what_is_here(folder: Path) -> Iterator[tuple[str, str]]:
    """Give a command for each file and folder of results here, and what it does."""
    for path in sorted(folder.glob("*.y*ml")):
        keys = set(_KEY.findall(_beginning(path)))
        if "tune" in keys:
            yield f"dqcontrol tune {path}", "find each law's best parameters"
        elif "learn" in keys:
            yield f"dqcontrol learn {path}", "learn this motion from repetition"
        elif "sweep" in keys:
            yield f"dqcontrol sweep {path}", "run this parameter study"
        elif len(keys & _SPEC) > 1:
            yield f"dqcontrol run {path}", "run this experiment (check: before it moves)"
        elif keys & _ROBOT:
            yield f"dqcontrol robots show {path}", "joints and limits of this robot"
    for path in sorted(folder.glob("*.urdf")):
        yield f"dqcontrol robots show {path}", "joints and limits of this robot"
    for path in sorted(folder.glob("*.svg")):
        yield f"dqcontrol paint {path}", "paint this drawing with light"
    marked = sorted(folder.glob("results/*/spec.yaml"), key=lambda path: -path.stat().st_mtime)
    for path in marked:
        yield f"dqcontrol view {path.parent}", "look at these results"


def _beginning(path: Path) -> str:
    from dqcontrol.errors import Error
    from dqcontrol.files.input_file import open_regular

    try:
        with open_regular(path) as stream:
            return stream.read(_LOOKED_AT).decode("utf-8", errors="ignore")
    except (OSError, Error):
        return ""
