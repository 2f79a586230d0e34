"""What a table holds and how it is written: texts, numbers, numbers with their spread, headings with units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")

MISSING = "–"
_AGREES = 0.1
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
        return format(cell, self.format) if isinstance(cell, float) else str(cell), ""


def known(cell: T) -> T | None:
    """Return the cell, or ``None`` for a number that is not finite."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _exponent(number: float, form: str) -> int:
    return int(format(number, form).partition("e")[2])
