"""Figures of parameter studies: a number against every parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.experiments.parameter_units import with_unit
from dqcontrol.figures.style import (
    COLOURS,
    DESIRED,
    DOUBLE,
    MARKERS,
    legend_above,
    legend_below,
    logarithmic,
    new_figure,
    panels_across,
    styled,
)
from dqcontrol.measures.metric_tables import number_column
from dqcontrol.measures.repeats import LABELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from dqcontrol.experiments.ranking import Ranking

_ACROSS = 3
_ANY = "points"  # where nothing has a colour
_MOST_LINES = 12  # in a panel, and values on an axis
_DECADE = 10.0  # from such a ratio of its ends on an axis is logarithmic


@styled
def sweep_figure(ranking: Ranking) -> Figure:
    """Plot the number that a study is ranked by against each parameter that varies, one point a combination.

    Laws, or else robots, plants or sets, have their colours; the best combination is ringed. Failed ones are left out.
    Where two parameters vary on a grid, the points against one are joined by a line for each value of the other.

    Parameters
    ----------
    ranking
        Of one or several studies.

    Raises
    ------
    ShapeError
        If no combination has a place.

    Examples
    --------
    >>> sweep_figure(rank(["results/sweep"], "position.rms")).savefig("sweep.pdf")  # doctest: +SKIP
    """
    if not ranking.placed:
        raise ShapeError(f"ranking: no combination has '{ranking.by}' in all runs")
    names = [name for name in ranking.varied if name not in LABELS] or ranking.varied or ["law"]
    kinds = _kinds(ranking, names)
    across = panels_across(min(len(names), _ACROSS))
    y, rows = ranking.column(ranking.by), -(-len(names) // across)
    figure = new_figure(DOUBLE, 0.5 + 2.4 * rows)
    grid = figure.subplots(rows, across, sharey=True, squeeze=False)
    joined = _lines(ranking, names, kinds)
    for axes, name in zip(grid.flat, names, strict=False):
        x = _placed(axes, ranking.column(name))
        groups = joined.get(name, kinds)
        for i, kind in enumerate(_ordered(groups, ranking.column(_other(names, name)) if joined else None)):
            mine, colour = np.flatnonzero(groups == kind), COLOURS[i % len(COLOURS)]
            mine = mine[np.argsort(x[mine], kind="stable")]
            look: dict[str, Any] = {"marker": MARKERS[i % len(MARKERS)], "color": colour, "mew": 0}
            look["ls"] = "-" if name in joined else ""
            axes.plot(x[mine], y[mine], ms=_size(len(y)), rasterized=name not in joined, **look)
            axes.plot([], [], ms=5, label=kind, **look)  # seen in the legend
        axes.plot(x[0], y[0], "o", ms=9, mfc="none", mec=DESIRED, label="best")
        axes.set_xlabel(with_unit(name.removeprefix("parameter.")))
        if (y > 0).all() and y.max() > _DECADE * y.min():
            logarithmic(axes)
        if name in joined:
            legend_above(axes, 3)
    for axes in grid[:, 0]:
        axes.set_ylabel(number_column(ranking.by).heading)
    for axes in grid.flat[len(names) :]:
        axes.remove()
    if not joined:
        legend_below(figure, grid[0, 0])
    return figure


def _lines(ranking: Ranking, names: list[str], kinds: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return, of each parameter, which line each point belongs to: one a kind and value of the other parameter.

    Empty unless two parameters vary, both have few values, and no line has two points at one place.
    """
    if len(names) != 2:
        return {}
    columns = {name: ranking.column(name) for name in names}
    if any(len(set(column.tolist())) > _MOST_LINES for column in columns.values()):
        return {}
    lines = {}
    for name, other in zip(names, reversed(names), strict=True):
        key = other.removeprefix("parameter.").rpartition(".")[2]
        unit = with_unit(other.removeprefix("parameter.")).partition(" [")[2].rstrip("]")
        values = [f"{each:.4g}" if isinstance(each, float) else str(each) for each in columns[other].tolist()]
        texts = [
            " · ".join([*([kind] if kind != _ANY else []), f"{key} {value} {unit}".strip()])
            for kind, value in zip(kinds.tolist(), values, strict=True)
        ]
        places = set(zip(texts, columns[name].tolist(), strict=True))
        if len(places) < len(texts) or len(set(texts)) > _MOST_LINES:
            return {}
        lines[name] = np.array(texts)
    return lines


def _other(names: list[str], name: str) -> str:
    return names[1 - names.index(name)]


def _ordered(groups: NDArray[Any], values: NDArray[Any] | None) -> list[str]:
    """Return the different groups as they come, or in the order of their values."""
    order = range(len(groups)) if values is None else np.argsort(values, kind="stable")
    return list(dict.fromkeys(groups[i] for i in order))


def _kinds(ranking: Ranking, shown: list[str]) -> NDArray[Any]:
    """Return what colours a point: the labels that differ and have no axis."""
    labels = [name for name in ranking.varied if name in LABELS and name not in shown]
    texts = [ranking.column(name).astype(str) for name in labels]
    if not texts:
        return np.full(ranking.placed, _ANY)
    return np.array([" · ".join(filter(None, parts)) for parts in zip(*texts, strict=True)])


def _placed(axes: Axes, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return places on the x axis; of texts, one each."""
    if values.dtype.kind in "if":
        known = values[np.isfinite(values)]
        if len(known) and known.min() > 0 and known.max() > _DECADE * known.min():
            axes.set_xscale("log")
        return values.astype(float)
    texts = sorted({str(value) for value in values})
    axes.set_xticks(range(len(texts)), texts)
    axes.set_xlim(-0.5, len(texts) - 0.5)
    return np.array([texts.index(str(value)) for value in values], dtype=float)


def _size(count: int) -> float:
    """Return the size of a dot, smaller where there are many."""
    return float(np.clip(50 / np.sqrt(count), 1.6, 4.0))
