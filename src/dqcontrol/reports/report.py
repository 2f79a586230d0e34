"""A run or a study as one page: what was run, what came of it, and how to get it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.errors import ExistsError
from dqcontrol.files.whole_file import whole_file
from dqcontrol.reports.html_page import (
    code,
    head,
    heading,
    html_figure,
    html_table,
    links,
    page,
    paragraph,
    tables_beside,
)
from dqcontrol.tables.table_cells import Cell
from dqcontrol.tables.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CAPTIONS = {
    "servos": "Each joint where it is liveliest; and what is left all along, by the fit and where a fit of the first "
    "part foresees the rest; dashed: twice the floor that noise and encoder leave.",
    "path": "Path of the end effector over the desired one.",
    "paths": "Paths of the end effectors over the desired one.",
    "base": "Where the base went, seen from above; arrows are its headings at equal times.",
    "motion": "The robot at several times, later ones stronger.",
    "errors": "Error norm, distance and angle between the end effector and its desired pose.",
    "criteria": "Norms of error, control signal, joint step, speed and acceleration of the end effector, and its pose.",
    "pose": "Coefficients of the end pose.",
    "joints": "Configuration; limits in the titles, dashed where they are near.",
    "margins": "Distance of each joint from its nearest limit, as a share of half its range.",
    "inputs": "Commanded inputs and their norm.",
    "disturbance": "Twist that the disturbance gave the end effector, inertial axes.",
    "timing": "How often periods, computation and idle times of the loop occurred; counts are logarithmic.",
    "readings": "Forces that the plant sensed.",
    "tasks": "Distance and angle of each further task from its pose.",
    "range": "The twist that leads to the goal, and what of it the robot cannot give its end effector.",
    "lyapunov": "The Lyapunov function V with its parts and rate, and how near the robot is to what it cannot do.",
    "repeats": "Error integral of every repeat, with mean and confidence interval.",
    "sweep": "The number that points are ranked by against each parameter; the best point is ringed.",
}
_WHERE = "In the folder of this page, or with the experiment below saved as spec.yaml."


def write_report(
    folder: str | Path,
    title: str,
    *,
    facts: str = "",
    notice: str = "",
    about: Sequence[tuple[str, Cell]] = (),
    picture: Figure | None = None,
    moving: str = "",
    command: str = "",
    verdicts: Sequence[Table] = (),
    tables: Sequence[Table] = (),
    figures: Mapping[str, Figure] | None = None,
    files: Mapping[str, str] | None = None,
    later: str = "",
    spec: str = "",
    origins: Table | None = None,
) -> Path:
    """Write ``report.html`` into a folder: everything in one file, for screens and for paper.

    Parameters
    ----------
    folder
        Made if missing; must not hold a ``report.html``.
    title
        Heading.
    facts
        A line below it.
    notice
        What a reader must not miss, as why a run failed.
    about
        What it is about, as names and texts.
    picture
        Beside them.
    moving
        A page that plays what happened, in place of the picture on screens; paper keeps that.
    command
        The line that gives the results again.
    verdicts
        Tables whose cells of ``dqcontrol.tables.table_cells.Verdict`` have colours and marks.
    tables
        In this order.
    figures
        By name; known names have captions, others are their own.
    later
        The line that draws figures which are left out.
    files
        Pages of single runs and others, relative to the folder, by label.
    spec
        Text of the resolved experiment.
    origins
        Versions and seeds.

    Returns
    -------
    The file.

    Raises
    ------
    ExistsError
        If the folder holds a report.

    Examples
    --------
    >>> write_report("out", "Circle", figures={"errors": errors(run.record)})  # doctest: +SKIP
    """
    target = Path(folder) / "report.html"
    if target.exists():
        raise ExistsError(f"{target}: exists already; choose another folder or remove it")
    parts = [paragraph(facts, "facts")] if facts else []
    parts += [paragraph(notice, "notice")] if notice else []
    parts += [head(about, picture, moving)] if about else []
    if verdicts:
        parts += [heading("Verdicts"), *map(html_table, verdicts)]
    if command:
        parts += [heading("The same again"), code(command, "command")]
        parts += [paragraph(_WHERE)] if spec else []
    if tables:
        parts += [heading("Tables"), tables_beside(tables)]
    if figures:
        drawn = (html_figure(name, figure, _CAPTIONS.get(name, name)) for name, figure in figures.items())
        parts += [heading("Figures"), *drawn]
    if later:
        demand = paragraph("Drawn on demand, in the folder of this page:")
        parts += [heading("Figures"), demand, code(later, "later")]
    if files:
        parts += [heading("Files beside this page"), links(files)]
    if spec:
        parts += [heading("Experiment"), code(spec, "spec")]
    if origins is not None:
        parts += [heading("Versions and seeds"), html_table(origins)]
    target.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(target) as draft:
        draft.write_text(page(title, parts), encoding="utf-8", newline="\n")
    return target
