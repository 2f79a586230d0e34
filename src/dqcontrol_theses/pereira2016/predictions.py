"""Number of the compared cells that say something of their own.

Table 5.9 reprints Tables 5.3 and 5.4; sets of weights with one ratio are one controller and so one simulated number;
K+FF has K's error, as the sag that makes it is not the lag that feed-forward removes; and a cell that a number of the
plant was fitted on is not predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from dqcontrol_theses.pereira2016.calibration import FITS
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS

_SAME = 0.002  # relative: K+FF's error is within it of K's in five of six sets


class ComparedCell(NamedTuple):
    """A printed number and ours, on a path of a robot."""

    path: str
    law: str
    set: str
    metric: str
    printed: float
    ours: float

    @property
    def ratio(self) -> float:
        """Ours over the printed one."""
        return self.ours / self.printed


def distinct(cells: Sequence[ComparedCell]) -> list[ComparedCell]:
    """Return the cells without those that another table prints again.

    Examples
    --------
    >>> once = ComparedCell("circle", "LQR-R8", "q=1 r=0.001", "error", 4.882, 4.883)
    >>> distinct([once, once._replace(law="LQR-DQ"), once]) == [once, once._replace(law="LQR-DQ")]
    True
    """
    return list({cell[:5]: cell for cell in cells}.values())


def predictions(cells: Sequence[ComparedCell]) -> list[list[ComparedCell]]:
    """Return the distinct cells in groups of one simulated number, without those that hold a fitted cell.

    Examples
    --------
    >>> k = ComparedCell("circle", "K", "", "error", 3.16, 3.178)
    >>> exact = ComparedCell("circle", "LQR-R8", "q=1 r=0.001", "error", 4.882, 4.883)
    >>> groups = predictions([k, k._replace(law="K+FF", ours=3.179), exact, exact._replace(set="q=10 r=0.01")])
    >>> [[cell.law for cell in group] for group in groups]
    [['K', 'K+FF'], ['LQR-R8', 'LQR-R8']]
    """
    groups: list[list[ComparedCell]] = []
    for cell in distinct(cells):
        alike = (
            group
            for group in groups
            if (group[0].path, group[0].metric) == (cell.path, cell.metric)
            and abs(group[0].ours / cell.ours - 1) <= _SAME
        )
        group = next(alike, None)
        if group is None:
            groups.append([cell])
        else:
            group.append(cell)
    return [group for group in groups if not any(map(is_fitted, group))]


def is_fitted(cell: ComparedCell) -> bool:
    """Tell whether a number of the plant was fitted on the cell."""
    return any(
        (cell.path, cell.law, cell.set, cell.metric)
        == (fit.experiment or fit.spec, "K", "" if fit.set == "fixed" else fit.set, fit.metric)
        for fit in FITS[PHYSICS]
    )
