"""The look that all figures share."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, unknown_name

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")
T = TypeVar("T")

WIDTHS = {"single": 3.5, "double": 7.16}  # in; one and both columns of a journal's page
DOUBLE = WIDTHS["double"]
# Okabe and Ito's colours, told apart by every kind of colour vision, with Tol's wine for their pale yellow; then Tol's
# indigo and a brown, so that the nine labels of the largest published table have one each.
COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#882255",
    "#332288",
    "#5C3A21",
)
DESIRED, LIMIT, NEUTRAL = "#222222", "#B2182B", "#555555"
PANE = (0.97, 0.97, 0.97, 1.0)  # the walls of figures in space
FLOOR = 1e-8  # of errors on a logarithmic axis, m and rad: of 10 nm nothing is seen but the rounding
LINES = ("-", "--", "-.", ":")
ERROR = r"$|1 - x^{*} x_d|$"  # label of the norm of an error, which has no unit
# A tenth of the values may be spikes; ten times as high they hide the others on a linear axis.
_USUAL, _SPIKE = 0.9, 10.0
_TRANSIENT = 20.0  # a twentieth of a panel is two millimetres on paper
_LETTERS = {"phi": "φ", "omega": "ω"}
_GREEK = re.compile(r"(?<![A-Za-z])(phi|omega)(?![A-Za-z])")
MARKERS = ("o", "s", "^", "D", "v")

_POWER = re.compile(r"\$\\mathdefault\{(-?(?:\d+\\times)?10)\^\{(-?\d+)\}\}\$")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_width = ContextVar("width", default=DOUBLE)

TICKS: Any = {"color": "#666666", "labelcolor": "#444444", "grid_color": "#e4e4e4", "grid_linewidth": 0.7}
_STYLE: Any = {
    "axes.labelsize": "medium",
    "axes.titlesize": "medium",
    "xtick.labelsize": "medium",
    "ytick.labelsize": "medium",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": TICKS["color"],
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.use_mathtext": True,
    "axes.grid": True,
    "grid.color": TICKS["grid_color"],
    "grid.linewidth": TICKS["grid_linewidth"],
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": "medium",
    "figure.facecolor": "white",
}


@contextmanager
def column_width(name: str) -> Iterator[None]:
    """Draw figures for one column of a journal's page or, as they are without it, for both.

    Parameters
    ----------
    name
        ``"single"`` (3.5 in) or ``"double"`` (7.16 in).

    Raises
    ------
    UnknownNameError
        If there is no such width.

    Examples
    --------
    >>> with column_width("single"):  # doctest: +SKIP
    ...     errors(run.record).savefig("errors.pdf")
    """
    if name not in WIDTHS:
        raise unknown_name("width", name, WIDTHS)
    token = _width.set(WIDTHS[name])
    try:
        yield
    finally:
        _width.reset(token)


def styled(function: Callable[P, Figure]) -> Callable[P, Figure]:
    """Make a figure in the common style, whatever the user's settings are."""

    @wraps(function)
    def wrapper(*arguments: P.args, **options: P.kwargs) -> Figure:
        import matplotlib

        style = _STYLE | {"font.size": 9 if _width.get() == DOUBLE else 8}
        settings = {**matplotlib.rcParamsDefault, **style}
        del settings["backend"]  # setting it loads pyplot, and a library of windows
        with matplotlib.rc_context(settings):
            figure = function(*arguments, **options)
            _simplify_ticks(figure)
        for axes in figure.axes:  # ticks come into being later, outside the context
            axes.tick_params(which="both", labelsize=style["font.size"] - 1, **TICKS)
        return figure

    return wrapper


