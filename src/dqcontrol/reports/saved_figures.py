"""The figures of saved results, drawn anew."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.experiments.load_results import is_study, is_sweep, load_rows, load_runs
from dqcontrol.experiments.ranking import rank
from dqcontrol.experiments.run_comparison import unit_of_way
from dqcontrol.reports.compared_runs import figures_of_several, surroundings_of
from dqcontrol.reports.run_report import figures_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figures_of_results(folders: Sequence[Path]) -> dict[str, Figure]:
    """Return figures by name: of one run, of several runs together, of repeats, or of a parameter study.

    Parameters
    ----------
    folders
        Of runs or studies; a study whose runs have folders of their own stands for all of them.

    Raises
    ------
    FileFormatError
        If a folder holds neither.
    """
    from dqcontrol.figures import repeats_figure, sweep_figure

    if any(map(is_sweep, folders)):
        return {"sweep": sweep_figure(rank(folders))}
    if any(map(is_study, folders)):
        return {"repeats": repeats_figure(load_rows(folders))}
    runs = load_runs(folders)
    if len(runs) == 1:
        return figures_of(next(iter(runs.values())))
    records = {label: run.record for label, run in runs.items()}
    unit = unit_of_way(run.robot for run in runs.values())
    return figures_of_several(records, unit, surroundings_of(runs.values()))
