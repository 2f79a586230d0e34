"""Figures of repeated runs: every repeat as a point with mean and interval, and means over gains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.experiments.parameter_units import with_unit
from dqcontrol.figures.style import (
    DESIRED,
    DOUBLE,
    legend_below,
    line_style,
    line_widths,
    logarithmic,
    mark_style,
    new_figure,
    styled,
)
from dqcontrol.measures.metric_tables import number_column
from dqcontrol.measures.repeats import LABELS, Repeats, Row
from dqcontrol.measures.statistics import LEVEL, Mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BESIDE = 12  # combinations in one panel
_APART = 10.0
_LETTERS = 80  # of all laws below the axis
_TICKS = 10  # so many places of a parameter are all labelled
_MEAN: dict[str, Any] = {"color": DESIRED, "marker": "_", "ms": 9, "mew": 1.4, "lw": 1.2}


@styled
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
    figure = new_figure(DOUBLE, 0.7 + 2.6 * len(scenes))
    panels = dict(zip(scenes, figure.subplots(len(scenes), 1, sharex=True, squeeze=False)[:, 0], strict=True))
    seen: dict[str, list[float]] = {name: [] for name in scenes}
    width = 0.8 / len(kinds)
    for group in study.groups:
        i = kinds.index(kind[group])
        centre = laws.index(law[group]) + (i - (len(kinds) - 1) / 2) * width
        values = study.values(group, key)
        places = centre + width * (np.linspace(-0.35, 0.2, len(values)) if len(values) > 1 else np.zeros(1))
        seen[scene[group]] += values
        panels[scene[group]].plot(places[: len(values)], values, **mark_style(i))
        _draw_mean(panels[scene[group]], centre + 0.35 * width, study.mean(group, key), level)
    for name, axes in panels.items():
        axes.set_ylabel(heading)
        axes.set_xticks(range(len(laws)), laws)
        axes.set_xlim(-0.5, len(laws) - 0.5)
        axes.grid(False, axis="x")
        axes.set_title(name, loc="left")
        if seen[name] and max(seen[name]) > _APART * min(seen[name]) > 0:
            logarithmic(axes)
            axes.set_ylim(bottom=max(axes.get_ylim()[0], 0.5 * min(seen[name])))
    if max(map(len, laws)) * len(laws) > _LETTERS:
        panels[scenes[-1]].set_xticks(range(len(laws)), laws, rotation=25, ha="right")
    marks = [Line2D([], [], label=name, **mark_style(i)) for i, name in enumerate(kinds) if name]
    mean = Line2D([], [], label=f"mean, {100 * level:g} % interval", **_MEAN)
    legend_below(figure, panels[scenes[0]], [*marks, mean])
    return figure


@styled
def gain_figure(
    rows: Sequence[Row], over: str = "set", key: str = "error.integral", *, level: float = LEVEL
) -> Figure:
    """Plot the mean of a number over sets or a parameter, with its interval, one curve a law, on logarithmic axes.

    On them an error that is inversely proportional to the gain is a straight line of slope −1 [P16 Table 5.6].

    Parameters
    ----------
    rows
        Of a study; see ``dqcontrol.measures.repeats``.
    over
        Name of a label: ``"set"`` in the order of the rows, or a parameter as ``"parameter.gain"``. Runs without it are
        left out.
    key, level
        As for `repeats_figure`.

    Raises
    ------
    ShapeError
        If there are no rows, or none has the number.
    UnknownNameError
        If the key or the label does not exist.

    Examples
    --------
    >>> gain_figure(study.rows, "parameter.gain").savefig("gains.pdf")  # doctest: +SKIP
    """
    study, heading = Repeats(rows), number_column(key).heading
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
            curve.append((x, mean.mean, _half_width(mean, level)))
    if not curves:
        raise ShapeError(f"rows: no run that did not fail has '{key}' and '{over}'")
    figure = new_figure(DOUBLE, 3.8)
    axes = figure.subplots()
    widths = line_widths(len(curves))
    for i, ((label, points), thickness) in enumerate(zip(curves.items(), widths, strict=True)):
        x, y, half_width = np.array(sorted(points)).T
        axes.errorbar(x, y, half_width, label=label, lw=thickness, **mark_style(i) | line_style(i))
    if all(y > 0 for points in curves.values() for _, y, _ in points):
        logarithmic(axes)
    _mark_places(axes, places, numeric)
    axes.set_xlabel(with_unit(over.removeprefix("parameter.")))
    axes.set_ylabel(heading)
    if any(curves):
        legend_below(figure, axes)
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