def _simplify_ticks(figure: Figure) -> None:
    """Let numbers at axes be plain text: as formulas, which look the same, they take most of the drawing time."""
    from matplotlib.ticker import LogFormatterSciNotation, ScalarFormatter

    class Plain(ScalarFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")

    class PlainPower(LogFormatterSciNotation):
        def __call__(self, x: float, pos: int | None = None) -> str:
            found = _POWER.fullmatch(text := super().__call__(x, pos))
            return f"{found[1].replace('-', '−')}{found[2].translate(_RAISED)}" if found else text

    for axes in figure.axes:
        for axis in axes._axis_map.values():
            formatter = axis.get_major_formatter()
            if type(formatter) is ScalarFormatter:
                axis.set_major_formatter(Plain())
            elif type(formatter) is LogFormatterSciNotation:
                formatter.__class__ = PlainPower


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size, in, but no wider than its column, outside pyplot's global state."""
    from dqcontrol.figures.panels import PanelFigure

    return PanelFigure(figsize=(min(width, _width.get()), height), dpi=160)


def panels_across(most: int) -> int:
    """Return how many of so many panels stand side by side in the column that figures are drawn for."""
    return max(1, round(most * _width.get() / DOUBLE - 0.3))


def time_panels(count: int, height: float) -> tuple[Figure, Any]:
    """Return a figure of this height, in, and its panels over one axis of time, one below the other."""
    figure = new_figure(DOUBLE, height)
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    panels[-1].set_xlabel("time [s]")
    return figure, panels


def panel_grid(count: int, most: int, each: float, beside: float, **shared: Any) -> tuple[Figure, Any]:
    """Return a figure of at least so many panels, shape (rows, columns), with ``most`` of them in a row across a page.

    A row is ``each`` in high, and what is ``beside`` the rows so much in all.
    """
    across = panels_across(most)
    rows = -(-count // across)
    figure = new_figure(DOUBLE, beside + each * rows)
    return figure, figure.subplots(rows, across, squeeze=False, **shared)


def frame_space(
    axes: Any, middle: Array, extents: Array, ticks: Sequence[int], labelpad: float | None = None
) -> None:
    """Give axes in space their ends, labels, at most so many ticks each, and walls."""
    from matplotlib.ticker import MaxNLocator

    for name, centre, extent, most in zip("xyz", middle, extents, ticks, strict=True):
        getattr(axes, f"set_{name}lim")(centre - extent / 2, centre + extent / 2)
        getattr(axes, f"set_{name}label")(f"{name} [m]", labelpad=labelpad)
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(MaxNLocator(most))
        axis.set_pane_color(PANE)


def first_of(records: Mapping[str, T]) -> T:
    """Return the first of some runs by label, or raise `ShapeError` if there are none."""
    if not records:
        raise ShapeError("records: expected at least one run, got none")
    return next(iter(records.values()))


def line_style(index: int) -> dict[str, Any]:
    """Return colour and dashes of the n-th curve; 36 differ, and neighbours in both, for prints without colours."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": LINES[index % len(LINES)]}


def line_widths(count: int) -> Sequence[float]:
    """Return widths for curves that may coincide: each is thinner than those it is drawn over."""
    return [2.0 - i / max(count - 1, 1) for i in range(count)]


def mark_style(index: int) -> dict[str, Any]:
    """Return colour and form of the n-th kind of points; 45 differ, and neighbours in both."""
    colour = COLOURS[index % len(COLOURS)]
    return {
        "linestyle": "",
        "marker": MARKERS[index % len(MARKERS)],
        "ms": 4,
        "mec": colour,
        "mfc": "white",
        "mew": 1.0,
    }


def legend_below(figure: Figure, axes: Axes, extra: Sequence[Artist] = ()) -> None:
    """Put the legend of the axes, and of more artists, under the figure, never over data nor beyond the paper."""
    handles = [*axes.get_legend_handles_labels()[0], *extra]
    longest = max(len(str(handle.get_label())) for handle in handles)
    most = max(int(figure.get_figwidth() / (0.6 + 0.075 * longest)), 1)  # in: line and gap, a letter
    rows = -(-len(handles) // most)
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=-(-len(handles) // rows),  # none much shorter than the others
        handlelength=2.8,
    )


def legend_above(axes: Axes, columns: int) -> None:
    """Put the legend of one panel of several above it, never over its curves."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=columns)


def plain_names(names: Iterable[str]) -> list[str]:
    """Return names of coordinates and inputs as they are read: Greek letters for φ and ω, also at the end of a name."""
    return [_GREEK.sub(lambda found: _LETTERS[found[0]], name) for name in names]


def has_transient(values: Array) -> bool:
    """Tell whether a beginning hides what errors (N,) are later: on a linear axis these would lie on the line of 0."""
    sizes = np.abs(values[np.isfinite(values)])
    late = sizes[len(sizes) // 2 :]
    return len(late) > 0 and bool(sizes.max() > _TRANSIENT * max(float(np.quantile(late, _USUAL)), 0.0) > 0)


def beyond_spikes(axes: Axes, values: Array) -> None:
    """Compress the y axis beyond what most values that are not 0 reach, if the largest would flatten all others."""
    sizes = np.abs(values[np.isfinite(values) & (values != 0.0)])
    usual = float(np.quantile(sizes, _USUAL)) if len(sizes) else 0.0
    if usual > 0 and sizes.max() > _SPIKE * usual:
        axes.set_yscale("symlog", linthresh=usual)


def at_least(axes: Axes, span: float) -> None:
    """Widen an axis that shows little more than round-off."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = (low + high) / 2
        axes.set_ylim(middle - span / 2, middle + span / 2)


def logarithmic(axes: Axes, decades: float = math.inf, floor: float = 0.0) -> None:
    """Make the y axis of drawn curves logarithmic, with labels that do not crowd.

    Parameters
    ----------
    axes
        With all its curves.
    decades
        What lies farther below the highest value is cut off.
    floor
        So is what lies below that, if anything lies ten times above it.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    low = max(low, high * 10.0**-decades, min(floor, 0.1 * high))
    axes.set_ylim(bottom=low)
    if high < 10 * low:
        fine = high > 2.5 * low
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if fine else (1, 1.2, 1.5, 2, 3, 4, 5, 6, 8)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    axes.yaxis.set_minor_formatter(NullFormatter())
