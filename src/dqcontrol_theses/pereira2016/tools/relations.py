"""Print which relations hold within the printed numbers of [P16].

With a servo that stands off its target by s and is sent "measured position + T u", u settles where T u makes up for s:
e k T and the mean of |T u| are then the same for all laws, and errors are inverse to the loop gain k. The loop gain of
the linear quadratic laws is √(q/r). All errors are integrals over a run of N samples of T: mean = Err / (N T).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.stats import ttest_rel

from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses import PublishedCell
from dqcontrol_theses.pereira2016 import REPRODUCTIONS, disagreements, published_cells, published_runs

Cells = list[tuple[Column, Cell]]
LAWS = ("K", "K+FF", "LQR-R8", "LQR-DQ", "HIR", "HIRT")
SERIES = ("q=1 r=0.001", "q=10 r=0.01", "q=100 r=0.1", "q=1000 r=1")
SPIRALS = ("best", "ln2", "ln2²")
METRICS = ("error", "control", "joint_step", "hand_speed", "hand_acceleration")

# Samples, period in s and length of the desired path in m; errors of h-infinity leave out the first tenth.
RUNS = {
    "lqr": (3000, 0.02, 2 * math.pi * 0.07),
    "circle": (3000, 0.02, 2 * math.pi * 0.07),
    "h-infinity": (3000, 0.008, math.hypot(6 * math.pi * 0.05, 0.05)),
    "spiral": (3000, 0.008, math.hypot(6 * math.pi * 0.07, 0.07)),
    "iiwa circle": (1500, 0.025, 2 * math.pi * 0.07),
    "iiwa square": (1600, 0.025, 0.4),
    "meka circle": (1500, 0.025, 2 * math.pi * 0.07),
    "meka square": (1600, 0.025, 0.4),
}
ERROR_SHARE = {"h-infinity": 0.9}

# Loop gains on the position in 1/s. Of gains that change, the circle has the mean and the spirals the final value.
PROPORTIONAL = {"best": 125.0, "ln2": 86.643, "ln2²": 60.057}
ROBUST = {"best": 3.8, "ln2": 2.634, "ln2²": 1.826, "": 2.75}
WEIGHTS = {"best": 270.0, "ln2": 187.15, "ln2²": 129.722}


def main() -> None:
    """Print all tables as Markdown."""
    for table in (levels, steps, shares, feedforward, sessions, drift, repeatability, misprints):
        print(table().markdown())


def gain(cell: PublishedCell) -> float:
    """Return the loop gain of a cell, 1/s."""
    if cell.law.startswith("LQR"):
        return math.sqrt(WEIGHTS[cell.set] / 0.01 if cell.set in WEIGHTS else 1000)
    if cell.law in ("K", "K+FF"):
        return PROPORTIONAL.get(cell.set, 50.0)
    return 3.8 * float(cell.set[:-2]) / 100 if cell.set.endswith("%") else ROBUST[cell.set]


def levels() -> Table:
    """Compare e k T with T |u|, commanded with actual joint paths, and the hand's path with the desired one.

    The control of Appendix C is taken as |T u| instead of |u|: its commanded paths are then as long as those elsewhere.
    """
    rows: list[Cells] = []
    for name in ("lqr", "circle", "h-infinity", "spiral", "circle-and-square"):
        runs: dict[tuple[str, str, str], dict[str, PublishedCell]] = {}
        for cell in published_cells(name):
            if name != "circle" or not cell.set:  # the circle's other cells are those of lqr
                runs.setdefault((cell.experiment or name, cell.law, cell.set), {})[cell.metric] = cell
        for (experiment, law, chosen), cells in runs.items():
            samples, period, path = RUNS[experiment]
            share = ERROR_SHARE.get(name, 1.0)
            scaled = cells["error"].mean / (samples * share) * gain(cells["error"])
            commanded = cells["control"].mean / (period if name == "circle-and-square" else 1)
            rows.append(
                [
                    (Column("experiment"), experiment),
                    (Column("law"), law),
                    (Column("set"), chosen),
                    (Column("mean e k T", "", ".4f"), scaled),
                    (Column("mean T u", "rad", ".4f"), commanded / samples),
                    (Column("e k / u", "", ".3f"), scaled * samples / commanded),
                    (Column("commanded / moved", "", ".1f"), commanded / (cells["joint_step"].mean / period)),
                    (Column("hand's path / desired", "", ".2f"), cells["hand_speed"].mean / path),
                ]
            )
    return Table.of(rows, "Levels")


def steps() -> Table:
    """Divide the error of each gain set of the spiral by that of the set above it."""
    errors = {(c.law, c.set): mean(values) for c, values in cells_of("spiral", "error")}
    control = {(c.law, c.set): mean(values) for c, values in cells_of("spiral", "control")}

    def row(law: str) -> Cells:
        best, second, third = (errors[law, chosen] for chosen in SPIRALS)
        expected = 1 / math.sqrt(math.log(2)) if law.startswith("LQR") else 1 / math.log(2)
        return [
            (Column("law"), law),
            (Column("1 / gain ratio", "", ".3f"), expected),
            (Column("ln2 / best", "", ".3f"), second / best),
            (Column("ln2² / ln2", "", ".3f"), third / second),
            *((Column(f"mean T u, {each}", "rad", ".4f"), control[law, each] / 3000) for each in SPIRALS),
        ]

    return Table.of(map(row, LAWS), "Error of a gain set over that of the next higher one")


def shares() -> Table:
    """Multiply the errors of the H∞ laws by their share of the full gain."""
    cells = [cell for cell in published_cells("h-infinity") if cell.metric == "error"]
    rows: list[Cells] = [
        [
            (Column("law"), law),
            *(
                (Column(cell.set, "", ".3f"), cell.mean * float(cell.set[:-2]) / 100)
                for cell in cells
                if cell.law == law
            ),
        ]
        for law in LAWS[4:]
    ]
    return Table.of(rows, "Error × share of the full gain")


def feedforward() -> Table:
    """Test laws with feed-forward against those without, paired by repeat."""
    rows: list[Cells] = []
    for name, sets in (("circle", SERIES), ("spiral", SPIRALS)):
        runs = by_cell(name, "error")
        for plain, fed in (("K", "K+FF"), ("HIR", "HIRT")):
            for chosen in sets:
                without, with_it = array(runs[plain, chosen]), array(runs[fed, chosen])
                test = ttest_rel(with_it, without)
                low, high = test.confidence_interval(0.95)
                scale = 100 / without.mean()
                together = float(np.corrcoef(without, with_it)[0, 1])
                rows.append(
                    [
                        (Column("experiment"), name),
                        (Column("laws"), f"{fed} − {plain}"),
                        (Column("set"), chosen),
                        (Column("difference of errors", "%", "+.2f"), (with_it - without).mean() * scale),
                        (Column("95 % from", "%", "+.2f"), float(low * scale)),
                        (Column("to", "%", "+.2f"), float(high * scale)),
                        (Column("p", "", ".2g"), float(test.pvalue)),
                        (Column("correlation over repeats", "", ".2f"), together),
                    ]
                )
    return Table.of(rows, "Feed-forward, paired t-test")


def sessions() -> Table:
    """Show the four series of the circle: K's gain is the same in all of them."""
    runs = by_cell("circle", "error")
    errors = {key: mean(values) for key, values in runs.items()}
    rows: list[Cells] = [
        [
            (Column("law"), law),
            *((Column(s, "", ".3f"), errors[law, s] / errors[law, SERIES[0]]) for s in SERIES),
            *((Column(f"over K, {s}", "", ".3f"), errors[law, s] / errors["K", s]) for s in SERIES),
        ]
        for law in LAWS
    ]
    return Table.of(rows, "Error on the circle over that of the first series")


