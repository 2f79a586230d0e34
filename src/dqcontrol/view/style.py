"""The look that all figures share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")

# Okabe and Ito's colours, told apart by every kind of colour vision; their yellow is too pale for lines.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C564B")
DESIRED, LIMIT, NEUTRAL = "#222222", "#B2182B", "#555555"
PANE = (0.97, 0.97, 0.97, 1.0)  # the walls of figures in space
FLOOR = 1e-17  # shown in place of an error of exactly 0 on a logarithmic axis
LINES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "^", "D", "v")

_STYLE: Any = {
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#666666",
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.use_mathtext": True,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.facecolor": "white",
}


def styled(function: Callable[P, Figure]) -> Callable[P, Figure]:
    """Make a figure in the common style, whatever the user's settings are."""

    @wraps(function)
    def wrapper(*arguments: P.args, **options: P.kwargs) -> Figure:
        import matplotlib

        with matplotlib.rc_context(matplotlib.rcParamsDefault), matplotlib.rc_context(_STYLE):
            figure = function(*arguments, **options)
        for axes in figure.axes:  # ticks come into being later, outside the context
            axes.tick_params(which="both", labelsize=8, color="#666666", labelcolor="#444444")
            axes.tick_params(grid_color="#e4e4e4", grid_linewidth=0.7)
        return figure

    return wrapper


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches, outside pyplot's global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=160, layout="constrained")


def line_style(index: int) -> dict[str, Any]:
    """Return colour and dashes of the n-th curve; 28 differ, and neighbours in both, for prints without colours."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": LINES[index % len(LINES)]}


def line_widths(count: int) -> Sequence[float]:
    """Return widths for curves that may coincide: each is thinner than those it is drawn over."""
    return [2.0 - i / max(count - 1, 1) for i in range(count)]


def mark_style(index: int) -> dict[str, Any]:
    """Return colour and form of the n-th kind of points; 35 differ, and neighbours in both."""
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
    columns = int(figure.get_figwidth() / (0.6 + 0.075 * longest))  # in: line and gap, a letter
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=min(max(columns, 1), len(handles)),
        handlelength=2.8,
    )


def at_least(axes: Axes, span: float) -> None:
    """Widen an axis that shows little more than round-off."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = (low + high) / 2
        axes.set_ylim(middle - span / 2, middle + span / 2)
