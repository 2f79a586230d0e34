"""Draw the figures of saved results for papers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import Force, Out

Formats = Annotated[tuple[Literal["pdf", "png", "svg"], ...], Parameter(name=["--format"], negative=())]


def figures(
    *folders: Path,
    formats: Formats = ("pdf",),
    width: Literal["single", "double"] = "double",
    out: Out = None,
    force: Force = False,
) -> None:
    """Draw the figures of saved results for papers: of one run, of several together, of repeats or of a sweep.

    Parameters
    ----------
    folders
        Folders of runs or studies.
    formats
        pdf, svg or png (300 dots an inch); give the option again for several.
    width
        One (single, 3.5 in) or both columns (double, 7.16 in) of a journal's page.
    out
        New folder; default: figures.
    force
        Replace an earlier folder of figures.
    """
    from dqcontrol.errors import Error
    from dqcontrol.experiments.results_folder import check_new, new_folder
    from dqcontrol.figures import column_width, save_figures
    from dqcontrol.figures.save import PAPER_DPI
    from dqcontrol.reports.redrawn import figures_of_results

    if not folders:
        raise Error("figures: give at least one folder of a run or a study")
    folder = out or Path("figures")
    check_new(folder, force=force)
    with column_width(width):
        drawn = figures_of_results(folders)
    with new_folder(folder, force=force) as new:
        save_figures(drawn, new, formats, PAPER_DPI)
    print(f"results: {folder}")
    print(", ".join(drawn))
