"""Tables of the command line in narrow windows: folded, never cut."""

import io

import pytest
from rich.console import Console

from dqcontrol.measures.folded import folded
from dqcontrol.measures.table_cells import PlusMinus
from dqcontrol.measures.tables import Column, Table

NAMES = ["K · servo", "K+FF · physics"]
TITLES = ["run", "mean", "RMS", "peak speed", "limit margin", "effort", "ended by"]
UNITS = ["", "mm", "mm", "m/s", "rad", "rad/√s", ""]
ROWS = [[name, 9.374, 0.39152, PlusMinus(0.07471, 0.0012), 0.00695, 1234.5, "duration"] for name in NAMES]
TABLE = Table([Column(title, unit) for title, unit in zip(TITLES, UNITS, strict=True)], ROWS, "comparison")


def printed(table, width):
    stream = io.StringIO()
    console = Console(file=stream, width=width)
    for part in folded(table, width):
        console.print(part)
    return stream.getvalue()


@pytest.mark.parametrize("width", [50, 80, 100, 200])
def test_numbers_are_whole_in_every_window(width):
    text = printed(TABLE, width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    for row in TABLE.texts():
        for cell in row[1:]:
            assert f" {cell} " in text
    assert text.count("comparison") == 1
    parts = text.count("┏")
    assert parts == {50: 3, 80: 2}.get(width, 1)
    assert all(text.count(name) == parts for name in NAMES)


def test_what_fits_is_not_folded():
    wide = printed(TABLE, 200)
    assert printed(TABLE, max(map(len, wide.splitlines()))) == wide


def test_long_texts_break_and_lose_nothing():
    path = "/home/somebody/.cache/dqcontrol/" + "0123456789abcdef" * 3
    table = Table([Column("what"), Column("found")], [["kernels", path]])
    text = printed(table, 40)
    assert max(map(len, text.splitlines())) <= 40
    found = [line.split("│")[2].strip() for line in text.splitlines() if line.startswith("│")]
    assert "".join(found) == path


def test_no_window_is_too_narrow():
    for width in (1, 5, 20):
        assert printed(TABLE, width)
    assert printed(Table([Column("a")], []), 3)


def test_short_columns_are_not_starved_by_long_ones():
    """Each letter goes where cells have most lines: thirty letters beside sentences do not become a column of six."""
    cells = ["Section 5.4", "a long sentence that was claimed " * 4, "what we measured instead of it " * 4]
    columns = [Column("P16"), Column("Claim"), Column("Our number"), Column("P16's own numbers")]
    (shown,) = folded(Table(columns, [[*cells, "0.52, 0.71 and 0.93 of 1.00 all"]]), 100)
    widths = [column.width for column in shown.columns]
    assert (widths[3] or 0) > 10
