import csv
import io
import math
import re

import numpy as np
import pytest

from dqcontrol.errors import ExistsError, ShapeError, UnknownNameError
from dqcontrol.loop.record import Record
from dqcontrol.measures.metric_tables import METRIC_COLUMNS, PUBLISHED, comparison_table, summary_table
from dqcontrol.measures.metrics import Metrics, evaluate
from dqcontrol.tables.tables import Column, PlusMinus, Table

TABLE = Table(
    [Column("Law"), Column("Error", "mm", ".2f"), Column("Steps")],
    [["K & [bold]x[/bold]", 1.23456789012345, 30000], ["a|b\nc", math.nan, None]],
    "100 % of_it",
)


def metrics(offset=0.1) -> Metrics:
    pose = np.tile([1.0, 0, 0, 0, 0, offset / 2, 0, 0], (3, 1))
    desired = np.hstack([np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (3, 1)), np.zeros((3, 13))])
    q = np.zeros((3, 1))
    return evaluate(Record(np.array([0.0, 0.5, 1.0]), q, q, q, pose, desired, ("a",)))


def test_markdown_aligns_and_escapes():
    assert TABLE.markdown() == (
        "**100 % of_it**\n"
        "\n"
        "| Law                | Error [mm] | Steps |\n"
        "|:-------------------|-----------:|------:|\n"
        "| K & [bold]x[/bold] |       1.23 | 30000 |\n"
        "| a\\|b c             |          – |     – |\n"
    )


def test_csv_keeps_all_digits():
    rows = list(csv.reader(io.StringIO(TABLE.csv())))
    assert rows == [
        ["Law", "Error [mm]", "Steps"],
        ["K & [bold]x[/bold]", "1.23456789012345", "30000"],
        ["a|b\nc", "", ""],
    ]


def test_latex_escapes():
    assert TABLE.latex().splitlines() == [
        r"\begin{table}",
        r"\centering",
        r"\caption{100 \% of\_it}",
        r"\begin{tabular}{lrr}",
        r"\toprule",
        r"Law & Error [mm] & Steps \\",
        r"\midrule",
        r"K \& [bold]x[/bold] & 1.23 & 30000 \\",
        r"a\textbar{}b c & -- & -- \\",
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]


PUBLISHED_AND_OURS = Table(
    [Column("Law"), Column("Published", "s"), Column("Ours", "s"), Column("Ratio", "", ".2f")],
    [
        ["K", PlusMinus(3.1614, 0.0861), PlusMinus(12.5, 1.23), 3.95],
        ["LQR", 4.882, PlusMinus(None, None), None],
    ],
)


