"""Figures as files and as parts of pages: with vector text that looks alike everywhere."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqcontrol.errors import ExistsError, unknown_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("pdf", "png", "svg")
PAPER_DPI = 300  # of PNG files for papers
_LARGEST_SVG = 1_500_000  # bytes in a page; beyond that its picture in pixels is smaller
_SCREEN_DPI = 160
_SETTINGS: Any = {
    "svg.hashsalt": "dqcontrol",  # the same run gives the same bytes
    "svg.fonttype": "path",  # other machines may lack the font
    "pdf.fonttype": 42,  # TrueType: journals refuse type 3
}
_DATES = {"pdf": "CreationDate", "svg": "Date"}


def check_figure_files(names: Sequence[str], folder: Path, formats: Sequence[str]) -> None:
    """Raise if figures of these names must not be written.

    Raises
    ------
    UnknownNameError
        If a format does not exist.
    ExistsError
        If a file exists.
    """
    for kind in formats:
        if kind not in FORMATS:
            raise unknown_name("formats", kind, FORMATS)
    for path in (folder / f"{name}.{kind}" for name in names for kind in formats):
        if path.exists():
            raise ExistsError(f"{path}: exists already; choose another folder or remove it")


def save_figures(
    figures: Mapping[str, Figure],
    folder: str | Path,
    formats: Sequence[str] = ("png",),
    dpi: float = _SCREEN_DPI,
) -> list[Path]:
    """Write figures into a folder.

    Parameters
    ----------
    figures
        By file name without suffix.
    folder
        Made if missing; must not hold files of these names.
    formats
        Any of ``"png"``, ``"svg"``, ``"pdf"``.
    dpi
        Dots an inch of PNG files.

    Returns
    -------
    The files: all formats of the first figure, and so on.

    Raises
    ------
    ExistsError
        If a file exists; then none is written.
    UnknownNameError
        If a format does not exist.

    Examples
    --------
    >>> save_figures({"errors": errors(run.record)}, "out", ["pdf", "png"])  # doctest: +SKIP
    """
    folder = Path(folder)
    check_figure_files(list(figures), folder, formats)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, figure in figures.items():
        for kind in formats:
            written.append(folder / f"{name}.{kind}")
            written[-1].write_bytes(encoded(figure, kind, dpi))
    return written


def encoded(figure: Figure, kind: str, dpi: float = _SCREEN_DPI) -> bytes:
    """Return the content of a file of one of `FORMATS`."""
    import matplotlib

    stream, date = io.BytesIO(), _DATES.get(kind)
    with matplotlib.rc_context(_SETTINGS):
        figure.savefig(stream, format=kind, dpi=dpi, metadata={date: None} if date else None)
    return stream.getvalue()


def for_page(figure: Figure) -> tuple[str, bytes]:
    """Return media type and content of a figure in a page: as vectors if they are not too many."""
    svg = encoded(figure, "svg")
    return ("image/svg+xml", svg) if len(svg) <= _LARGEST_SVG else ("image/png", encoded(figure, "png"))
