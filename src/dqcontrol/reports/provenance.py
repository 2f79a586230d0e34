"""Where results come from: versions, seeds, and the command that gives them again."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Iterable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from dqcontrol.experiments.prepared_experiment import sources
from dqcontrol.tables.tables import Column, Table

RERUN_FOLDER = "again"  # folder that the commands write to
_LIBRARIES = ("numpy", "numba", "msgspec", "scipy", "mujoco", "matplotlib")


def command(name: str, *arguments: str, **options: Any) -> str:
    """Return a command line with its arguments quoted; options that are None or False are left out.

    Those with several values, in a tuple, are given several times.

    Examples
    --------
    >>> command("run", "spec.yaml", real_time=True, jobs=None, out="my results")
    "dqcontrol run spec.yaml --real-time --out 'my results'"
    """
    words = ["dqcontrol", name, *arguments]
    given = [
        (key, each)
        for key, value in options.items()
        for each in (value if isinstance(value, tuple) else [value])
    ]
    for key, value in given:
        if value is not None and value is not False:
            words += [f"--{key.replace('_', '-')}", *([] if value is True else [str(value)])]
    return shlex.join(words)


def evaluation_command(evaluation: dict[str, Any]) -> str:
    """Return the command that measures a log again, from what ``spec.yaml`` says about it."""
    options = {key: value for key, value in evaluation.items() if key not in ("log", "robot")}
    robot = evaluation["robot"]
    ends = {key: robot.get(key) for key in ("base_link", "tip_link")}
    joints = options.pop("joints")
    options["start_time"] = options.pop("start", None)
    options["joints"] = ",".join(joints) if joints else None
    return command("evaluate", evaluation["log"], robot=robot["source"], **ends, **options, out=RERUN_FOLDER)


def origins(data: dict[str, Any]) -> Table:
    """Return versions and seeds of a spec's results, one a row.

    Parameters
    ----------
    data
        The spec's keys; empty for results without one.
    """
    rows = [*_seeds(data), ["dqcontrol", f"{version('dqcontrol')}, sources {sources()}"]]
    rows += [["Python", platform.python_version()], *_versions()]
    rows.append(["machine", f"{platform.system()} {platform.machine()}"])
    return Table([Column("what"), Column("value")], rows)


def _seeds(data: dict[str, Any]) -> Iterable[list[str]]:
    if not {"robot", "robots"} & data.keys():
        return
    first, repeats = data.get("seed", 0), data.get("repeats", 1)
    yield (
        ["seed", str(first)] if repeats == 1 else ["seeds", f"{first} … {first + repeats - 1}, one a repeat"]
    )
    if "sweep" in data:
        yield ["seed of the points", str(data["sweep"].get("seed", 0))]


def _versions() -> Iterable[list[str]]:
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            yield [name, version(name)]
