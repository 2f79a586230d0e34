"""One model of a table, and its four renderings: terminal, Markdown, CSV and LaTeX."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.errors import ExistsError, ShapeError, unknown_name

if TYPE_CHECKING:
    from rich.table import Table as RichTable

Cell = str | float | int | None

MISSING = "–"
_LATEX = {
    "\\": r"\textbackslash{}",
    **{sign: "\\" + sign for sign in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "|": r"\textbar{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "°": r"$^\circ$",
    "²": "$^2$",
    "√": r"$\surd$",
    "·": r"$\cdot$",
    "±": r"$\pm$",
    "−": "$-$",
    "–": "--",
    "∫": r"$\int$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "∞": r"$\infty$",
}


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Parameters
    ----------
    title
        Heading.
    unit
        Shown with the heading; empty for none.
    format
        Format of its floating-point numbers, as for `format`; integers and texts stand as they are.
    """

    title: str
    unit: str = ""
    format: str = ".4g"

    @property
    def heading(self) -> str:
        """Title and unit, as ``"Effort [rad/√s]"``."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    def show(self, cell: Cell) -> str:
        """Return a cell as text; a dash for ``None`` and for numbers that are not finite."""
        if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
            return MISSING
        return format(cell, self.format) if isinstance(cell, float) else str(cell)


@dataclass(frozen=True)
class Table:
    """Rows of texts and numbers under columns.

    Parameters
    ----------
    columns
        Their titles, units and formats.
    rows
        Each as long as ``columns``.
    title
        Caption; empty for none.

    Raises
    ------
    ShapeError
        If a row has another length.

    Examples
    --------
    >>> from dqcontrol.experiments.tables import Column, Table
    >>> table = Table([Column("Law"), Column("Length", "m", ".2f")], [["K", 1.2345], ["LQR", None]])
    >>> print(table.markdown(), end="")
    | Law | Length [m] |
    |:----|-----------:|
    | K   |       1.23 |
    | LQR |          – |
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    title: str = ""

    def __post_init__(self) -> None:
        for i, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ShapeError(f"rows[{i}]: expected {len(self.columns)} cells, got {len(row)}")

    def texts(self) -> list[list[str]]:
        """Return all cells as they are shown."""
        return [
            [column.show(cell) for column, cell in zip(self.columns, row, strict=True)] for row in self.rows
        ]

    def numeric(self) -> list[bool]:
        """Tell which columns hold numbers (and align right)."""
        cells = list(zip(*self.rows, strict=True)) or [()] * len(self.columns)
        return [
            any(c is not None for c in column) and not any(isinstance(c, str) for c in column)
            for column in cells
        ]

    def rich(self) -> RichTable:
        """Return it for `rich.print`, safe against markup in cells."""
        from rich.table import Table as RichTable
        from rich.text import Text

        table = RichTable(title=Text(self.title) if self.title else None)
        for column, numeric in zip(self.columns, self.numeric(), strict=True):
            table.add_column(Text(column.heading), justify="right" if numeric else "left")
        for row in self.texts():
            table.add_row(*map(Text, row))
        return table

    def markdown(self) -> str:
        """Return it as a GitHub table."""
        headings = [_one_line(column.heading) for column in self.columns]
        rows = [[_one_line(cell) for cell in row] for row in self.texts()]
        widths = [max(3, *(len(row[i]) for row in (headings, *rows))) for i in range(len(headings))]
        numeric = self.numeric()

        def line(cells: Sequence[str]) -> str:
            padded = (
                c.rjust(w) if right else c.ljust(w)
                for c, w, right in zip(cells, widths, numeric, strict=True)
            )
            return f"| {' | '.join(padded)} |"

        rule = "".join(
            f"|{'-' * (w + 1)}:" if right else f"|:{'-' * (w + 1)}"
            for w, right in zip(widths, numeric, strict=True)
        )
        caption = [f"**{_one_line(self.title)}**", ""] if self.title else []
        return "\n".join([*caption, line(headings), rule + "|", *map(line, rows)]) + "\n"

    def csv(self) -> str:
        """Return it as CSV with all digits; missing numbers are empty."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([column.heading for column in self.columns])
        for row in self.rows:
            writer.writerow(["" if isinstance(c, float) and not math.isfinite(c) else c for c in row])
        return stream.getvalue()

    def latex(self) -> str:
        r"""Return it as a ``tabular`` for the package booktabs, in a ``table`` if it has a title."""
        alignment = "".join("r" if right else "l" for right in self.numeric())
        lines = [rf"\begin{{tabular}}{{{alignment}}}", r"\toprule"]
        lines += [_latex_row([column.heading for column in self.columns]), r"\midrule"]
        lines += [_latex_row(row) for row in self.texts()]
        lines += [r"\bottomrule", r"\end{tabular}"]
        if self.title:
            lines = [
                r"\begin{table}",
                r"\centering",
                rf"\caption{{{_latex(self.title)}}}",
                *lines,
                r"\end{table}",
            ]
        return "\n".join(lines) + "\n"

    def write(self, path: str | Path) -> Path:
        """Write a new file, in the format that its suffix says: ``.md``, ``.csv`` or ``.tex``.

        Raises `UnknownNameError` for another suffix and `ExistsError` if the file exists.
        """
        path = Path(path)
        formats: dict[str, Callable[[], str]] = {".md": self.markdown, ".csv": self.csv, ".tex": self.latex}
        if path.suffix not in formats:
            raise unknown_name(f"{path}: suffix", path.suffix, formats)
        try:
            with open(path, "x", encoding="utf-8", newline="") as stream:
                stream.write(formats[path.suffix]())
        except FileExistsError:
            raise ExistsError(f"{path}: exists already; choose another name or remove it") from None
        return path


def _one_line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _latex(text: str) -> str:
    return "".join(_LATEX.get(sign, sign) for sign in " ".join(text.split()))


def _latex_row(cells: Sequence[str]) -> str:
    row = " & ".join(map(_latex, cells))
    return ("{}" if row[:1] in ("[", "*") else "") + row + r" \\"  # \\ before it would take those as its own
