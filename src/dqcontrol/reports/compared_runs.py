"""Runs side by side: their figures in a folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.experiments.run_comparison import MOST_CURVES
from dqcontrol.loop import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.experiments.run import Run
    from dqcontrol.laws.constrained.constraints import Constraints


def surroundings_of(runs: Iterable[Run]) -> Constraints | None:
    """Return constraints with the obstacles and zones that all runs have that have any; None where these differ."""
    given = [run.surroundings for run in runs if run.surroundings is not None]
    alike = all(
        (each.world, each.clear_of, each.zones) == (given[0].world, given[0].clear_of, given[0].zones)
        for each in given
    )
    return given[0] if given and alike else None


def write_comparison_figures(
    records: Mapping[str, Record], folder: Path, unit: str, constraints: Constraints | None
) -> dict[str, Figure]:
    """Write figures of a dozen records at most, by label, into an existing folder, and return them.

    ``unit`` is that of what the inputs move, see `experiments.run_comparison.unit_of_way`; ``constraints`` are
    drawn around paths, see
    `surroundings_of`.
    """
    from dqcontrol.figures import comparison_figures, save_figures
    from dqcontrol.figures.figure_files import lay_out

    few = dict(list(records.items())[:MOST_CURVES])
    figures = (
        {name: draw() for name, draw in comparison_figures(few, unit, constraints).items()} if few else {}
    )
    lay_out(figures.values())  # once for files and page
    save_figures(figures, folder)
    return figures
