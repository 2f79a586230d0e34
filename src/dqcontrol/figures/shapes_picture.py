"""A drawing of a robot's collision shapes around the lines from joint to joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.figures.base_paths import silhouette
from dqcontrol.figures.style import COLOURS, NEUTRAL, PANE, new_figure, styled
from dqcontrol.figures.surroundings import faces_of
from dqcontrol.robots.link_shapes import LinkShape, LinkShapes
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_VIEWS = ((18.0, -60.0), (18.0, 30.0))  # elevation and azimuth, degrees
_OPACITY = 0.5
_THINNEST = 0.4  # of the longest side: less would leave no room for the numbers


@styled
def shapes_picture(robot: Robot, shapes: Sequence[LinkShape], q: Array) -> Figure:
    """Draw shapes of a robot's links from two sides, a colour each, and its joints through them.

    Parameters
    ----------
    robot
        Of whom the shapes are.
    shapes
        Of its links.
    q
        A configuration, shape (n,), rad or m.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm = dqc.load_robot("panda")
    >>> shapes_picture(arm, arm.shapes.shapes, np.zeros(7)).savefig("panda.png")  # doctest: +SKIP
    """
    from matplotlib.patches import Patch
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    names = [each.name for each in shapes]
    moved = [list(faces_of(each, 1.0)) for each in LinkShapes(tuple(shapes)).moved(robot, q)]
    colours = [COLOURS[i % len(COLOURS)] for i in range(len(names))]
    branches, discs = silhouette(robot, robot.frames(q))
    everything = np.vstack([*branches, *discs, *(face for faces in moved for face in faces)])
    middle = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
    extents = np.ptp(everything, axis=0)
    half = 0.525 * np.maximum(extents, _THINNEST * extents.max())
    figure = new_figure(7.2, 4.4)
    for i, (elevation, azimuth) in enumerate(_VIEWS):
        axes: Any = figure.add_subplot(1, 2, i + 1, projection="3d", computed_zorder=False)
        faces = [face for each in moved for face in each]
        fill = [colour for each, colour in zip(moved, colours, strict=True) for _ in each]
        axes.add_collection3d(Poly3DCollection(faces, facecolors=fill, alpha=_OPACITY, shade=True))
        for joints in branches:
            axes.plot(*joints.T, color=NEUTRAL, lw=1.5, marker="o", ms=3, zorder=3)
        for disc in discs:
            axes.plot(*disc.T, color=NEUTRAL, lw=0.8)
        for name, centre, extent in zip("xyz", middle, half, strict=True):
            getattr(axes, f"set_{name}lim")(centre - extent, centre + extent)
            getattr(axes, f"set_{name}label")(f"{name} [m]")
            getattr(axes, f"{name}axis").set_pane_color(PANE)
            count = 4 if extent > 0.6 * half.max() else 2
            getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(count))
        axes.set_box_aspect(half.copy(), zoom=0.9)  # it changes its argument
        axes.view_init(elev=elevation, azim=azimuth)
    entries = [
        Patch(fc=colour, alpha=_OPACITY, label=name) for colour, name in zip(colours, names, strict=True)
    ]
    figure.legend(handles=entries, loc="lower center", ncols=4)
    return figure
