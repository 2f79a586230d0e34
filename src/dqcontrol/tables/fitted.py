"""Tables in windows that are too narrow for them: as many columns as fit, each row in one line."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dqcontrol.tables.tables import Table

if TYPE_CHECKING:
    from rich.console import RenderableType

_SHORT = 24  # letters that a text keeps where the window is narrow: a reason begins with what matters
_FRAME = 3  # letters beside each column
_INDENT = 4


def fitted(table: Table, width: int, hint: str) -> Iterator[RenderableType]:
    """Give a table in a window of so many letters, and a line on what is not shown.

    Numbers are never cut, texts only between words, and no cell has a second line. The texts before the first numbers
    name the rows and stay; further columns are shown in their order as long as there is room. A table of texts alone
    becomes a list.

    Parameters
    ----------
    table
        What is shown.
    width
        Letters a line.
    hint
        How to see all.
    """
    from rich.text import Text

    if _total(_least(table)) <= width:
        widths = _shared(_least(table), _most(table), width)
        yield table.rich(widths) if _total(_most(table)) > width else table.rich()
    elif not any(table.numeric()):
        yield Text(_listed(table, width))
    else:
        shown, widths = _chosen(table, width)
        yield _part(table, shown, widths).rich(widths)
        missing = [column.heading for i, column in enumerate(table.columns) if i not in shown]
        note = f"not shown: {', '.join(missing)}; all: {hint}" if missing else f"texts in full: {hint}"
        yield Text("\n".join(textwrap.wrap(note, width)))


def _chosen(table: Table, width: int) -> tuple[list[int], list[int]]:
    """Return which columns fit, and their widths."""
    least, numeric, cells = _least(table), table.numeric(), _longest_cells(table)
    names = numeric.index(True)
    needed = [now if number else min(now, _SHORT) for now, number in zip(least, numeric, strict=True)]
    needed[0] = least[0]
    first = range(max(names, 1))
    if _total([needed[i] for i in (*first, names)]) > width:
        first = range(1)
        needed[0] = min(needed[0], max(width - _total([needed[names]]) - _FRAME, 1))
    shown = list(first)
    for i in range(names, len(needed)):
        if _total([needed[k] for k in (*shown, i)]) > width and len(shown) > len(first):
            break
        shown.append(i)
    widths = [needed[i] for i in shown]
    for wishes in (cells, _most(table)):  # a heading never takes the room that a cell needs
        widths = _shared(widths, [wishes[i] for i in shown], width)
    return shown, widths


def _part(table: Table, shown: Sequence[int], widths: Sequence[int]) -> Table:
    """Return some columns of a table, their texts no longer than so many letters."""
    rows = [
        [
            _shortened(cell, width) if isinstance(cell := row[i], str) else cell
            for i, width in zip(shown, widths, strict=True)
        ]
        for row in table.rows
    ]
    return Table([table.columns[i] for i in shown], rows, table.title)


def _shortened(text: str, width: int) -> str:
    """Return the words of a text that fit, and what says that there are more."""
    if len(text) <= width:
        return text
    words = text[:width].rpartition(" ")[0].rstrip(" ,;:·")
    return f"{words}…" if words else f"{text[: width - 1]}…"


def _listed(table: Table, width: int) -> str:
    """Return each row as its first cell with the others below."""
    lines = [table.title] * bool(table.title)
    indent = " " * _INDENT
    wrap = textwrap.TextWrapper(max(width, 2 * _INDENT), initial_indent=indent, subsequent_indent=indent)
    titles = [f"{column.heading}: " if i > 1 else "" for i, column in enumerate(table.columns)]
    for row, cells in zip(table.rows, table.texts(), strict=True):
        said = [f"{title}{cell}" for title, value, cell in zip(titles, row, cells, strict=True) if value]
        lines += [said[0], *wrap.wrap("; ".join(said[1:]))]
    return "\n".join(lines)


def _most(table: Table) -> list[int]:
    """Return how wide each column is with everything in one line."""
    cells = _longest_cells(table)
    return [max(len(column.heading), cell) for column, cell in zip(table.columns, cells, strict=True)]


def _longest_cells(table: Table) -> list[int]:
    texts = table.texts()
    return [max((len(row[i]) for row in texts), default=0) for i in range(len(table.columns))]


def _least(table: Table) -> list[int]:
    """Return how narrow each column may be: only headings have several lines."""
    cells = _longest_cells(table)
    return [
        max(cell, *map(len, column.heading.split()), 1)
        for column, cell in zip(table.columns, cells, strict=True)
    ]


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + _FRAME * len(widths) + 1


def _shared(least: Sequence[int], most: Sequence[int], width: int) -> list[int]:
    """Return widths of columns: where room is left, each letter goes to the column whose texts have most lines."""
    widths = list(least)
    for _ in range(width - _total(least)):
        lines = [wish / max(now, 1) for wish, now in zip(most, widths, strict=True)]
        if max(lines) <= 1:
            break
        widths[lines.index(max(lines))] += 1
    return widths
