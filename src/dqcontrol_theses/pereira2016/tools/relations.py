"""Print which relations hold within the printed numbers of [P16].

With a servo that stands off its target by s and is sent "measured position + T u", u settles where T u makes up for s:
e k T and the mean of |T u| are then the same for all laws, and errors are inverse to the loop gain k. The loop gain of
the linear quadratic laws is √(q/r). All errors are integrals over a run of N samples of T: mean = Err / (N T).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from scipy.stats import ttest_rel

from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses import PublishedCell
from dqcontrol_theses.pereira2016 import REPRODUCTIONS, disagreements, published_cells, published_runs

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
    for table in (
        levels(),
        steps(),
        shares(),
        feedforward(),
        sessions(),
        drift(),
        repeatability(),
        misprints(),
    ):
        print(table.markdown())


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
    rows: list[list[Cell]] = []
    for name in ("lqr", "circle", "h-infinity", "spiral", "circle-and-square"):
        runs: dict[tuple[str, str, str], dict[str, PublishedCell]] = {}
        for cell in published_cells(name):
            if name != "circle" or not cell.set:  # the circle's other cells are those of lqr
                runs.setdefault((cell.experiment or name, cell.law, cell.set), {})[cell.metric] = cell
        for run, cells in runs.items():
            samples, period, path = RUNS[run[0]]
            share = ERROR_SHARE.get(name, 1.0)
            scaled = cells["error"].mean / (samples * share) * gain(cells["error"])
            commanded = cells["control"].mean / (period if name == "circle-and-square" else 1)
            moved = cells["joint_step"].mean / period
            hand = cells["hand_speed"].mean
            ratio = scaled * samples / commanded
            rows.append([*run, scaled, commanded / samples, ratio, commanded / moved, hand / path])
    columns = [Column("experiment"), Column("law"), Column("set"), Column("mean e k T", "", ".4f")]
    columns += [Column("mean T u", "rad", ".4f"), Column("e k / u", "", ".3f")]
    columns += [Column("commanded / moved", "", ".1f")]
    return Table([*columns, Column("hand's path / desired", "", ".2f")], rows, "Levels")


def steps() -> Table:
    """Divide the error of each gain set of the spiral by that of the set above it."""
    errors = {(c.law, c.set): mean(values) for c, values in cells_of("spiral", "error")}
    control = {(c.law, c.set): mean(values) for c, values in cells_of("spiral", "control")}
    rows: list[list[Cell]] = []
    for law in LAWS:
        expected = 1 / math.sqrt(math.log(2)) if law.startswith("LQR") else 1 / math.log(2)
        found = [errors[law, low] / errors[law, high] for high, low in pairwise(SPIRALS)]
        rows.append([law, expected, *found, *(control[law, chosen] / 3000 for chosen in SPIRALS)])
    columns = [Column("law"), Column("1 / gain ratio", "", ".3f"), Column("ln2 / best", "", ".3f")]
    columns += [Column("ln2² / ln2", "", ".3f")]
    columns += [Column(f"mean T u, {chosen}", "rad", ".4f") for chosen in SPIRALS]
    return Table(columns, rows, "Error of a gain set over that of the next higher one")


def shares() -> Table:
    """Multiply the errors of the H∞ laws by their share of the full gain."""
    cells = [cell for cell in published_cells("h-infinity") if cell.metric == "error"]
    columns = [Column("law"), *(Column(cell.set, "", ".3f") for cell in cells[:5])]
    products = {law: [c.mean * float(c.set[:-2]) / 100 for c in cells if c.law == law] for law in LAWS[4:]}
    return Table(
        columns, [[law, *values] for law, values in products.items()], "Error × share of the full gain"
    )


def feedforward() -> Table:
    """Test laws with feed-forward against those without, paired by repeat."""
    rows: list[list[Cell]] = []
    for name, sets in (("circle", SERIES), ("spiral", SPIRALS)):
        runs = by_cell(name, "error")
        for plain, fed in (("K", "K+FF"), ("HIR", "HIRT")):
            for chosen in sets:
                without, with_it = array(runs[plain, chosen]), array(runs[fed, chosen])
                test = ttest_rel(with_it, without)
                low, high = test.confidence_interval(0.95)
                scale = 100 / without.mean()
                together = float(np.corrcoef(without, with_it)[0, 1])
                difference = (with_it - without).mean() * scale
                row = [float(x) for x in (difference, low * scale, high * scale, test.pvalue, together)]
                rows.append([name, f"{fed} − {plain}", chosen, *row])
    columns = [
        Column("experiment"),
        Column("laws"),
        Column("set"),
        Column("difference of errors", "%", "+.2f"),
    ]
    columns += [Column("95 % from", "%", "+.2f"), Column("to", "%", "+.2f"), Column("p", "", ".2g")]
    return Table(
        [*columns, Column("correlation over repeats", "", ".2f")], rows, "Feed-forward, paired t-test"
    )


def sessions() -> Table:
    """Show the four series of the circle: K's gain is the same in all of them."""
    runs = by_cell("circle", "error")
    errors = {key: mean(values) for key, values in runs.items()}
    first = SERIES[0]
    rows: list[list[Cell]] = [
        [
            law,
            *(errors[law, s] / errors[law, first] for s in SERIES),
            *(errors[law, s] / errors["K", s] for s in SERIES),
        ]
        for law in LAWS
    ]
    columns = [Column("law"), *(Column(s, "", ".3f") for s in SERIES)]
    columns += [Column(f"over K, {s}", "", ".3f") for s in SERIES]
    return Table(columns, rows, "Error on the circle over that of the first series")


