"""What experiments need of the rooms above: figures and pages in the folders of results.

Reports import experiments, so experiments cannot import reports: they know only what is to be written, and where the
module is that does it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from dqcontrol.loop.record import Record
from dqcontrol.measures.tables import Table

if TYPE_CHECKING:
    from dqcontrol.experiments.ranking import Ranking
    from dqcontrol.experiments.run import Run
    from dqcontrol.experiments.study import Study
    from dqcontrol.tuning import Learning, Tuning


class ResultPages(Protocol):
    """Writes figures and reports into existing folders."""

    def write_run(self, run: Run, folder: Path, outside: str, *, figures: bool = True) -> None:
        """Write those of a run; ``outside`` leads from its folder out of all results."""
        ...

    def write_study(
        self,
        study: Study,
        folder: Path,
        tables: Sequence[Table],
        records: Mapping[str, Record],
        pages: Mapping[str, str],
        *,
        figures: bool = True,
    ) -> None:
        """Write those of a study, with further tables, records to compare and pages of single runs by label."""
        ...

    def write_sweep(self, ranking: Ranking, spec: str, folder: Path) -> None:
        """Write those of a parameter study."""
        ...

    def write_tuning(self, tuning: Tuning, spec: str, folder: Path) -> None:
        """Write those of a search."""
        ...

    def write_learning(self, learning: Learning, spec: str, folder: Path) -> None:
        """Write those of learning from repetition."""
        ...

    def path_picture(self, record: Record) -> bytes:
        """Return the path of the hand as a PNG file."""
        ...


def result_pages() -> ResultPages:
    """Return what writes them."""
    return cast(ResultPages, import_module("dqcontrol.reports.written_by_experiments"))