def test_spreads_stand_below_each_other():
    assert PUBLISHED_AND_OURS.markdown() == (
        "| Law | Published [s] |   Ours [s] | Ratio |\n"
        "|:----|--------------:|-----------:|------:|\n"
        "| K   | 3.161 ± 0.086 | 12.5 ± 1.2 |  3.95 |\n"
        "| LQR | 4.882         |    –       |     – |\n"
    )
    assert list(csv.reader(io.StringIO(PUBLISHED_AND_OURS.csv()))) == [
        ["Law", "Published [s]", "± Published [s]", "Ours [s]", "± Ours [s]", "Ratio"],
        ["K", "3.1614", "0.0861", "12.5", "1.23", "3.95"],
        ["LQR", "4.882", "", "", "", ""],
    ]
    assert PUBLISHED_AND_OURS.latex().splitlines() == [
        r"\begin{tabular}{lr@{${}\pm{}$}lr@{${}\pm{}$}lr}",
        r"\toprule",
        r"Law & \multicolumn{2}{c}{Published [s]} & \multicolumn{2}{c}{Ours [s]} & Ratio \\",
        r"\midrule",
        r"K & 3.161 & 0.086 & 12.5 & 1.2 & 3.95 \\",
        r"LQR & \multicolumn{2}{c}{4.882} & \multicolumn{2}{c}{--} & -- \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]


@pytest.mark.parametrize(
    ("value", "spread", "text"),
    [
        (3.1614, 0.0861, "3.161 ± 0.086"),
        (5.0, 0.0996, "5.00 ± 0.10"),  # two digits after rounding
        (-0.0123, 0.5, "-0.01 ± 0.50"),
        (0.0, 0.2, "0.00 ± 0.20"),
        (344.05, 2.879, "344.1 ± 2.9"),
        (12345.6, 234.0, "12350 ± 230"),
        (1.26274e-1, 2.4e-5, "0.126274 ± 0.000024"),
        (0.03204, 4.8e-7, "0.03204000 ± 0.00000048"),
        (1.2e-7, 3.4e-9, "1.200e-07 ± 3.4e-09"),
        (2.5e9, 3.4e7, "2.500e+09 ± 3.4e+07"),
        (1.0, 1.2e-11, "1 ± 1.2e-11"),
        (1.25, 0.0, "1.25 ± 0"),
        (1.25, None, "1.25"),
        (1.25, math.nan, "1.25"),
        (math.nan, 0.1, "–"),
    ],
)
def test_a_value_is_shown_to_the_place_of_its_spread(value, spread, text):
    assert Column("A").show(PlusMinus(value, spread)) == text


def test_every_heading_is_plain_latex():
    mathtext = pytest.importorskip("matplotlib.mathtext").MathTextParser("path")
    text = Table([Column(column.title, column.unit) for column in METRIC_COLUMNS.values()], []).latex()
    text += Table([Column("θ̇ of LQR in ℝ⁸, 50 % ± 3·10⁻⁴ [°] & γ_Ω < λ…")], [["m/s² ≤ 1e-5"]]).latex()
    assert text.isascii()
    for formula in re.findall(r"\$[^$]+\$", text):
        mathtext.parse(formula.replace(r"\surd", r"\sqrt{x}"))  # matplotlib does not know this one
    assert r"$\dot{\theta}$ of LQR in $\mathbf{R}$$^8$, 50 \% $\pm$ 3" in text


def test_numbers_in_latex():
    lines = Table([Column("A"), Column("B")], [[-1.5, 1.23e-9], [2.0, -4e12]]).latex().splitlines()
    assert lines[4:6] == [
        r"$-1.5$ & $1.23 \times 10^{-9}$ \\",
        r"2 & $-4 \times 10^{12}$ \\",
    ]


def test_latex_rows_do_not_become_arguments_of_the_row_before():
    lines = Table([Column("A")], [["[x]"], ["*"]]).latex().splitlines()
    assert lines[4:6] == [r"{}[x] \\", r"{}* \\"]


def test_terminal_shows_markup_as_text():
    from rich.console import Console

    console = Console(file=io.StringIO(), width=80)
    console.print(TABLE.rich())
    shown = console.file.getvalue()
    assert "K & [bold]x[/bold]" in shown
    assert "Error [mm]" in shown
    assert "1.23" in shown


def test_a_table_without_rows_has_its_headings():
    empty = Table([Column("A"), Column("B", "m")], [])
    assert empty.markdown() == "| A   | B [m] |\n|:----|:------|\n"
    assert empty.csv() == "A,B [m]\n"


def test_rows_of_another_length_are_refused():
    with pytest.raises(ShapeError, match=r"rows\[1\]: expected 1 cells, got 2"):
        Table([Column("A")], [[1], [1, 2]])


def test_write_chooses_by_suffix_and_keeps_what_exists(tmp_path):
    for suffix, text in ((".md", TABLE.markdown()), (".csv", TABLE.csv()), (".tex", TABLE.latex())):
        assert TABLE.write(tmp_path / f"t{suffix}").read_bytes().decode() == text
    with pytest.raises(ExistsError, match="exists already"):
        TABLE.write(tmp_path / "t.md")
    with pytest.raises(UnknownNameError, match=r"suffix: unknown name '.txt'.*allowed: .csv, .md, .tex"):
        TABLE.write(tmp_path / "t.txt")


def test_every_metric_has_a_column_and_every_column_a_metric():
    assert set(METRIC_COLUMNS) == set(metrics().flat())


def test_summary_leaves_out_what_does_not_exist():
    rows = {row[0]: row[1:] for row in summary_table(metrics()).rows}
    assert rows["Position error mean"] == ["100", "mm"]
    assert rows["Samples"] == ["3", ""]
    assert "Verdict" not in rows, "is printed for itself, and takes the width of a window"
    assert "Limit margin" not in rows
    assert "Nearest to limit" not in rows


def test_comparison_has_a_row_a_run():
    table = comparison_table({"K": metrics(0.1), "LQR": metrics(0.2)}, PUBLISHED)
    assert [c.heading for c in table.columns][:3] == [
        "Run",
        "Pose error integral [s]",
        "Control integral [rad or m]",
    ]
    assert [row[:2] for row in table.rows] == [["K", pytest.approx(0.05)], ["LQR", pytest.approx(0.1)]]
    with pytest.raises(UnknownNameError, match=re.escape("'error.integrl'; did you mean 'error.integral'?")):
        comparison_table({}, ["error.integrl"])
