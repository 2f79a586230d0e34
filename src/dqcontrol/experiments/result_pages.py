"""Figures and pages in the folders of results, which packages above write.

Reports import experiments, so experiments cannot import reports: they know only what is to be written. The package
`dqcontrol` itself, above all layers, hands in what writes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from dqcontrol.experiments.ranking import Ranking
    from dqcontrol.experiments.run import Run
    from dqcontrol.experiments.study import Study
    from dqcontrol.loop.record import Record
    from dqcontrol.tables.tables import Table
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


_handed_in: list[Callable[[], ResultPages]] = []


def hand_in(load: Callable[[], ResultPages]) -> None:
    """Take the function that returns what writes figures and reports; it is called when the first is written."""
    _handed_in[:] = [load]


def result_pages() -> ResultPages:
    """Return what writes them."""
    (load,) = _handed_in
    return load()
