"""One model of a table, and its four renderings: terminal, Markdown, CSV and LaTeX."""

from __future__ import annotations

import csv
import io
import math
import re
import shutil
import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from dqcontrol.errors import ExistsError, ShapeError, unknown_name
from dqcontrol.tables.number_texts import without_powers

if TYPE_CHECKING:
    from rich.table import Table as RichTable


T = TypeVar("T")

MISSING = "–"
_AGREES = 0.1  # as a ratio: 10 %
_DIGITS = 8  # of a value that is shown to the place of its spread; beyond, both are shown for themselves


@dataclass(frozen=True)
class PlusMinus:
    """A cell of a value and its spread, as mean and standard deviation.

    Parameters
    ----------
    value
        The number; None or not finite where there is none.
    spread
        In the same unit; None or not finite where there is none.

    Examples
    --------
    >>> print(PlusMinus(1.23216, 0.0357))
    1.232 ± 0.036
    """

    value: float | None
    spread: float | None

    def parts(self, form: str) -> tuple[str, str]:
        """Return both as texts: the spread with two digits, the value to the same place, or in the format ``form``."""
        value, spread = known(self.value), known(self.spread)
        if value is None:
            return MISSING, ""
        if spread is None:
            return format(value, form), ""
        place = _exponent(spread, ".1e") - 1  # of the last digit shown, as a power of ten
        first = _exponent(value, "e") if value else place
        if not spread or first - place >= _DIGITS:
            return format(value, form), format(spread, ".2g")
        if -5 < max(first, place) < 6:  # as without a spread, no exponent
            form = f".{max(-place, 0)}f"
            return format(round(value, -place), form), format(round(spread, -place), form)
        return format(value, f".{max(first - place, 0)}e"), format(spread, ".1e")

    def __str__(self) -> str:
        """Return the cell as text, without a column."""
        return Column("").show(self)


class VerdictCell(str):
    """A cell in words that says, too, whether it is good: pages mark it.

    Parameters
    ----------
    words
        As ``"kept"``.
    good
        None where it is neither good nor bad.

    Examples
    --------
    >>> verdict = VerdictCell("kept", True)
    >>> verdict, verdict.good
    ('kept', True)
    """

    good: bool | None

    @classmethod
    def of(cls, good: bool, words: str, otherwise: str) -> VerdictCell:
        """Return the cell that says one thing if all is good, and another one if not."""
        return cls(words if good else otherwise, good)

    def __new__(cls, words: str, good: bool | None) -> VerdictCell:
        """Make a text that knows."""
        self = super().__new__(cls, words)
        self.good = good
        return self


class Ratio(float):
    """A cell of our number over another's, which pages mark by whether they agree within 10 %.

    Examples
    --------
    >>> Ratio(1.04).good, Ratio(0.5).good
    (True, False)
    """

    @property
    def good(self) -> bool:
        """Whether the two agree."""
        return abs(self - 1) <= _AGREES

    @property
    def words(self) -> str:
        """The same in words."""
        return "agrees" if self.good else "differs"


Cell = str | float | int | PlusMinus | None


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
        Format of its floating-point numbers, as for Python's ``format``; integers and texts stand as they are.
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
        return " ± ".join(filter(None, self.parts(cell)))

    def parts(self, cell: Cell) -> tuple[str, str]:
        """Return the text of a cell and that of its spread, empty if it has none."""
        if isinstance(cell, PlusMinus):
            return cell.parts(self.format)
        if known(cell) is None:
            return MISSING, ""
        if not isinstance(cell, float):
            return str(cell), ""
        return (without_powers if self.format.endswith("g") else format)(cell, self.format), ""


