"""Figures of robots that drive: where their bases went, and the whole robot at several times in one picture."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.figures.paths import outline, outlined, recorded_frames
from dqcontrol.figures.style import DESIRED, NEUTRAL, PANE, legend_below, line_style, new_figure, styled
from dqcontrol.figures.surroundings import corners_of, draw_flat, draw_in_space, entries, faces_near
from dqcontrol.loop.record import Record
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.two_arms import TwoArms
from dqcontrol.robots.whole_body import Drive, WholeBody, parts_with_offsets

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.constraints.constraints import Constraints


_WIDEST, _SHORTEST, _TALLEST = 5.0, 1.8, 4.4  # in, of the walls in space; beside them labels take an inch
_WIDTH = 6.4  # in
_LABELS, _LEGEND = 1.2, 0.4  # in, of labels and legend, and of the legend alone
_HEADINGS = 12  # arrows along a path
_POSES = 5  # of the robot in one picture
_RADIUS = 0.17  # m, of a base that does not say how wide it is


@styled
def base_path(robot: Robot, records: Mapping[str, Record], constraints: Constraints | None = None) -> Figure:
    """Plot from above where bases and end effector went, the headings of the bases, and the goal.

    Arrows show headings at equal times; they start where the base is. The last desired position of the end effector is
    the goal, and its arrow the end effector's x axis there.

    Parameters
    ----------
    robot
        A whole body with at least one base.
    records
        Its runs by label.
    constraints
        Their obstacles and zones near the ways are drawn.

    Raises
    ------
    ShapeError
        If there is no run, or the robot has no base.

    Examples
    --------
    >>> base_path(run.robot, {"": run.record}).savefig("base.png")  # doctest: +SKIP
    """
    from matplotlib.lines import Line2D

    bases = _bases(robot)
    if not records or not bases:
        raise ShapeError("records: expected at least one run of a robot with a mobile base")
    figure = new_figure(6.0, 5.0)
    axes = figure.subplots()
    ways = np.vstack(
        [
            algebra.translation(robot.frames(outlined(_finite(each.q)))[:, 2:]).reshape(-1, 3)
            for each in records.values()
        ]
    )
    drawn = faces_near(constraints, ways, next(iter(records.values())))
    draw_flat(axes, drawn, np.eye(3)[:2])
    for i, (label, record) in enumerate(records.items()):
        style = line_style(i)
        q = _finite(record.q)
        frames = robot.frames(outlined(q))
        hand = algebra.translation(frames[:, -1])
        some = robot.frames(q[np.unique(np.linspace(0, len(q) - 1, _HEADINGS).astype(int))])
        axes.plot(*hand[:, :2].T, color=style["color"], ls=":", lw=1.0)
        for first, _ in bases:
            place, _ = _place(frames[:, first + 2])
            axes.plot(*place.T, label=label or "base", **style)
            at, forward = _place(some[:, first + 2])
            axes.quiver(*at.T, *forward.T, color=style["color"], angles="xy", width=4e-3, scale=22.0)
            axes.plot(*place[0], "o", ms=6, mew=1.4, mec=style["color"], mfc="white")
            axes.plot(*place[-1], "s", ms=6, color=style["color"])
    goal, towards = _place(next(iter(records.values())).desired_pose[-1:])
    axes.quiver(*goal[0], *towards[0], color=DESIRED, angles="xy", width=4e-3, scale=22.0)
    axes.plot(*goal[0], "+", ms=11, mew=1.8, color=DESIRED)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    mark: dict[str, Any] = {"ls": "", "color": NEUTRAL}
    legend_below(
        figure,
        axes,
        [
            Line2D([], [], label="end effector", ls=":", color=NEUTRAL),
            Line2D([], [], label="start", marker="o", mfc="white", **mark),
            Line2D([], [], label="end", marker="s", **mark),
            Line2D([], [], label="goal", marker="+", ms=9, mew=1.6, ls="", color=DESIRED),
            *entries(drawn),
        ],
    )
    return figure


@styled
def superimposed(
    robot: Robot,
    records: Mapping[str, Record],
    poses: int = _POSES,
    constraints: Constraints | None = None,
) -> Figure:
    """Draw the robot at several times of its runs in one picture, later ones stronger. [S17 Figs 5.4, 5.11]

    The times share the way of the end effector equally. Arms are drawn as lines from joint to joint, drives as discs as
    wide as their track. The cross is where the end effector shall be at the end; the second run and further ones are
    drawn dashed.

    Parameters
    ----------
    robot
        That of all runs.
    records
        Runs by label.
    poses
        How many of each run, at least 2.
    constraints
        Their obstacles and zones near the ways are drawn.

    Raises
    ------
    ShapeError
        If there is no run, or ``poses`` is less than 2.
    """
    from matplotlib.lines import Line2D

    if not records or poses < 2:
        raise ShapeError(f"poses: expected at least 2 of at least one run, got {poses} of {len(records)}")
    figure = new_figure(_WIDTH, 4.0)
    axes: Any = figure.add_subplot(projection="3d")
    everything = []
    for i, (label, record) in enumerate(records.items()):
        style = line_style(i)
        finite = np.flatnonzero(np.isfinite(record.q).all(axis=1))
        if (kept := outline(record.q[finite])) is not None:
            finite = finite[kept]
        hand = algebra.translation(recorded_frames(robot, record, finite)[:, -1])
        axes.plot(*hand.T, color=style["color"], ls=":", lw=0.9)
        chosen = finite[_evenly(hand, poses)]
        for k, frames in enumerate(recorded_frames(robot, record, chosen)):
            strength = 0.25 + 0.75 * k / (poses - 1)
            branches, discs = silhouette(robot, frames)
            everything += [*branches, *discs]
            last = k == poses - 1
            for j, links in enumerate(branches):
                axes.plot(
                    *links.T,
                    lw=1.2 + 2.0 * strength,
                    alpha=strength,
                    solid_capstyle="round",
                    marker="o",
                    ms=2.0 + 1.5 * strength,
                    label=(label or "robot") if last and not j else None,
                    **style,
                )
            for disc in discs:
                axes.plot(*disc.T, color=style["color"], lw=0.6 + strength, alpha=strength)
    goal = algebra.translation(next(iter(records.values())).desired_pose[-1])
    axes.plot(*goal[:, None], "+", ms=12, mew=2.0, color=DESIRED)
    drawn = faces_near(constraints, np.vstack(everything), next(iter(records.values())))
    draw_in_space(axes, drawn)
    for line in axes.lines:
        line.set_clip_on(False)  # long ways reach beyond the rectangle of the axes,
        line.set_in_layout(False)  # which must not shrink for them
    _frame(figure, axes, np.vstack([*everything, goal[None], corners_of(drawn)]))
    goal_mark = Line2D([], [], label="goal", marker="+", ms=9, mew=1.6, ls="", color=DESIRED)
    legend_below(figure, axes, [goal_mark, *entries(drawn)])
    return figure


def has_base(robot: Robot) -> bool:
    """Return whether a robot has a mobile base, so that `base_path` can draw it."""
    return bool(_bases(robot))


def _finite(q: Array) -> Array:
    return q[np.isfinite(q).all(axis=1)]


def _bases(robot: Robot) -> list[tuple[int, float]]:
    """Return the index of each base's x and the radius that it is drawn with, m."""
    body = robot.base if isinstance(robot, TwoArms) else robot
    parts = body.parts if isinstance(body, WholeBody) else ()
    return [
        (first, 1.15 * part.half_track if isinstance(part, Drive) else _RADIUS)
        for first, part in parts_with_offsets(parts)
        if not isinstance(part, SerialArm)
    ]


