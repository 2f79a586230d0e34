"""Figures and pages in the folders of results, which packages above write.

Reports import experiments, so experiments cannot import reports: they know only what is to be written. The package
`dqcontrol` itself, above all layers, hands in what writes it.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from dqcontrol.constraints import Constraints
    from dqcontrol.experiments.ranking import Ranking
    from dqcontrol.experiments.run import Run
    from dqcontrol.experiments.study import Study
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.plant import Plant
    from dqcontrol.robots import Robot
    from dqcontrol.tables.tables import Table
    from dqcontrol.tuning import Learning, Tuning


class ResultPages(Protocol):
    """Writes figures and reports into existing folders."""

    def write_run_report(self, run: Run, folder: Path, outside: str, *, figures: bool = True) -> None:
        """Write those of a run; ``outside`` leads from its folder out of all results."""

    def write_study_report(
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

    def write_sweep_report(self, ranking: Ranking, spec: str, folder: Path) -> None:
        """Write those of a parameter study."""

    def write_tuning_report(self, tuning: Tuning, spec: str, folder: Path) -> None:
        """Write those of a search."""

    def write_learning_report(self, learning: Learning, spec: str, folder: Path) -> None:
        """Write those of learning from repetition."""

    def path_picture(self, record: Record) -> bytes:
        """Return the path of the end effector as a PNG file."""
        ...


class ShownPage:
    """A page of HTML that notebooks show in a cell.

    Attributes
    ----------
    html
        The whole page.
    height
        Of the cell, pixels.
    """

    def __init__(self, html: str, height: int) -> None:
        self.html, self.height = html, height

    def __repr__(self) -> str:
        return f"ShownPage({len(self.html) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        """Return what notebooks show."""
        page = escape(self.html, quote=True)
        return f'<iframe srcdoc="{page}" width="100%" height="{self.height}" style="border:none"></iframe>'


class HandedIn(NamedTuple):
    """What packages above make of runs."""

    load: Callable[[], ResultPages]
    replay: Callable[[Mapping[str, Run]], str]
    clip: Callable[[Robot, Plant, Record, Path, Constraints | None], None]


_handed_in: list[HandedIn] = []


def hand_in(given: HandedIn) -> None:
    """Take what loads the writer of figures and reports, and what makes replays and clips."""
    _handed_in[:] = [given]


def result_pages() -> ResultPages:
    """Return what writes them."""
    return _handed_in[0].load()


def replay(runs: Mapping[str, Run]) -> str:
    """Return a page of HTML that plays runs by their labels."""
    return _handed_in[0].replay(runs)


def clip(robot: Robot, plant: Plant, record: Record, path: Path, kept: Constraints | None) -> None:
    """Write a clip of what a robot did, with what its constraints keep clear of."""
    _handed_in[0].clip(robot, plant, record, path, kept)
