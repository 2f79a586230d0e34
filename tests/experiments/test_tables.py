import csv
import io
import math
import re

import numpy as np
import pytest

from dqcontrol.errors import ExistsError, ShapeError, UnknownNameError
from dqcontrol.experiments.metric_tables import (
    METRIC_COLUMNS,
    PUBLISHED,
    comparison_table,
    repeats_table,
    summary_table,
)
from dqcontrol.experiments.metrics import Metrics, evaluate
from dqcontrol.experiments.tables import Column, Table
from dqcontrol.loop.record import Record

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


def test_latex_rows_do_not_become_arguments_of_the_row_before():
    lines = Table([Column("A")], [["[x]"], ["*"]]).latex().splitlines()
    assert lines[4:6] == [r"{}[x] \\", r"{}* \\"]


def test_terminal_shows_markup_as_text():
    from rich.console import Console

    console = Console(file=io.StringIO(), width=80)
    console.print(TABLE.rich())
    shown = console.file.getvalue()  # type: ignore[attr-defined]
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
    assert "Limit margin" not in rows
    assert "Nearest to limit" not in rows


def test_comparison_has_a_row_a_run():
    table = comparison_table({"K": metrics(0.1), "LQR": metrics(0.2)}, PUBLISHED)
    assert [c.heading for c in table.columns][:3] == ["Run", "Error integral [s]", "Control integral [rad]"]
    assert [row[:2] for row in table.rows] == [["K", pytest.approx(0.05)], ["LQR", pytest.approx(0.1)]]
    with pytest.raises(UnknownNameError, match=re.escape("'error.integrl'; did you mean 'error.integral'?")):
        comparison_table({}, ["error.integrl"])


def test_repeats_give_mean_and_sample_deviation():
    table = repeats_table(
        {"K": [metrics(0.1), metrics(0.2), metrics(0.3)], "one": [metrics()]}, ["error.integral"]
    )
    assert [c.heading for c in table.columns][2:] == ["Error integral [s]", "± Error integral [s]"]
    assert list(table.rows[0]) == ["K", 3, pytest.approx(0.1), pytest.approx(0.05)]
    assert list(table.rows[1]) == ["one", 1, pytest.approx(0.05), None]
    assert repeats_table({"K": [metrics()]}, ["settling_time"]).rows[0][2] is None
    with pytest.raises(ShapeError, match="'none' has no runs"):
        repeats_table({"none": []})
    with pytest.raises(UnknownNameError, match="limit_joint"):
        repeats_table({}, ["limit_joint"])