def _place(poses: Array) -> tuple[Array, Array]:
    """Return where poses are and where their x axes point, both seen from above, shape (N, 2) each."""
    tips = algebra.multiply(poses, algebra.pose(np.array([1.0, 0, 0, 0]), np.array([1.0, 0, 0])))
    place = algebra.translation(poses)
    return place[:, :2], (algebra.translation(tips) - place)[:, :2]


def _evenly(path: Array, count: int) -> NDArray[np.intp]:
    """Return indices that share the length of a path equally."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    return np.minimum(np.searchsorted(length, np.linspace(0, length[-1], count)), len(path) - 1)


def silhouette(robot: Robot, frames: Array) -> tuple[list[Array], list[Array]]:
    """Return points from joint to joint up to each end effector, and each base's rim with a stroke to its front."""
    bases = _bases(robot)
    hidden = {first + k for first, _ in robot.bases for k in (0, 1)}
    branches = []
    for end in robot.ends:
        rows = [row for row in _carriers(robot, end) if row not in hidden]
        first = [] if robot.bases else [robot.chain[rows[0], 4:7]]
        branches.append(np.vstack([*first, algebra.translation(frames[rows])]))
    discs = []
    angles = np.linspace(0, 2 * np.pi, 40)
    for first, radius in bases:
        rim = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
        rim = np.vstack([np.zeros(3), rim])
        one = np.array([1.0, 0, 0, 0])
        discs.append(algebra.translation(algebra.multiply(frames[first + 2], algebra.pose(one, rim))))
    return branches, discs


def _carriers(robot: Robot, row: int) -> list[int]:
    """Return a row of `Robot.frames` and those that carry it, from the base on."""
    rows = []
    while row >= 0:
        rows.append(row)
        row = int(robot.parents[row])
    return rows[::-1]


def _frame(figure: Figure, axes: Any, points: Array) -> None:
    """Give the view one scale and the floor, and the figure the height that the motion fills."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    low[2] = min(low[2], 0.0)
    size = np.maximum(1.08 * (high - low), 0.15)
    middle = (low + high) / 2
    for name, centre, extent in zip("xyz", middle, size, strict=True):
        getattr(axes, f"set_{name}lim")(centre - extent / 2, centre + extent / 2)
        getattr(axes, f"set_{name}label")(f"{name} [m]", labelpad=2)
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(MaxNLocator(4))
        axis.set_pane_color(PANE)
    axes.tick_params(pad=0)
    axes.view_init(elev=24.0, azim=-62.0)
    axes.set_box_aspect(size, zoom=1.0)
    across, up = _drawn_size(axes)
    paper = figure.get_figwidth()
    wide = min(_WIDEST * paper / _WIDTH, _TALLEST * across / up)
    high = max(wide * up / across, _SHORTEST) + _LABELS
    figure.set_figheight(high)
    side = min(paper, high - _LEGEND)  # of the square that Matplotlib draws a view into
    axes.set_box_aspect(size, zoom=wide / (across * side))


def _drawn_size(axes: Any) -> tuple[float, float]:
    """Return width and height of the walls as they are drawn, as shares of the rectangle of the axes."""
    from mpl_toolkits.mplot3d import proj3d

    limits = [getattr(axes, f"get_{name}lim")() for name in "xyz"]
    corners = np.array(list(product(*limits)))
    x, y, z = corners.T
    across, up, _ = proj3d.proj_transform(x, y, z, axes.get_proj())
    drawn = axes.transAxes.inverted().transform(axes.transData.transform(np.column_stack([across, up])))
    return tuple(np.ptp(drawn, axis=0).tolist())
