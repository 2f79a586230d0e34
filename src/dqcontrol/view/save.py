"""Figures written to files: those of one run, and those of several runs together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from dqcontrol.errors import ExistsError, unknown_name
from dqcontrol.experiments.task_range import RANGE, TaskRange
from dqcontrol.loop.record import Record
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.robot import Robot
from dqcontrol.view.base_paths import base_path, has_base, superimposed
from dqcontrol.view.criteria import compare_criteria
from dqcontrol.view.disturbances import disturbance
from dqcontrol.view.paths import compare_paths, path_3d
from dqcontrol.view.plots import compare_errors, control_signals, errors, joint_angles, pose_coefficients
from dqcontrol.view.readings import has_readings, limit_margins, readings
from dqcontrol.view.task_range import range_condition

FORMATS = ("pdf", "png", "svg")


def save_plots(
    record: Record,
    folder: str | Path,
    limits: Limits | None = None,
    *,
    joint_units: Sequence[str] | None = None,
    input_units: Sequence[str] | None = None,
    formats: Sequence[str] = ("png",),
    robot: Robot | None = None,
) -> list[Path]:
    """Write all figures of a run: ``path``, ``errors``, ``pose``, ``joints``.

    And, if there are any, ``margins`` (of joint limits), ``inputs``, ``disturbance``, ``readings`` (of forces) and
    ``range`` (the range condition).

    Of a robot that drives also ``base``, where its base went, and ``motion``, the robot at several times.

    Parameters
    ----------
    record
        The run.
    folder
        Made if missing; must not hold files of these names.
    limits, joint_units
        As for `joint_angles`.
    input_units
        As for `control_signals`.
    formats
        Any of ``"png"``, ``"svg"``, ``"pdf"``.
    robot
        Of whom the run is; needed for ``base`` and ``motion``.

    Returns
    -------
    The files, in the order above.

    Raises
    ------
    ExistsError
        If a file exists; then none is written.
    UnknownNameError, ShapeError
        If a format or unit does not exist, or something does not fit the record.

    Examples
    --------
    >>> save_plots(run.record, "out", robot.limits, formats=["png", "svg"])  # doctest: +SKIP
    """
    import matplotlib

    folder = Path(folder)
    names = ["path", "errors", "pose", "joints"]
    if (
        limits is not None
        and (np.isfinite(limits.upper - limits.lower) & (limits.upper > limits.lower)).any()
    ):
        names.append("margins")
    if not np.isnan(record.command).all():  # a log of somebody else's may lack the commands
        names.append("inputs")
    if record.disturbance is not None:
        names.append("disturbance")
    if has_readings(record):
        names.append("readings")
    if RANGE in record.readings:
        names.append("range")
    if robot is not None and has_base(robot):
        names += ["base", "motion"]
    for kind in formats:
        if kind not in FORMATS:
            raise unknown_name("formats", kind, FORMATS)
    for path in (folder / f"{name}.{kind}" for name in names for kind in formats):
        if path.exists():
            raise ExistsError(f"{path}: exists already; choose another folder or remove it")
    draw = {
        "path": lambda: path_3d(record),
        "errors": lambda: errors(record),
        "pose": lambda: pose_coefficients(record),
        "joints": lambda: joint_angles(record, limits, joint_units),
        "margins": lambda: limit_margins(record, limits or Limits.none(record.q.shape[1])),
        "inputs": lambda: control_signals(record, input_units),
        "disturbance": lambda: disturbance(record),
        "readings": lambda: readings(record),
        "range": lambda: range_condition(TaskRange.recorded(record), record.error),
        "base": lambda: base_path(cast(Robot, robot), {"": record}),
        "motion": lambda: superimposed(cast(Robot, robot), {"": record}),
    }
    figures = [draw[name]() for name in names]
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with matplotlib.rc_context({"svg.hashsalt": "dqcontrol"}):  # the same run gives the same bytes
        for name, figure in zip(names, figures, strict=True):
            for kind in formats:
                written.append(folder / f"{name}.{kind}")
                date = {"pdf": "CreationDate", "svg": "Date"}.get(kind)
                figure.savefig(written[-1], metadata={date: None} if date else None)
    return written


def save_comparison(records: Mapping[str, Record], folder: str | Path) -> list[Path]:
    """Write the figures that show several runs together, ``paths``, ``errors`` and ``criteria``, as PNG.

    Parameters
    ----------
    records
        Runs by label.
    folder
        Made if missing; must not hold files of these names.

    Returns
    -------
    The files, in the order above.

    Raises
    ------
    ExistsError
        If a file exists; then none is written.
    """
    draw = {"paths": compare_paths, "errors": compare_errors, "criteria": compare_criteria}
    files = [Path(folder) / f"{name}.png" for name in draw]
    for path in files:
        if path.exists():
            raise ExistsError(f"{path}: exists already; choose another folder or remove it")
    Path(folder).mkdir(parents=True, exist_ok=True)
    for path, function in zip(files, draw.values(), strict=True):
        function(records).savefig(path)
    return files
