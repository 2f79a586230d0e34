"""Figures of runs side by side, and what stands around all of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from dqcontrol.experiments.run_comparison import MOST_CURVES
from dqcontrol.loop import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.constraints.constraints import Constraints
    from dqcontrol.experiments.run import Run


def surroundings_of(runs: Iterable[Run]) -> Constraints | None:
    """Return constraints with the obstacles and zones that all runs have that have any; None where these differ."""
    given = [run.surroundings for run in runs if run.surroundings is not None]
    alike = all(
        (each.world, each.clear_of, each.zones) == (given[0].world, given[0].clear_of, given[0].zones)
        for each in given
    )
    return given[0] if given and alike else None


def figures_of_several(
    records: Mapping[str, Record], unit: str, constraints: Constraints | None
) -> dict[str, Figure]:
    """Return the figures of records by label, of a dozen of them at most; none without records.

    ``unit`` is that of what the inputs move, see `experiments.run_comparison.unit_of_way`; ``constraints`` are
    drawn around paths, see `surroundings_of`.
    """
    from dqcontrol.figures import comparison_figures

    few = dict(list(records.items())[:MOST_CURVES])
    return {name: draw() for name, draw in comparison_figures(few, unit, constraints).items()} if few else {}
