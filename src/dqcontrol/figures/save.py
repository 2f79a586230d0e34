"""The figures of one run, and those of several runs together; and these written to files."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.errors import ExistsError, unknown_name
from dqcontrol.experiments.run import units_of
from dqcontrol.figures import plots
from dqcontrol.figures.comparisons import compare_criteria, compare_errors
from dqcontrol.figures.distributions import timing_histogram
from dqcontrol.figures.paths import compare_paths, path_3d
from dqcontrol.figures.robots import base_path, has_base, superimposed
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import ROOM
from dqcontrol.measures.lyapunov import Certificate
from dqcontrol.measures.task_range import RANGE, TaskRange

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.constraints.constraints import Constraints
    from dqcontrol.experiments.run import Run


FORMATS = ("pdf", "png", "svg")
PAPER_DPI = 300  # of PNG files for papers
_LARGEST_SVG = 1_500_000  # bytes in a page; beyond that its picture in pixels is smaller
_SCREEN_DPI = 160
_SETTINGS: Any = {
    "svg.hashsalt": "dqcontrol",  # the same run gives the same bytes
    "svg.fonttype": "path",  # other machines may lack the font
    "pdf.fonttype": 42,  # TrueType: journals refuse type 3
}
_DATES = {"pdf": "CreationDate", "svg": "Date"}


def save_figures(
    figures: Mapping[str, Figure],
    folder: str | Path,
    formats: Sequence[str] = ("png",),
    dpi: float = _SCREEN_DPI,
) -> list[Path]:
    """Write figures into a folder.

    Parameters
    ----------
    figures
        By file name without suffix.
    folder
        Made if missing; must not hold files of these names.
    formats
        Any of ``"png"``, ``"svg"``, ``"pdf"``.
    dpi
        Dots an inch of PNG files.

    Returns
    -------
    The files: all formats of the first figure, and so on.

    Raises
    ------
    ExistsError
        If a file exists; then none is written.
    UnknownNameError
        If a format does not exist.

    Examples
    --------
    >>> save_figures({"errors": errors(run.record)}, "out", ["pdf", "png"])  # doctest: +SKIP
    """
    folder = Path(folder)
    for kind in formats:
        if kind not in FORMATS:
            raise unknown_name("formats", kind, FORMATS)
    for path in (folder / f"{name}.{kind}" for name in figures for kind in formats):
        if path.exists():
            raise ExistsError(f"{path}: exists already; choose another folder or remove it")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, figure in figures.items():
        for kind in formats:
            written.append(folder / f"{name}.{kind}")
            written[-1].write_bytes(encoded(figure, kind, dpi))
    return written


def encoded(figure: Figure, kind: str, dpi: float = _SCREEN_DPI) -> bytes:
    """Return the content of a file of one of `FORMATS`."""
    import matplotlib

    stream, date = io.BytesIO(), _DATES.get(kind)
    with matplotlib.rc_context(_SETTINGS):
        figure.savefig(stream, format=kind, dpi=dpi, metadata={date: None} if date else None)
    return stream.getvalue()


def for_page(figure: Figure) -> tuple[str, bytes]:
    """Return media type and content of a figure in a page: as vectors if they are not too many."""
    svg = encoded(figure, "svg")
    return ("image/svg+xml", svg) if len(svg) <= _LARGEST_SVG else ("image/png", encoded(figure, "png"))


Draw = Callable[[], "Figure"]


def run_figures(run: Run) -> dict[str, Draw]:
    """Return what draws each figure of a run, by name: ``path``, ``errors``, ``pose``, ``joints``.

    And, if there are any, ``margins`` (of joint limits), ``inputs``, ``disturbance``, ``readings`` (of forces),
    ``tasks`` (errors of further ones), ``range`` (the range condition), ``lyapunov`` and ``timing``; of a robot that
    drives also ``base``, where its base went, and ``motion``, the robot at several times. What the law keeps clear of
    is drawn around the paths.
    """
    record, robot, around, timing = run.record, run.robot, run.surroundings, run.timing
    units = units_of(robot)
    draw: dict[str, Draw] = {"path": lambda: path_3d(record, around)}
    if has_base(robot):
        draw["base"] = lambda: base_path(robot, {"": record}, around)
        draw["motion"] = lambda: superimposed(robot, {"": record}, constraints=around)
    draw |= {
        "errors": lambda: plots.errors(record),
        "pose": lambda: plots.pose_coefficients(record),
        "joints": lambda: plots.joint_angles(record, robot.limits, units["joint_units"]),
    }
    if plots.has_margins(robot.limits):
        draw["margins"] = lambda: plots.limit_margins(record, robot.limits)
    if not np.isnan(record.command).all():  # a log of somebody else's may lack the commands
        draw["inputs"] = lambda: plots.control_signals(record, units["input_units"])
    if record.disturbance is not None:
        draw["disturbance"] = lambda: plots.disturbance(record)
    if plots.has_readings(record):
        draw["readings"] = lambda: plots.readings(record)
    if plots.has_tasks(record):
        draw["tasks"] = lambda: plots.task_errors(record)
    if ROOM in record.readings:
        draw["distances"] = lambda: plots.distances(record)
    if RANGE in record.readings:
        draw["range"] = lambda: plots.range_condition(TaskRange.recorded(record), record.error)
    if (certificate := Certificate.recorded(record)) is not None:
        draw["lyapunov"] = lambda: plots.lyapunov(certificate)
    if timing is not None and len(timing.begin) > 1:
        draw["timing"] = lambda: timing_histogram(timing)
    return draw


def comparison_figures(
    records: Mapping[str, Record], unit: str = "rad or m", constraints: Constraints | None = None
) -> dict[str, Draw]:
    """Return what draws the figures of several runs together, by name: ``paths``, ``errors`` and ``criteria``.

    Obstacles and zones of constraints are drawn around the paths.
    """
    return {
        "paths": lambda: compare_paths(records, constraints),
        "errors": lambda: compare_errors(records),
        "criteria": lambda: compare_criteria(records, unit),
    }
