"""Count which printed cells of K, K+FF and the linear quadratic laws a complete reproduction of [P16] comes near.

`dqcontrol reproduce pereira2016 --repeats 2 --out FOLDER`, then `python tools/pereira2016_cells.py FOLDER`. Cells of
laws that did not keep their period count at the nominal one, over the durations that Table 61 prints, and as run at the
printed period.
"""

from __future__ import annotations

import sys
from pathlib import Path

from dqcontrol.measures.tables import Column, Table

LAWS = ("K", "K+FF", "LQR-R8", "LQR-DQ")
NEAR = {"Err": 0.1, "θ̇ [rad]": 0.2, "L.Vel [m]": 0.2, "L.Acc [m/s]": 0.3}
EXPERIMENTS = ("lqr", "circle", "spiral", "circle-and-square")
NOMINAL, STRETCHED, RUN = -1, -3, -1  # columns of the ratio

Cells = dict[tuple[str, ...], float]


def rows_below(lines: list[str], start: str) -> list[tuple[str, list[str]]]:
    """Return title and cells of all rows of the tables whose titles start so."""
    found, title = [], ""
    for line in lines:
        if line.startswith("**"):
            title = line.strip("*\n")
        elif line.startswith("| ") and title.startswith(start):
            found.append((title, [cell.strip() for cell in line.strip("| ").split(" | ")]))
    return found


def ratios(folder: Path) -> tuple[Cells, Cells, Cells]:
    """Return the ratio of each cell at the nominal period; of late laws over their durations, and as run so."""
    nominal: Cells = {}
    stretched: Cells = {}
    run: Cells = {}
    for experiment in EXPERIMENTS:
        lines = (folder / experiment / "tables.md").read_text(encoding="utf-8").splitlines()
        for title, cells in rows_below(lines, "P16 Table"):
            if cells[0] in LAWS and cells[2] in NEAR:
                nominal[experiment, title, *cells[:3]] = float(cells[NOMINAL])
        for _, cells in rows_below(lines, "Over the durations"):
            if cells[0] in LAWS and cells[2] in NEAR:
                (key,) = (key for key in nominal if (key[0], *key[2:]) == (experiment, *cells[:3]))
                stretched[key], run[key] = float(cells[STRETCHED]), float(cells[RUN])
    return nominal, stretched, run


def counted(cells: Cells, metric: str) -> str:
    """Return how many cells of a metric are near the printed ones, and of how many."""
    values = [value for key, value in cells.items() if key[-1] == metric]
    return f"{sum(abs(value - 1) <= NEAR[metric] for value in values)} of {len(values)}"


def main(folder: str) -> None:
    """Print the counts, on the arm and with the iiwa, and the cells of Err that are farther off."""
    nominal, stretched, run = ratios(Path(folder))
    on_arm = {key: value for key, value in nominal.items() if "iiwa" not in key[1]}
    readings = {
        "on the arm, all laws at the nominal period": on_arm,
        "the same over the durations that Table 61 prints": on_arm | stretched,
        "late laws run at the periods that Table 61 prints": on_arm | run,
        "the last, and the iiwa": nominal | run,
    }
    rows = [[label, *(counted(cells, metric) for metric in NEAR)] for label, cells in readings.items()]
    columns = [
        Column(""),
        *(Column(f"{name.split()[0]} ± {100 * share:g} %") for name, share in NEAR.items()),
    ]
    print(Table(columns, rows, "Cells of K, K+FF, LQR-R8 and LQR-DQ near the printed ones"))
    for key, value in (nominal | run).items():
        if key[-1] == "Err" and abs(value - 1) > NEAR["Err"]:
            print(*key[:-1], value)


if __name__ == "__main__":
    main(*sys.argv[1:])
