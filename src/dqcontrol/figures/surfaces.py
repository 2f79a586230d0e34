"""Metrics over a grid of two parameters, as surfaces in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, unknown_name
from dqcontrol.experiments.parameter_units import with_unit
from dqcontrol.figures.style import DOUBLE, PANE, new_figure, panels_across, styled
from dqcontrol.measures.metric_tables import number_column
from dqcontrol.measures.repeats import Repeats, Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def surface(
    x: ArrayLike, y: ArrayLike, heights: Mapping[str, ArrayLike], labels: tuple[str, str] = ("$q$", "$r$")
) -> Figure:
    """Plot numbers over a grid of two parameters, as one surface each, side by side [P16 Figures 7–8].

    An axis is logarithmic where its grid is geometric rather than even.

    Parameters
    ----------
    x, y
        Grid, shapes (m,) and (n,), increasing.
    heights
        By title with unit, each of shape (m, n): ``heights[title][i, k]`` belongs to ``x[i]`` and ``y[k]``; NaN leaves
        a hole.
    labels
        Of x and y.

    Raises
    ------
    ShapeError, ValueRangeError
        If there are no heights, they do not fit the grid, or the grid is not increasing.

    Examples
    --------
    >>> surface([1, 10, 70], [0.05, 1, 100], {"error integral [s]": errors})  # doctest: +SKIP
    """
    from matplotlib.ticker import MaxNLocator

    grid = [_increasing(name, values) for name, values in (("x", x), ("y", y))]
    shape = tuple(map(len, grid))
    if not heights:
        raise ShapeError("heights: expected at least one surface, got none")
    logarithmic = [_is_geometric(values) for values in grid]
    places = [np.log10(v) if log else v for v, log in zip(grid, logarithmic, strict=True)]
    across = panels_across(min(len(heights), 3))
    rows = -(-len(heights) // across)
    figure = new_figure(DOUBLE, 0.3 + 2.6 * rows)
    for i, (title, values) in enumerate(heights.items()):
        height = np.asarray(values, dtype=float)
        if height.shape != shape:
            raise ShapeError(f"heights of {title}: expected shape {shape} as the grid, got {height.shape}")
        axes: Any = figure.add_subplot(rows, across, i + 1, projection="3d")
        axes.plot_surface(
            *np.meshgrid(*places, indexing="ij"),
            height,
            cmap="cividis",
            edgecolor="#333333",
            lw=0.3,
            rstride=1,
            cstride=1,
        )
        for name, label, at, log in zip("xy", labels, places, logarithmic, strict=True):
            _mark_axis(axes, name, label, at, log)
        axes.zaxis.set_major_locator(MaxNLocator(5))
        axes.zaxis.set_pane_color(PANE)
        axes.set_title(title, y=0.94)
        axes.view_init(elev=24, azim=-130)
        axes.set_box_aspect((1, 1, 0.8), zoom=0.85)
        axes.tick_params(pad=-1)
        axes.tick_params(axis="z", pad=4)
    return figure


def surface_figure(
    rows: Sequence[Row],
    x: str,
    y: str,
    keys: Sequence[str] = ("joint_step.integral", "hand_speed.integral", "error.integral"),
) -> Figure:
    """Plot means over a grid of two parameters of one law, as `surface` does for arrays.

    Parameters
    ----------
    rows
        Of a study; see ``dqcontrol.measures.repeats``. Runs without both parameters are left out.
    x, y
        Names of parameters in the rows, as ``"parameter.error_weight"``.
    keys
        Names of numbers as in `Metrics.flat`.

    Raises
    ------
    UnknownNameError
        If a key or parameter does not exist.
    ShapeError
        If there are no rows, or several laws, robots or plants.

    Examples
    --------
    >>> surface_figure(study.rows, "parameter.error_weight", "parameter.control_weight")  # doctest: +SKIP
    """
    columns = [number_column(key) for key in keys]
    study = Repeats(rows)
    for name in (x, y):
        if name not in study.parameters:
            raise unknown_name("parameter", name, study.parameters)
    places = {group: (study.label(group, x), study.label(group, y)) for group in study.groups}
    groups = {place: group for group, place in places.items() if "" not in place}
    if len(groups) != sum("" not in place for place in places.values()):
        raise ShapeError(
            "rows: choose those of one law, robot and plant, with no other parameter that differs"
        )
    grid = [sorted({float(place[i]) for place in groups}) for i in range(2)]
    heights = {column.heading: np.full((len(grid[0]), len(grid[1])), np.nan) for column in columns}
    for place, group in groups.items():
        at = tuple(values.index(float(value)) for values, value in zip(grid, place, strict=True))
        for key, column in zip(keys, columns, strict=True):
            mean = study.mean(group, key)
            heights[column.heading][at] = mean.mean if mean else np.nan
    labels = (with_unit(x.removeprefix("parameter.")), with_unit(y.removeprefix("parameter.")))
    return surface(grid[0], grid[1], heights, labels)


def _mark_axis(axes: Any, name: str, label: str, places: Array, logarithmic: bool) -> None:
    """Label an axis; a logarithmic one, which matplotlib cannot draw in space, by its decades."""
    from matplotlib.ticker import MaxNLocator

    getattr(axes, f"set_{name}label")(label, labelpad=0)
    getattr(axes, f"{name}axis").set_pane_color(PANE)
    if not logarithmic:
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(5))
        return
    decades = [d for d in range(-30, 31) if places[0] - 1e-9 <= d <= places[-1] + 1e-9]
    getattr(axes, f"set_{name}ticks")(decades, [f"$10^{{{d}}}$" for d in decades])


def _is_geometric(values: Array) -> bool:
    """Tell whether the steps between values are more even as ratios than as differences."""
    if len(values) < 3 or values[0] <= 0:
        return False
    steps, ratios = np.diff(values), np.diff(np.log(values))
    return float(ratios.std() / ratios.mean()) < float(steps.std() / steps.mean())


def _increasing(field: str, values: ArrayLike) -> Array:
    array = as_array(field, values, (None,))
    if len(array) < 2 or not (np.diff(array) > 0).all():
        raise ValueRangeError(
            f"{field}: expected at least two increasing numbers, got {np.array2string(array, threshold=8)}"
        )
    return array
