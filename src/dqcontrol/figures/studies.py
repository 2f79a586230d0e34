"""Figures of studies: every repeat with mean and interval, numbers over parameters as curves and as surfaces.

And of searches: tuned laws, learnt motions, identified servos.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, unknown_name
from dqcontrol.experiments.parameter_units import with_unit
from dqcontrol.figures import style as styles
from dqcontrol.loop.record import Record
from dqcontrol.measures.metric_tables import NUMBER_COLUMNS, number_column
from dqcontrol.measures.repeats import LABELS, LEVEL, Mean, Repeats, Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from dqcontrol.experiments.ranking import Ranking
    from dqcontrol.logs.servos.joint_gates import JointTrace
    from dqcontrol.tuning import Learning, Tuning


_BESIDE = 12  # combinations in one panel
_APART = 10.0  # times: the smaller would be flat on one linear axis
_LETTERS = 80  # of all laws below the axis
_TICKS = 10  # so many places of a parameter are all labelled
_MEAN: dict[str, Any] = {"color": styles.DESIRED, "marker": "_", "ms": 9, "mew": 1.4, "lw": 1.2}


@styles.styled
def repeats_figure(rows: Sequence[Row], key: str = "error.integral", *, level: float = LEVEL) -> Figure:
    """Plot a number of every run as a point, with mean and confidence interval, by law and set.

    Points stand in the order of the rows, so that a drift over the repeats shows as a slope. Every robot and plant has
    a panel of its own, and every set where there are more than a dozen combinations. A panel whose numbers are more
    than ten times apart has a logarithmic axis. Runs that failed are left out.

    Parameters
    ----------
    rows
        Of a study; see ``dqcontrol.measures.repeats``.
    key
        Name of a number as in `Metrics.flat`.
    level
        Confidence of the intervals of the means.

    Raises
    ------
    ShapeError
        If there are no rows.
    UnknownNameError
        If the key does not exist.

    Examples
    --------
    >>> repeats_figure(study.rows, "position.rms").savefig("repeats.pdf")  # doctest: +SKIP
    """
    from matplotlib.lines import Line2D

    study, heading = Repeats(rows), number_column(key).heading
    law = {group: str(study.label(group, "law")) for group in study.groups}
    beside = ["set", *study.parameters] if len(study.groups) <= _BESIDE else study.parameters
    kind = {group: study.describe(group, beside) for group in study.groups}
    scene = {group: study.describe(group, {*LABELS} - {"law", *beside}) for group in study.groups}
    laws, kinds, scenes = (list(dict.fromkeys(of.values())) for of in (law, kind, scene))
    figure = styles.new_figure(styles.DOUBLE, 0.7 + 2.6 * len(scenes))
    panels = dict(zip(scenes, figure.subplots(len(scenes), 1, sharex=True, squeeze=False)[:, 0], strict=True))
    seen: dict[str, list[float]] = {name: [] for name in scenes}
    width = 0.8 / len(kinds)
    for group in study.groups:
        i = kinds.index(kind[group])
        centre = laws.index(law[group]) + (i - (len(kinds) - 1) / 2) * width
        values = study.values(group, key)
        places = centre + width * (np.linspace(-0.35, 0.2, len(values)) if len(values) > 1 else np.zeros(1))
        seen[scene[group]] += values
        panels[scene[group]].plot(places[: len(values)], values, **styles.mark_style(i))
        _draw_mean(panels[scene[group]], centre + 0.35 * width, study.mean(group, key), level)
    for name, axes in panels.items():
        axes.set_ylabel(heading)
        axes.set_xticks(range(len(laws)), laws)
        axes.set_xlim(-0.5, len(laws) - 0.5)
        axes.grid(False, axis="x")
        axes.set_title(name, loc="left")
        if seen[name] and max(seen[name]) > _APART * min(seen[name]) > 0:
            styles.logarithmic(axes)
            axes.set_ylim(bottom=max(axes.get_ylim()[0], 0.5 * min(seen[name])))
    if max(map(len, laws)) * len(laws) > _LETTERS:
        panels[scenes[-1]].set_xticks(range(len(laws)), laws, rotation=25, ha="right")
    marks = [Line2D([], [], label=name, **styles.mark_style(i)) for i, name in enumerate(kinds) if name]
    mean = Line2D([], [], label=f"mean, {100 * level:g} % interval", **_MEAN)
    styles.legend_below(figure, panels[scenes[0]], [*marks, mean])
    return figure


@styles.styled
def gain_figure(rows: Sequence[Row], over: str = "set") -> Figure:
    """Plot the mean integral of the error over sets or a parameter, with its interval, one curve a law.

    On them an error that is inversely proportional to the gain is a straight line of slope −1 [P16 Table 5.6].

    Parameters
    ----------
    rows
        Of a study; see ``dqcontrol.measures.repeats``.
    over
        Name of a label: ``"set"`` in the order of the rows, or a parameter as ``"parameter.gain"``. Runs without it are
        left out.

    Raises
    ------
    ShapeError
        If there are no rows, or none has the number.
    UnknownNameError
        If the label does not exist.

    Examples
    --------
    >>> gain_figure(study.rows, "parameter.gain").savefig("gains.pdf")  # doctest: +SKIP
    """
    study, key = Repeats(rows), "error.integral"
    if over not in study.names:
        raise unknown_name("over", over, study.names)
    others = {*study.names} - {over} - ({*study.parameters} if over == "set" else set())
    groups = [group for group in study.groups if study.label(group, over) != ""]
    places = list(dict.fromkeys(study.label(group, over) for group in groups))
    numeric = not any(isinstance(place, str) for place in places)
    curves: dict[str, list[tuple[float, float, float]]] = {}
    for group in groups:
        mean, place = study.mean(group, key), study.label(group, over)
        if mean is not None:
            x = float(place) if numeric else places.index(place)
            curve = curves.setdefault(study.describe(group, others), [])
            curve.append((x, mean.mean, _half_width(mean, LEVEL)))
    if not curves:
        raise ShapeError(f"rows: no run that did not fail has '{key}' and '{over}'")
    figure = styles.new_figure(styles.DOUBLE, 3.8)
    axes = figure.subplots()
    widths = styles.line_widths(len(curves))
    for i, ((label, points), thickness) in enumerate(zip(curves.items(), widths, strict=True)):
        x, y, half_width = np.array(sorted(points)).T
        axes.errorbar(
            x, y, half_width, label=label, lw=thickness, **styles.mark_style(i) | styles.line_style(i)
        )
    if all(y > 0 for points in curves.values() for _, y, _ in points):
        styles.logarithmic(axes)
    _mark_places(axes, places, numeric)
    axes.set(xlabel=with_unit(over.removeprefix("parameter.")), ylabel=number_column(key).heading)
    if any(curves):
        styles.legend_below(figure, axes)
    return figure


def _mark_places(axes: Axes, places: Sequence[Any], numeric: bool) -> None:
    """Label the places on the x axis: each of them, or the decades if they are too many."""
    if not numeric:
        axes.set_xticks(range(len(places)), places)
        return
    if min(places) > 0:
        axes.set_xscale("log")
    if len(places) <= _TICKS:
        axes.xaxis.minorticks_off()
        axes.set_xticks(places, [f"{place:g}" for place in places])


def _draw_mean(axes: Axes, place: float, mean: Mean | None, level: float) -> None:
    if mean is not None:
        axes.errorbar(place, mean.mean, _half_width(mean, level), **_MEAN, zorder=3)


def _half_width(mean: Mean, level: float) -> float:
    return mean.half_width(level) if mean.count > 1 else 0.0


_ACROSS = 3
_ANY = "points"  # where nothing has a colour
_MOST_LINES = 12  # in a panel, and values on an axis
_DECADE = 10.0  # from such a ratio of its ends on an axis is logarithmic


@styles.styled
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
    y = ranking.column(ranking.by)
    figure, grid = styles.panel_grid(len(names), min(len(names), _ACROSS), 2.4, 0.5, sharey=True)
    joined = _lines(ranking, names, kinds)
    for axes, name in zip(grid.flat, names, strict=False):
        x = _placed(axes, ranking.column(name))
        groups = joined.get(name, kinds)
        for i, kind in enumerate(_ordered(groups, ranking.column(_other(names, name)) if joined else None)):
            mine, colour = np.flatnonzero(groups == kind), styles.COLOURS[i % len(styles.COLOURS)]
            mine = mine[np.argsort(x[mine], kind="stable")]
            look: dict[str, Any] = {
                "marker": styles.MARKERS[i % len(styles.MARKERS)],
                "color": colour,
                "mew": 0,
            }
            look["ls"] = "-" if name in joined else ""
            axes.plot(x[mine], y[mine], ms=_size(len(y)), rasterized=name not in joined, **look)
            axes.plot([], [], ms=5, label=kind, **look)  # seen in the legend
        axes.plot(x[0], y[0], "o", ms=9, mfc="none", mec=styles.DESIRED, label="best")
        axes.set_xlabel(with_unit(name.removeprefix("parameter.")))
        if (y > 0).all() and y.max() > _DECADE * y.min():
            styles.logarithmic(axes)
        if name in joined:
            styles.legend_above(axes, 3)
    for axes in grid[:, 0]:
        axes.set_ylabel(number_column(ranking.by).heading)
    for axes in grid.flat[len(names) :]:
        axes.remove()
    if not joined:
        styles.legend_below(figure, grid[0, 0])
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


@styles.styled
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
    by_decades = [_is_geometric(values) for values in grid]
    places = [np.log10(v) if log else v for v, log in zip(grid, by_decades, strict=True)]
    across = styles.panels_across(min(len(heights), 3))
    rows = -(-len(heights) // across)
    figure = styles.new_figure(styles.DOUBLE, 0.3 + 2.6 * rows)
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
        for name, label, at, log in zip("xy", labels, places, by_decades, strict=True):
            _mark_axis(axes, name, label, at, log)
        axes.zaxis.set_major_locator(MaxNLocator(5))
        axes.zaxis.set_pane_color(styles.PANE)
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


def _mark_axis(axes: Any, name: str, label: str, places: Array, by_decades: bool) -> None:
    """Label an axis; a logarithmic one, which matplotlib cannot draw in space, by its decades."""
    from matplotlib.ticker import MaxNLocator

    getattr(axes, f"set_{name}label")(label, labelpad=0)
    getattr(axes, f"{name}axis").set_pane_color(styles.PANE)
    if not by_decades:
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


@styles.styled
def search_figure(tuning: Tuning) -> Figure:
    """Plot the best total so far of each law against the evaluations, and its total on what was not seen.

    Examples
    --------
    >>> search_figure(tuning).savefig("search.pdf")  # doctest: +SKIP
    """
    figure = styles.new_figure(styles.DOUBLE, 2.8)
    axes = figure.subplots()
    widths = styles.line_widths(len(tuning.laws))
    for i, each in enumerate(tuning.laws):
        rows = each.result.rows[: each.result.evaluations]
        totals = [math.inf if row["total"] is None or row["violation"] else row["total"] for row in rows]
        best = np.minimum.accumulate(totals)
        seen = np.isfinite(best)
        count = np.arange(1, len(best) + 1)
        axes.step(
            count[seen], best[seen], where="post", lw=widths[i], label=each.label, **styles.line_style(i)
        )
        if math.isfinite(each.result.held_out_total):
            axes.plot(len(best) + 1, each.result.held_out_total, **_mark(i), mfc="none")
    axes.plot([], [], "o", color="0.4", mfc="none", label="held out")
    axes.set(xlabel="evaluations", ylabel="weighted objectives")
    low, high = axes.dataLim.ymin, axes.dataLim.ymax
    if low > 0 and high > _DECADE * low:
        styles.logarithmic(axes)
    styles.legend_below(figure, axes)
    return figure


@styles.styled
def front_figure(tuning: Tuning) -> Figure:
    """Plot the best compromises of two objectives, one line a law.

    Raises
    ------
    ShapeError
        If none were searched for.

    Examples
    --------
    >>> front_figure(tuning).savefig("front.pdf")  # doctest: +SKIP
    """
    front = tuning.problem.block.front
    if front is None:
        raise ShapeError("tuning: has no fronts; give tune.front")
    figure = styles.new_figure(styles.DOUBLE, 3.2)
    axes = figure.subplots()
    for i, each in enumerate(tuning.laws):
        if each.result.front:
            _, first, second = zip(*each.result.front, strict=True)
            axes.plot(first, second, ms=3, lw=0.8, label=each.label, **_mark(i))
    for low, high, scale in (
        (*axes.dataLim.intervalx, axes.set_xscale),
        (*axes.dataLim.intervaly, axes.set_yscale),
    ):
        if low > 0 and high > _DECADE * low:
            scale("log")
    first, second = front.objectives
    axes.set(xlabel=NUMBER_COLUMNS[first].heading, ylabel=NUMBER_COLUMNS[second].heading)
    styles.legend_below(figure, axes)
    return figure


def _mark(index: int) -> dict[str, Any]:
    return {
        "marker": styles.MARKERS[index % len(styles.MARKERS)],
        "color": styles.COLOURS[index % len(styles.COLOURS)],
    }


@styles.styled
def repeats_of_learning(learning: Learning) -> Figure:
    """Plot the position's error against the repeats, beside it over time, before and after; a wanted force's instead.

    Examples
    --------
    >>> repeats_of_learning(learning).savefig("learning.pdf")  # doctest: +SKIP
    """
    figure = styles.new_figure(styles.DOUBLE, 2.8)
    left, right = figure.subplots(1, 2)
    repeats, forces = learning.repeats, learning.forces
    numbers = [each.number for each in repeats]
    errors = [each.position if each.force is None else each.force for each in repeats]
    seen = [each.seen if each.force is None else each.learnable for each in repeats]
    measured = "as measured" if forces is None else "as measured, in the band"
    left.plot(numbers, errors, "o-", color=styles.COLOURS[0], label="true, RMS")
    left.plot(numbers, seen, "s--", color=styles.COLOURS[1], label=measured)
    left.plot(numbers, [each.noise for each in repeats], ":", color=styles.NEUTRAL, label="noise in the band")
    left.plot(learning.best, errors[learning.best], "o", ms=9, mfc="none", mec=styles.NEUTRAL, label="kept")
    styles.logarithmic(left)
    left.set(xlabel="repeat", ylabel="position error [mm]" if forces is None else "force error [N]")
    styles.legend_above(left, 2)
    left.xaxis.get_major_locator().set_params(integer=True)
    of_first = {"color": styles.COLOURS[1], "label": "first"}
    of_best = {"color": styles.COLOURS[0], "label": f"repeat {learning.best}"}
    if forces is None:
        start = learning.first.desired_position
        before, after = _over_time(learning.first, start), _over_time(learning.last, start)
        right.plot(*before, **of_first)
        right.plot(*after, **of_best)
        styles.logarithmic(right)
        right.set_ylim(bottom=0.1 * min(np.median(before[1]), np.median(after[1])))  # at the start both are 0
    else:
        for record, style in ((learning.first, of_first), (learning.last, of_best)):
            lines = right.plot(record.time, forces.errors(record), lw=0.9, **style)
            for line in lines[1:]:
                line.set_label("_")
        right.set_ylabel("force − wanted force [N]")
    right.set_xlabel("time [s]")
    styles.legend_above(right, 2)
    return figure


def _over_time(record: Record, desired: Array) -> tuple[Array, Array]:
    """Return times and errors against the motion that was asked for, mm."""
    count = min(len(record), len(desired))
    errors = 1e3 * np.linalg.norm(record.position[:count] - desired[:count], axis=1)
    return record.time[:count], np.maximum(errors, 1e-6)


_WINDOW = 2.5  # s that are shown closely
_MOST_POINTS = 4000  # points of a curve of residuals


@styles.styled
def servo_fits(joints: Mapping[str, tuple[JointTrace, float]]) -> Figure:
    """Plot for each joint fit and residual: left where it is liveliest, right all along beside the floor.

    Parameters
    ----------
    joints
        By name: what was identified of it, and what noise and encoder alone would leave, rad or m.

    Examples
    --------
    >>> servo_fits({joint.name: (joint.trace, joint.floor) for joint in found.fitted})  # doctest: +SKIP
    """
    figure = styles.new_figure(styles.DOUBLE, 0.6 + 1.25 * len(joints))
    grid = figure.subplots(len(joints), 2, squeeze=False)
    for (name, (trace, floor)), (close, all_along) in zip(joints.items(), grid, strict=True):
        shown = _liveliest(trace)
        time = trace.time[shown]
        close.plot(time, trace.target[shown], color=styles.DESIRED, lw=0.8, label="commanded")
        close.plot(time, trace.position[shown], color=styles.COLOURS[0], lw=1.4, label="measured")
        close.plot(time, trace.fitted[shown], color=styles.COLOURS[1], lw=0.8, ls="--", label="fitted")
        close.set_title(name, loc="left")
        thin = slice(None, None, max(1, len(trace.time) // _MOST_POINTS))
        left = 1e3 * (trace.position - trace.fitted)
        late = np.isfinite(trace.foreseen)
        ahead = np.where(late, 1e3 * (trace.position - trace.foreseen), np.nan)
        all_along.plot(trace.time[thin], left[thin], color=styles.COLOURS[0], lw=0.4, label="left by the fit")
        all_along.plot(
            trace.time[thin], ahead[thin], color=styles.COLOURS[1], lw=0.4, label="left where not fitted"
        )
        for side in (-2e3, 2e3):
            all_along.axhline(side * floor, color=styles.DESIRED, lw=0.8, ls="--")
        all_along.set_ylabel("left [mrad]")
        close.set_ylabel("[rad]")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    styles.legend_below(figure, grid[0][0], grid[0][1].get_legend_handles_labels()[0])
    return figure


def _liveliest(trace: JointTrace) -> slice:
    """Return the samples of the part of a log in which a joint's target moved most."""
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(trace.target)))])
    last = np.searchsorted(trace.time, trace.time + _WINDOW, side="right") - 1
    first = int(np.argmax(path[last] - path))
    return slice(first, int(last[first]) + 1)
