"""Tables in windows that are too narrow for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dqcontrol.measures.tables import Table

if TYPE_CHECKING:
    from rich.table import Table as RichTable

_WORD = 32  # letters; longer words are broken
_FRAME = 3  # letters beside each column


def folded(table: Table, width: int) -> Iterator[RichTable]:
    """Give a table, where it is wider than so many letters in parts, one below the other, all with its labels.

    Labels are the columns of texts before the first of numbers. Numbers are never cut.
    """
    least, most = _least(table), _most(table)
    if _total(most) <= width:
        yield table.rich()
        return
    numeric = table.numeric()
    labels = range(max(numeric.index(True) if any(numeric) else len(numeric), 1))
    parts, others = [list(labels)], range(len(labels), len(numeric))
    for i in others:
        if len(parts[-1]) > len(labels) and _total([least[k] for k in (*parts[-1], i)]) > width:
            parts.append(list(labels))
        parts[-1].append(i)
    for n, part in enumerate(parts):
        widths = _shared([least[i] for i in part], [most[i] for i in part], width)
        yield _columns(table, part, table.title if n == 0 else "").rich(widths)


def _columns(table: Table, part: Sequence[int], title: str) -> Table:
    return Table([table.columns[i] for i in part], [[row[i] for i in part] for row in table.rows], title)


def _most(table: Table) -> list[int]:
    """Return how wide each column is with everything in one line."""
    lines = [[column.heading for column in table.columns], *table.texts()]
    return [max(map(len, column)) for column in zip(*lines, strict=True)]


def _least(table: Table) -> list[int]:
    """Return how narrow each column may be; where there are numbers only long texts are broken."""
    texts, out = table.texts(), []
    whole = any(table.numeric())
    for i, (column, numeric) in enumerate(zip(table.columns, table.numeric(), strict=True)):
        cells = [row[i] for row in texts]
        words = [*column.heading.split(), *(cells if whole else " ".join(cells).split())]
        longest = max(map(len, words), default=1)
        out.append(longest if numeric else min(longest, _WORD))
    return out


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + _FRAME * len(widths) + 1


def _shared(least: Sequence[int], most: Sequence[int], width: int) -> list[int]:
    """Return widths of columns: where room is left, each letter goes to the column whose cells have most lines."""
    widths = list(least)
    for _ in range(width - _total(least)):
        lines = [wish / max(now, 1) for wish, now in zip(most, widths, strict=True)]
        if max(lines) <= 1:
            break
        widths[lines.index(max(lines))] += 1
    return widths
