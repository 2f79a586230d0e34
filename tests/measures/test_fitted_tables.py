"""Tables of the command line in narrow windows: fewer columns, whole words and numbers, one line a row."""

import io

import pytest
from rich.console import Console

from dqcontrol.errors import UnknownNameError
from dqcontrol.tables.fitted import fitted
from dqcontrol.tables.tables import Column, PlusMinus, Table

NAMES = ["K · servo", "K+FF · physics"]
TITLES = ["run", "mean", "RMS", "peak speed", "limit margin", "effort", "ended by"]
UNITS = ["", "mm", "mm", "m/s", "rad", "rad/√s", ""]
ROWS = [[name, 9.374, 0.39152, PlusMinus(0.07471, 0.0012), 0.00695, 1234.5, "duration"] for name in NAMES]
TABLE = Table([Column(title, unit) for title, unit in zip(TITLES, UNITS, strict=True)], ROWS, "comparison")


def printed(table, width):
    stream = io.StringIO()
    console = Console(file=stream, width=width)
    for part in fitted(table, width, "--wide"):
        console.print(part)
    return stream.getvalue()


@pytest.mark.parametrize("width", [50, 80, 100, 200])
def test_rows_have_one_line_and_numbers_are_whole(width):
    text = printed(TABLE, width)
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    assert text.count("┏") == 1
    rows = [line for line in lines if line.startswith("│")]
    assert len(rows) == len(NAMES)
    assert [row.split("│")[1].strip() for row in rows] == NAMES
    shown = len(rows[0].split("│")) - 2
    for row, line in zip(TABLE.texts(), rows, strict=True):
        assert [cell.strip() for cell in line.split("│")[1:-1]] == [cell.strip() for cell in row[:shown]]
    said = " ".join(lines[-3:])
    missing = [column.heading for column in TABLE.columns[shown:]]
    assert all(heading in said for heading in missing)
    assert ("--wide" in said) == bool(missing)


def test_what_fits_is_as_it_is():
    wide = printed(TABLE, 200)
    assert printed(TABLE, max(map(len, wide.splitlines()))) == wide


def test_reasons_end_after_a_word():
    reason = "too late: 9.93 mm behind; not followed: errs by 10.9 mm RMS"
    columns = [Column("run"), Column("verdict"), *[Column("error of something", "mm", ".3g")] * 6]
    text = printed(Table(columns, [["K · ideal", reason, *[1.234] * 6]]), 80)
    (row,) = [line for line in text.splitlines() if line.startswith("│")]
    shown = row.split("│")[2].strip()
    assert shown.endswith("…")
    assert reason.startswith(shown[:-1])
    assert reason[len(shown) - 1] in " ;:,"


def test_a_table_of_texts_becomes_a_list_that_loses_nothing():
    rows = [
        ["circle", "A circle about the start, in a plane of the frame", "radius, duration"],
        ["own", "Yours", ""],
    ]
    text = printed(Table([Column("kind"), Column("what it is"), Column("needs")], rows), 40)
    assert max(map(len, text.splitlines())) <= 40
    assert " ".join(text.split()) == (
        "circle A circle about the start, in a plane of the frame; needs: radius, duration own Yours"
    )


def test_no_window_is_too_narrow():
    for width in (1, 5, 20):
        assert printed(TABLE, width)
    assert printed(Table([Column("a")], []), 3)


def test_headings_break_before_names_do():
    name = "proportional · integrator"
    table = Table(
        [Column("run"), *[Column("error of something", "mm", ".3g")] * 4], [[name, 1.0, 2.0, 3.0, 4.0]]
    )
    for width in range(80, 120):
        assert name in printed(table, width)


def test_columns_by_name():
    table = TABLE.with_columns(["rms", "effort"])
    assert [column.title for column in table.columns] == ["run", "RMS", "effort"]
    with pytest.raises(UnknownNameError, match="columns"):
        TABLE.with_columns(["root mean"])
