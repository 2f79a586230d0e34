"""Count which printed cells of K, K+FF and the linear quadratic laws a complete reproduction of [P16] comes near.

`python -m dqcontrol_theses.pereira2016.tools.cells` reads docs/pereira2016-tables.md, which `tools/update_theses.py`
writes. Table 5.9 reprints Tables 5.3 and 5.4: cells that a table prints again count once. Predictions are the simulated
numbers that differ from each other and that nothing was fitted on, and such a one is near if all of its cells are: sets
of weights with one ratio are one controller and so one simulated number, and K+FF has K's error, as the sag that makes
it is not the lag that feed-forward removes. Cells of laws that did not keep their
period count at the nominal one, over the durations that Table 61 prints, and as run at the printed period.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from dqcontrol.tables import Column, Table
from dqcontrol_theses.pereira2016.calibration import FITS
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS
from dqcontrol_theses.pereira2016.published_numbers import FIXED
from dqcontrol_theses.results import NAMES

LAWS = ("K", "K+FF", "LQR-R8", "LQR-DQ")
NEAR = {"error": 0.1, "control": 0.2, "hand_speed": 0.2, "hand_acceleration": 0.3}
PATHS = {"lqr": "circle", "circle": "circle", "spiral": "spiral", "circle-and-square": ""}
METRICS = {name: metric for metric, name in NAMES.items()}
PAGE = Path("docs/pereira2016-tables.md")  # from the repository's root
OVER_DURATION, AT_PERIOD = 7, 9  # columns of ours
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
        == (fit.experiment or fit.spec, "K", "" if fit.set == FIXED else fit.set, fit.metric)
        for fit in FITS[PHYSICS]
    )


Cells = dict[tuple[str, ...], ComparedCell]


def rows_below(lines: list[str], start: str) -> list[tuple[str, list[str]]]:
    """Return title and cells of all rows of the tables whose titles start so."""
    found, title = [], ""
    for line in lines:
        if line.startswith("**"):
            title = line.strip("*\n")
        elif line.startswith("| ") and title.startswith(start):
            found.append((title, [cell.strip() for cell in line.strip("| ").split(" | ")]))
    return found


def compared(page: Path = PAGE) -> tuple[Cells, Cells, Cells]:
    """Return each cell at the nominal period; those of late laws over their durations, and as run so."""
    nominal: Cells = {}
    stretched: Cells = {}
    run: Cells = {}
    sections = re.split("^## pereira2016/", page.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    for section in sections:
        experiment, *lines = section.splitlines()
        if experiment not in PATHS:
            continue
        for title, cells in rows_below(lines, "P16 Table"):
            law, label, metric, printed, _, ours, *_ = cells
            if law in LAWS and METRICS.get(metric) in NEAR:
                path = PATHS[experiment] or title.split(" · ")[1]
                found = ComparedCell(path, law, label, METRICS[metric], float(printed), float(ours))
                nominal[experiment, title, law, label, metric] = found
        for _, cells in rows_below(lines, "Over the durations"):
            law, label, metric, *_ = cells
            if law in LAWS and METRICS.get(metric) in NEAR:
                (key,) = (key for key in nominal if (key[0], *key[2:]) == (experiment, law, label, metric))
                stretched[key] = nominal[key]._replace(ours=float(cells[OVER_DURATION]))
                run[key] = nominal[key]._replace(ours=float(cells[AT_PERIOD]))
    return nominal, stretched, run


def near(cell: ComparedCell) -> bool:
    """Tell whether a cell is within the share of its metric."""
    return abs(cell.ratio - 1) <= NEAR[cell.metric]


def counted(cells: Cells, metric: str) -> tuple[str, str]:
    """Return how many distinct cells of a metric are near the printed ones, and how many predictions."""
    chosen = [cell for cell in cells.values() if cell.metric == metric]
    once, groups = distinct(chosen), predictions(chosen)
    return (
        f"{sum(map(near, once))} of {len(once)}",
        f"{sum(all(map(near, group)) for group in groups)} of {len(groups)}",
    )


def readings(page: Path = PAGE) -> dict[str, Cells]:
    """Return the cells of each reading of the late laws, by what it is."""
    nominal, stretched, run = compared(page)
    on_arm = {key: value for key, value in nominal.items() if "iiwa" not in key[1]}
    return {
        "on the arm, all laws at the nominal period": on_arm,
        "over the durations that Table 61 prints": on_arm | stretched,
        "run at the periods that Table 61 prints": on_arm | run,
        "the last, and the iiwa": nominal | run,
    }


def main(page: str = str(PAGE)) -> None:
    """Print the counts, on the arm and with the iiwa, and the cells of Err that are farther off."""
    found = readings(Path(page))
    rows = [
        [label, *(text for metric in NEAR for text in counted(cells, metric))]
        for label, cells in found.items()
    ]
    columns = [Column("")]
    for metric, share in NEAR.items():
        name = NAMES[metric].split()[0]
        columns += [Column(f"{name} ± {100 * share:g} %: cells"), Column("predictions")]
    print(Table(columns, rows, "Cells of K, K+FF, LQR-R8 and LQR-DQ near the printed ones"))
    for cell in distinct(
        [each for each in found["the last, and the iiwa"].values() if each.metric == "error"]
    ):
        if not near(cell):
            print(*cell[:4], round(cell.ratio, 3))
    arm = found["run at the periods that Table 61 prints"].values()
    errors = [cell for cell in arm if cell.metric == "error" and cell.law != "LQR-DQ"]
    farthest = max(distinct(errors), key=lambda cell: abs(cell.ratio - 1))
    print(
        f"K, K+FF and LQR-R8: {len(errors)} cells, {len(distinct(errors))} distinct, {len(predictions(errors))} "
        f"predictions; the farthest {farthest.ratio:.3f}"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