def drift() -> Table:
    """Compare first and last repeats of the spiral, and the deviation with that of neighbouring repeats."""
    rows: list[list[Cell]] = []
    for chosen in SPIRALS:
        for law in LAWS:
            errors = array(by_cell("spiral", "error")[law, chosen])
            tens = (float(errors[:10].mean()), float(errors[-10:].mean()))
            overall = errors.std(ddof=1) / errors.mean() * 100
            nearby = math.sqrt(np.mean(np.diff(errors) ** 2) / 2) / errors.mean() * 100
            rows.append(
                [law, chosen, float(errors[:3].mean()), *tens, tens[1] / tens[0], float(overall), nearby]
            )
    columns = [Column("law"), Column("set"), Column("repeats 1–3", "", ".3f"), Column("1–10", "", ".3f")]
    columns += [
        Column("41–50", "", ".3f"),
        Column("41–50 / 1–10", "", ".3f"),
        Column("deviation", "%", ".2f"),
    ]
    return Table([*columns, Column("deviation of neighbours", "%", ".2f")], rows, "Error over fifty spirals")


def repeatability() -> Table:
    """Count in how many of the fifteen printed deviations of the spiral a law is below K, and below K+FF."""
    deviations = {(c.law, c.set, c.metric): c.deviation or 0.0 for c in published_cells("spiral")}
    relative = {
        (c.law, c.set, metric): array(values).std(ddof=1) / mean(values)
        for metric in METRICS
        for c, values in cells_of("spiral", metric)
    }
    rows: list[list[Cell]] = []
    for law in LAWS[2:]:
        below = []
        for table, base in ((deviations, "K"), (deviations, "K+FF"), (relative, "K"), (relative, "K+FF")):
            compared = [(table[law, s, m], table[base, s, m]) for s in SPIRALS for m in METRICS]
            below.append(f"{sum(a < b for a, b in compared)} of {len(compared)}")
        rows.append([law, *below])
    columns = [
        Column("law"),
        Column("below K"),
        Column("below K+FF"),
        Column("relative to the mean: below K"),
    ]
    return Table(
        [*columns, Column("below K+FF")], rows, "Deviations of fifty spirals below those of K and K+FF"
    )


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
