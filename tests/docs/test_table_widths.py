"""Tables of the bundled examples in windows of 80, 100 and 120 letters."""

import io
import re

import pytest
from page_blocks import PAGES, ROOT
from rich.console import Console

import dqcontrol as dqc
from dqcontrol.cli import robots_command, start_commands
from dqcontrol.tables.fitted import fitted
from dqcontrol.tables.tables import Column, Table

WIDTHS = (80, 100, 120)
_SHOWN = re.compile(r"<!-- ([\w -]+ table): begin -->\n(.*?)<!--", re.DOTALL)


def tables_of_pages():
    """Return the tables that commands printed for examples, as the pages show them (other tests compare them)."""
    for page, path in PAGES.items():
        for name, text in _SHOWN.findall(path.read_text(encoding="utf-8")):
            head, _, *rows = (
                [cell.strip() for cell in line.strip("| \n").split(" | ")]
                for line in text.splitlines()
                if line.startswith("|")
            )
            yield pytest.param([head, *rows], id=f"{page}: {name}")


def as_number(cell):
    try:
        return float(cell)
    except ValueError:
        return None if cell == "–" else cell


def lines_of(table, width):
    stream = io.StringIO()
    console = Console(file=stream, width=width)
    for part in fitted(table, width, "--wide"):
        console.print(part)
    return stream.getvalue().splitlines()


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("cells", list(tables_of_pages()))
def test_tables_of_examples_fit(cells, width):
    head, *rows = cells
    table = Table(
        [Column(title, "", ".3g") for title in head], [[as_number(cell) for cell in row] for row in rows]
    )
    lines = lines_of(table, width)
    assert max(map(len, lines)) <= width
    shown = [line for line in lines if line.startswith("│")]
    assert [line.split("│")[1].strip() for line in shown] == [row[0] for row in rows]  # one line a row
    words = set(" ".join(" ".join(row) for row in cells).split())
    for line in shown:
        for word in re.sub("[│…]", " ", line).split():
            assert word in words or any(other.rstrip(";,:") == word for other in words), word


@pytest.mark.parametrize("width", WIDTHS)
def test_lists_and_robots_fit(width, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(width))
    start_commands.laws()
    start_commands.references()
    start_commands.plants()
    start_commands.robots()
    for name in dqc.robot_names():
        robots_command.show(name)
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if len(line) > width and not line.startswith("links from base")] == []


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["circle", "drift", "keep-out", "via-points", "sampling-limits"])
def test_checks_of_examples_fit(name, width):
    table = dqc.experiments.check(ROOT / "examples" / f"{name}.yaml").table()
    assert max(map(len, lines_of(table, width))) <= width
