"""A drawing of a robot with the path of its end effector, to tell at a glance what a report is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.figures.base_paths import silhouette
from dqcontrol.figures.paths import desired_in_room, recorded_frames, tip_paths
from dqcontrol.figures.style import COLOURS, DESIRED, NEUTRAL, PANE, new_figure, styled
from dqcontrol.figures.surroundings import faces_of
from dqcontrol.loop.record import Record, thinned
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


_BESIDE, _UP = (
    0.75,
    0.42,
)  # rad, and a share of 1: where the viewer stands, seen from the robot towards the path
_SAMPLES = 1000  # of a path, in a picture of 300 pixels across
_SHELL, _EDGE = "#d9dce1", "#50555c"
_BARS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # m


@styled
def robot_picture(robot: Robot, record: Record) -> Figure:
    """Draw a robot as it starts, with the desired path (dashed) and the end effector's, from the front, without axes.

    Links are drawn as rods from joint to joint; a bar gives the scale.

    Parameters
    ----------
    robot
        An arm or a whole body.
    record
        A run of it.

    Examples
    --------
    >>> robot_picture(run.robot, run.record).savefig("robot.png")  # doctest: +SKIP
    """
    record = thinned(record, _SAMPLES)
    figure = new_figure(3.0, 2.6)
    axes: Any = figure.subplots()
    finite = np.flatnonzero(np.isfinite(record.q).all(axis=1) & np.isfinite(record.position).all(axis=1))
    frames = recorded_frames(robot, record, finite[:1])[0]
    branches, discs = silhouette(robot, frames)
    desired = translation(desired_in_room(robot, record.q, record.desired_pose))
    first, every = branches[0][0], np.vstack(branches)
    onto = _view(np.nanmean(desired, axis=0) - first)
    floor = min(0.0, float(every[:, 2].min()))
    reach = float(np.ptp(every @ onto.T, axis=0).max()) or 1.0
    middle = np.mean([links[0] for links in branches], axis=0)
    _floor(axes, np.array([*middle[:2], floor]), 0.35 * reach, onto)
    for disc in discs:
        axes.fill(*(disc[1:] @ onto.T).T, color=_SHELL, ec=_EDGE, lw=0.8)
    for width, colour in ((8.5, _EDGE), (6.5, _SHELL)):
        for links in branches:
            post = [] if robot.bases else [[*links[0, :2], floor]]  # it carries the first joint
            rods = np.vstack([*post, links]) @ onto.T
            axes.plot(*rods.T, color=colour, lw=width, solid_capstyle="round", solid_joinstyle="round")
    for links in branches:
        axes.plot(*(links[1:-1] @ onto.T).T, "o", ms=4, color=COLOURS[1], mew=0)
    axes.plot(*(desired @ onto.T).T, color=DESIRED, ls="--", lw=1.1)
    for path in tip_paths(robot, record):
        axes.plot(*(path @ onto.T).T, color=COLOURS[0], lw=1.4)
    for links in branches:
        axes.plot(*(links[-1] @ onto.T), "o", ms=5, mec=COLOURS[0], mfc="white", mew=1.3)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.axis("off")
    _scale_bar(axes, reach)
    return figure


def _view(ahead: Array) -> Array:
    """Return the viewer's directions to the right and up, shape (2, 3): the path is in front of the robot."""
    azimuth = (np.arctan2(ahead[1], ahead[0]) if np.linalg.norm(ahead[:2]) > 1e-6 else 0.0) + _BESIDE
    towards = np.array([np.cos(azimuth), np.sin(azimuth), _UP])
    towards /= np.linalg.norm(towards)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right)])


def _floor(axes: Any, foot: Array, half: float, onto: Array) -> None:
    for at in np.linspace(-half, half, 5):
        for line in ([[at, -half, 0], [at, half, 0]], [[-half, at, 0], [half, at, 0]]):
            axes.plot(*((foot + np.array(line)) @ onto.T).T, color="#e4e4e4", lw=0.7, zorder=0)


def _scale_bar(axes: Any, reach: float) -> None:
    length = max((bar for bar in _BARS if bar <= 0.4 * reach), default=_BARS[0])
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    y = low - 0.04 * (high - low)
    axes.plot([left, left + length], [y, y], color=NEUTRAL, lw=2.0, solid_capstyle="butt")
    text = f"{1e3 * length:g} mm" if length < 0.1 else f"{length:g} m"
    axes.text(left + 1.1 * length + 0.01 * (right - left), y, text, va="center", color=NEUTRAL)