def known(cell: T) -> T | None:
    """Return the cell, or ``None`` for a number that is not finite."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _exponent(number: float, form: str) -> int:
    return int(format(number, form).partition("e")[2])


_TEXT = {
    "\\": r"\textbackslash{}",
    **{sign: "\\" + sign for sign in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "|": r"\textbar{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
    "—": "---",
    "…": r"\dots{}",
}
_MATHEMATICS = {
    "°": r"^\circ",
    "√": r"\surd",
    "∫": r"\int",
    "·": r"\cdot",
    "×": r"\times",
    "±": r"\pm",
    "−": "-",
    "≤": r"\leq",
    "≥": r"\geq",
    "≈": r"\approx",
    "≠": r"\neq",
    "∞": r"\infty",
    "→": r"\to",
    "ℝ": r"\mathbf{R}",
    "⁻": "^-",
    **{sign: f"^{digit}" for digit, sign in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")},
    **{sign: f"_{digit}" for digit, sign in enumerate("₀₁₂₃₄₅₆₇₈₉")},
}
_DOT = "\u0307"  # above the letter before it, as in the control signal's θ̇
_SIGN = re.compile(f".{_DOT}?", re.DOTALL)
_GREEK = re.compile(r"GREEK (SMALL|CAPITAL) LETTER ([A-Z]+)")


def latex(text: str) -> str:
    r"""Return a text for LaTeX, in which nothing is a command.

    Examples
    --------
    >>> print(latex("50 % of m/s²"))
    50 \% of m/s$^2$
    """
    return _SIGN.sub(_latex_sign, " ".join(text.split()))


def latex_number(text: str) -> str:
    r"""Return a number, as Python writes it, for LaTeX.

    Examples
    --------
    >>> print(latex_number("-1.2e-05"))
    $-1.2 \times 10^{-5}$
    """
    mantissa, _, exponent = text.partition("e")
    if exponent:
        return rf"${mantissa} \times 10^{{{int(exponent)}}}$"
    return f"${text}$" if text.startswith("-") else latex(text)


def _latex_sign(match: re.Match[str]) -> str:
    sign = match.group()
    if sign.endswith(_DOT):
        return rf"$\dot{{{_greek(sign[0]) or sign[0]}}}$"
    mathematics = _MATHEMATICS.get(sign) or _greek(sign)
    return f"${mathematics}$" if mathematics else _TEXT.get(sign, sign)


def _greek(sign: str) -> str:
    """Return the command of a Greek letter, or nothing."""
    match = _GREEK.fullmatch(unicodedata.name(sign, ""))
    if not match:
        return ""
    name = match.group(2).replace("LAMDA", "LAMBDA").lower()  # Unicode's spelling
    return "\\" + (name if match.group(1) == "SMALL" else name.capitalize())


_UNWATCHED = 200  # letters a line, where there is no window


@dataclass(frozen=True, repr=False)
class Table:
    """Rows of texts, numbers and numbers with their spread (`PlusMinus`) under columns.

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
    >>> from dqcontrol.tables.tables import Column, Table
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

    @classmethod
    def of(cls, rows: Iterable[Sequence[tuple[Column, Cell]]], title: str = "") -> Table:
        """Return the table of rows, at least one, whose cells stand beside their columns.

        Examples
        --------
        >>> from dqcontrol.tables import Column, Table
        >>> laws = {"K": 1.2345, "LQR": None}
        >>> print(Table.of([(Column("Law"), law), (Column("Length", "m", ".2f"), laws[law])] for law in laws).csv())
        Law,Length [m]
        K,1.2345
        LQR,
        <BLANKLINE>
        """
        given = [list(row) for row in rows]
        return cls([column for column, _ in given[0]], [[cell for _, cell in row] for row in given], title)

    def __repr__(self) -> str:
        title = f"{self.title!r}, " if self.title else ""
        return f"Table({title}{len(self.rows)} × {len(self.columns)})"

    def __str__(self) -> str:
        """Return it as the terminal shows it, with as many columns as fit."""
        from rich.console import Console

        from dqcontrol.tables.fitted import fitted

        width = shutil.get_terminal_size((_UNWATCHED, 24)).columns
        console = Console(file=io.StringIO(), width=width, color_system=None)
        with console.capture() as capture:
            for part in fitted(self, width, "markdown()"):
                console.print(part)
        return capture.get().rstrip("\n")

    def texts(self) -> list[list[str]]:
        """Return all cells as they are shown, the signs ± of a column one below the other."""
        columns = [
            _aligned([column.parts(row[i]) for row in self.rows]) for i, column in enumerate(self.columns)
        ]
        return [[column[k] for column in columns] for k in range(len(self.rows))]

    def numeric(self) -> list[bool]:
        """Tell which columns hold numbers (and align right)."""
        cells = list(zip(*self.rows, strict=True)) or [()] * len(self.columns)
        return [
            any(c is not None for c in column) and not any(isinstance(c, str) for c in column)
            for column in cells
        ]

    def spread(self) -> list[bool]:
        """Tell which columns hold numbers with their spread."""
        return [any(isinstance(row[i], PlusMinus) for row in self.rows) for i in range(len(self.columns))]

    def with_columns(self, names: Iterable[str]) -> Table:
        """Return its first column and those whose titles begin so, in the order asked for.

        Raises `UnknownNameError` for a name that begins none.
        """
        chosen = [0]
        for name in names:
            wanted = name.strip().casefold()
            found = [i for i, column in enumerate(self.columns) if column.title.casefold().startswith(wanted)]
            if not found:
                raise unknown_name("columns", name.strip(), (column.title for column in self.columns))
            chosen += [i for i in found if i not in chosen]
        columns = [self.columns[i] for i in chosen]
        return Table(columns, [[row[i] for i in chosen] for row in self.rows], self.title)

    def rich(self, widths: Sequence[int] | None = None) -> RichTable:
        """Return it for ``rich.print``, safe against markup in cells; columns perhaps of given widths, in letters."""
        from rich.table import Table as RichTable
        from rich.text import Text

        table = RichTable(title=Text(self.title) if self.title else None)
        given = widths or [None] * len(self.columns)
        for column, numeric, width in zip(self.columns, self.numeric(), given, strict=True):
            justify = "right" if numeric else "left"
            table.add_column(Text(column.heading), justify=justify, overflow="fold", width=width)
        for row in self.texts():
            table.add_row(*map(Text, row))
        return table

    def markdown(self) -> str:
        """Return it as a GitHub table."""
        headings = [_one_line(column.heading) for column in self.columns]
        rows = [[_one_line(cell) for cell in row] for row in self.texts()]
        widths = [max(3, *(len(row[i]) for row in (headings, *rows))) for i in range(len(headings))]
        numeric = self.numeric()

        signs = [">" if right else "<" for right in numeric]

        def line(cells: Sequence[str]) -> str:
            padded = (f"{c:{sign}{w}}" for c, w, sign in zip(cells, widths, signs, strict=True))
            return f"| {' | '.join(padded)} |"

        dashes = ["-" * (w + 1) for w in widths]
        rule = "".join(f"|{d}:" if right else f"|:{d}" for d, right in zip(dashes, numeric, strict=True))
        caption = [f"**{_one_line(self.title)}**", ""] if self.title else []
        return "\n".join([*caption, line(headings), rule + "|", *map(line, rows)]) + "\n"

    _repr_markdown_ = markdown  # what notebooks show

    def csv(self) -> str:
        """Return it as CSV with all digits; missing numbers are empty, a spread has a column of its own."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        headings: list[Cell] = [column.heading for column in self.columns]
        writer.writerow(self._with_spread(headings, [f"± {heading}" for heading in headings]))
        for row in self.rows:
            values, spreads = zip(*map(_raw, row), strict=True)
            writer.writerow(self._with_spread(values, spreads))
        return stream.getvalue()

    def _with_spread(self, values: Sequence[Cell], spreads: Sequence[Cell]) -> list[Cell]:
        """Return a row of raw values, each followed by its spread in the columns that have one."""
        every = zip(values, spreads, self.spread(), strict=True)
        return [cell for value, spread, two in every for cell in ((value, spread) if two else (value,))]

    def latex(self) -> str:
        r"""Return it as a ``tabular`` for the package booktabs, in a ``table`` if it has a title."""
        numeric, spread = self.numeric(), self.spread()
        alignment = "".join(
            r"r@{${}\pm{}$}l" if two else "r" if right else "l"
            for right, two in zip(numeric, spread, strict=True)
        )
        headings = [
            rf"\multicolumn{{2}}{{c}}{{{latex(column.heading)}}}" if two else latex(column.heading)
            for column, two in zip(self.columns, spread, strict=True)
        ]
        lines = [rf"\begin{{tabular}}{{{alignment}}}", r"\toprule", _latex_row(headings), r"\midrule"]
        for row in self.rows:
            columns = zip(self.columns, row, numeric, spread, strict=True)
            cells = [_latex_cell(column.parts(cell), *kind) for column, cell, *kind in columns]
            lines.append(_latex_row(cells))
        lines += [r"\bottomrule", r"\end{tabular}"]
        if self.title:
            caption = rf"\caption{{{latex(self.title)}}}"
            lines = [r"\begin{table}", r"\centering", caption, *lines, r"\end{table}"]
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


class Tabled(ABC):
    """A result that shows itself as its table and what is to be said of it."""

    @abstractmethod
    def table(self) -> Table:
        """Return its table."""

    def remarks(self) -> Iterable[str]:
        """Say what the table does not, a line each."""
        return ()

    def __str__(self) -> str:
        """Return the table, and what is to be said of it."""
        return "\n".join([str(self.table()), *self.remarks()])

    def _repr_markdown_(self) -> str:
        """Return what notebooks show: the same."""
        return "\n".join([self.table().markdown(), *(f"* {remark}" for remark in self.remarks())])


def _one_line(text: str) -> str:
    return " ".join(text.splitlines()).replace("|", "\\|")


def _aligned(parts: Sequence[tuple[str, str]]) -> list[str]:
    """Join values and their spreads with ±, so that all signs stand in one place."""
    if not any(spread for _, spread in parts):
        return [value for value, _ in parts]
    left, right = (max(map(len, side)) for side in zip(*parts, strict=True))
    return [
        f"{value:>{left}} ± {spread:<{right}}" if spread else f"{value:>{left}}{'':{right + 3}}"
        for value, spread in parts
    ]


def _raw(cell: Cell) -> tuple[Cell, Cell]:
    return (known(cell.value), known(cell.spread)) if isinstance(cell, PlusMinus) else (known(cell), None)


def _latex_cell(parts: tuple[str, str], numeric: bool, two: bool) -> str:
    value, spread = map(latex_number if numeric else latex, parts)
    if not two:
        return value
    return f"{value} & {spread}" if spread else rf"\multicolumn{{2}}{{c}}{{{value}}}"


def _latex_row(cells: Sequence[str]) -> str:
    row = " & ".join(cells)
    return ("{}" if row[:1] in ("[", "*") else "") + row + r" \\"  # \\ before it would take those as its own
