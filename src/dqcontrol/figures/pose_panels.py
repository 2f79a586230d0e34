"""The eight panels in which figures show the coefficients of a pose."""

from __future__ import annotations

from typing import Any

from dqcontrol.figures.style import DOUBLE, new_figure

_NAMES = ("$w$", "$i$", "$j$", "$k$")


def pose_panels() -> tuple[Any, list[Any]]:
    """Return a figure and its labelled axes: those of the primary part, then of the dual part."""
    figure = new_figure(DOUBLE, 6.2)
    grid = figure.subplots(4, 2, sharex=True)
    panels = [*grid[:, 0], *grid[:, 1]]
    for i, axes in enumerate(panels):
        axes.set_ylabel(_NAMES[i % 4] + (" [m]" if i > 3 else ""))
    grid[0, 0].set_title("primary part")
    grid[0, 1].set_title("dual part")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    return figure, panels