def drift() -> Table:
    """Compare first and last repeats of the spiral, and the deviation with that of neighbouring repeats."""

    def row(law: str, chosen: str) -> Cells:
        errors = array(by_cell("spiral", "error")[law, chosen])
        first, last = float(errors[:10].mean()), float(errors[-10:].mean())
        nearby = math.sqrt(np.mean(np.diff(errors) ** 2) / 2) / errors.mean() * 100
        return [
            (Column("law"), law),
            (Column("set"), chosen),
            (Column("repeats 1–3", "", ".3f"), float(errors[:3].mean())),
            (Column("1–10", "", ".3f"), first),
            (Column("41–50", "", ".3f"), last),
            (Column("41–50 / 1–10", "", ".3f"), last / first),
            (Column("deviation", "%", ".2f"), float(errors.std(ddof=1) / errors.mean() * 100)),
            (Column("deviation of neighbours", "%", ".2f"), nearby),
        ]

    return Table.of((row(law, chosen) for chosen in SPIRALS for law in LAWS), "Error over fifty spirals")


def repeatability() -> Table:
    """Count in how many of the fifteen printed deviations of the spiral a law is below K, and below K+FF."""
    deviations = {(c.law, c.set, c.metric): c.deviation or 0.0 for c in published_cells("spiral")}
    relative = {
        (c.law, c.set, metric): array(values).std(ddof=1) / mean(values)
        for metric in METRICS
        for c, values in cells_of("spiral", metric)
    }

    def below(law: str, table: dict[tuple[str, str, str], float], base: str) -> str:
        compared = [(table[law, s, m], table[base, s, m]) for s in SPIRALS for m in METRICS]
        return f"{sum(a < b for a, b in compared)} of {len(compared)}"

    rows: list[Cells] = [
        [
            (Column("law"), law),
            (Column("below K"), below(law, deviations, "K")),
            (Column("below K+FF"), below(law, deviations, "K+FF")),
            (Column("relative to the mean: below K"), below(law, relative, "K")),
            (Column("below K+FF"), below(law, relative, "K+FF")),
        ]
        for law in LAWS[2:]
    ]
    return Table.of(rows, "Deviations of fifty spirals below those of K and K+FF")


def misprints() -> Table:
    """List the printed means and deviations that the printed runs do not give."""
    rows: list[list[Cell]] = [
        [d.table, d.law, d.set, d.metric, d.statistic, d.printed, d.from_runs, d.reason]
        for name in REPRODUCTIONS
        for d in disagreements(name)
    ]
    titles = ("table", "law", "set", "metric", "statistic", "printed", "runs", "reason")
    return Table([Column(title, "", ".7g") for title in titles], rows, "Printed, but not what the runs give")


def by_cell(name: str, metric: str) -> dict[tuple[str, str], dict[int, float]]:
    """Return the repeats of one metric, by law and set."""
    found: dict[tuple[str, str], dict[int, float]] = {}
    for run in published_runs(name):
        if run.metric == metric:
            found.setdefault((run.law, run.set), {})[run.repeat] = run.value
    return found


def cells_of(name: str, metric: str) -> Iterator[tuple[PublishedCell, dict[int, float]]]:
    """Yield the printed cells of one metric, each with its repeats."""
    runs = by_cell(name, metric)
    for cell in published_cells(name):
        if cell.metric == metric:
            yield cell, runs[cell.law, cell.set]


def mean(repeats: dict[int, float]) -> float:
    """Return the mean of the repeats."""
    return float(array(repeats).mean())


def array(repeats: dict[int, float]) -> np.ndarray:
    """Return the repeats in their order."""
    return np.array([repeats[number] for number in sorted(repeats)])


if __name__ == "__main__":
    main()
