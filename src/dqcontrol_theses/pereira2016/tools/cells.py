"""Count which printed cells of K, K+FF and the linear quadratic laws a complete reproduction of [P16] comes near.

`python -m dqcontrol_theses.pereira2016.tools.cells` reads docs/pereira2016-tables.md, which `tools/update_theses.py`
writes. Cells that a table prints again count once; predictions are the simulated numbers that differ from each other
and that nothing was fitted on, and such a one is near if all of its cells are. Cells of laws that did not keep their
period count at the nominal one, over the durations that Table 61 prints, and as run at the printed period.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from dqcontrol.tables import Column, Table
from dqcontrol_theses.pereira2016.predictions import ComparedCell, distinct, predictions
from dqcontrol_theses.printed_comparison import NAMES

LAWS = ("K", "K+FF", "LQR-R8", "LQR-DQ")
NEAR = {"error": 0.1, "control": 0.2, "hand_speed": 0.2, "hand_acceleration": 0.3}
PATHS = {"lqr": "circle", "circle": "circle", "spiral": "spiral", "circle-and-square": ""}
METRICS = {name: metric for metric, name in NAMES.items()}
PAGE = Path("docs/pereira2016-tables.md")  # from the repository's root
OVER_DURATION, AT_PERIOD = 7, 9  # columns of ours

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
