"""Runs side by side: their figures in a folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.experiments.run_comparison import MOST_CURVES
from dqcontrol.loop import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_comparison_figures(
    records: Mapping[str, Record], folder: Path, unit: str = "rad or m"
) -> dict[str, Figure]:
    """Write figures of a dozen records at most, by label, into an existing folder, and return them.

    ``unit`` is that of what the inputs move, as of `compare_criteria`.
    """
    from dqcontrol.figures import comparison_figures, save_figures

    few = dict(list(records.items())[:MOST_CURVES])
    figures = {name: draw() for name, draw in comparison_figures(few, unit).items()} if few else {}
    save_figures(figures, folder)
    return figures
