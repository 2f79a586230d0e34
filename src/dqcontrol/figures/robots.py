"""Figures of robots: where bases went, a robot at several times, its shapes, and at a glance what a run is about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.figures import paths, style as styles, surroundings
from dqcontrol.loop.record import Record, thinned
from dqcontrol.robots import LinkShape, LinkShapes, Robot, SerialArm, TwoArms
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


@styles.styled
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
    figure = styles.new_figure(6.0, 5.0)
    axes = figure.subplots()
    tracks = [robot.frames(paths.outlined(paths.finite_rows(each.q))) for each in records.values()]
    ways = np.vstack([algebra.translation(frames[:, 2:]).reshape(-1, 3) for frames in tracks])
    drawn = surroundings.faces_near(constraints, ways, next(iter(records.values())))
    surroundings.draw_flat(axes, drawn, np.eye(3)[:2])
    for i, ((label, record), frames) in enumerate(zip(records.items(), tracks, strict=True)):
        style, q = styles.line_style(i), paths.finite_rows(record.q)
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
    axes.quiver(*goal[0], *towards[0], color=styles.DESIRED, angles="xy", width=4e-3, scale=22.0)
    axes.plot(*goal[0], "+", ms=11, mew=1.8, color=styles.DESIRED)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    mark: dict[str, Any] = {"ls": "", "color": styles.NEUTRAL}
    styles.legend_below(
        figure,
        axes,
        [
            Line2D([], [], label="end effector", ls=":", color=styles.NEUTRAL),
            Line2D([], [], label="start", marker="o", mfc="white", **mark),
            Line2D([], [], label="end", marker="s", **mark),
            Line2D([], [], label="goal", marker="+", ms=9, mew=1.6, ls="", color=styles.DESIRED),
            *surroundings.entries(drawn),
        ],
    )
    return figure


@styles.styled
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
    figure = styles.new_figure(_WIDTH, 4.0)
    axes: Any = figure.add_subplot(projection="3d")
    everything = []
    for i, (label, record) in enumerate(records.items()):
        style = styles.line_style(i)
        finite = np.flatnonzero(np.isfinite(record.q).all(axis=1))
        if (kept := paths.outline(record.q[finite])) is not None:
            finite = finite[kept]
        hand = algebra.translation(paths.recorded_frames(robot, record, finite)[:, -1])
        axes.plot(*hand.T, color=style["color"], ls=":", lw=0.9)
        chosen = finite[_evenly(hand, poses)]
        for k, frames in enumerate(paths.recorded_frames(robot, record, chosen)):
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
    axes.plot(*goal[:, None], "+", ms=12, mew=2.0, color=styles.DESIRED)
    drawn = surroundings.faces_near(constraints, np.vstack(everything), next(iter(records.values())))
    surroundings.draw_in_space(axes, drawn)
    for line in axes.lines:
        line.set_clip_on(False)  # long ways reach beyond the rectangle of the axes,
        line.set_in_layout(False)  # which must not shrink for them
    _frame(figure, axes, np.vstack([*everything, goal[None], surroundings.corners_of(drawn)]))
    goal_mark = Line2D([], [], label="goal", marker="+", ms=9, mew=1.6, ls="", color=styles.DESIRED)
    styles.legend_below(figure, axes, [goal_mark, *surroundings.entries(drawn)])
    return figure


def has_base(robot: Robot) -> bool:
    """Return whether a robot has a mobile base, so that `base_path` can draw it."""
    return bool(_bases(robot))


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
    low, high = points.min(axis=0), points.max(axis=0)
    low[2] = min(low[2], 0.0)
    size = np.maximum(1.08 * (high - low), 0.15)
    styles.frame_space(axes, (low + high) / 2, size, [4, 4, 4], 2)
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


_VIEWS = ((18.0, -60.0), (18.0, 30.0))  # elevation and azimuth, degrees
_OPACITY = 0.5
_DARKER = 0.5
_NAMES, _ROW = 4, 0.2  # of shapes in a row, and its height, inches
_THINNEST = 0.4  # of the longest side: less would leave no room for the numbers


@styles.styled
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
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    moved = [list(surroundings.faces_of(each, 1.0)) for each in LinkShapes(tuple(shapes)).moved(robot, q)]
    colours = [  # the same again are darker
        tuple(
            _DARKER ** (i // len(styles.COLOURS)) * np.array(to_rgb(styles.COLOURS[i % len(styles.COLOURS)]))
        )
        for i in range(len(shapes))
    ]
    branches, discs = silhouette(robot, robot.frames(q))
    everything = np.vstack([*branches, *discs, *(face for faces in moved for face in faces)])
    middle = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
    extents = np.ptp(everything, axis=0)
    size = 1.05 * np.maximum(extents, _THINNEST * extents.max())
    figure = styles.new_figure(7.2, 4.0 + _ROW * -(-len(shapes) // _NAMES))
    for i, (elevation, azimuth) in enumerate(_VIEWS):
        axes: Any = figure.add_subplot(1, 2, i + 1, projection="3d", computed_zorder=False)
        faces = [face for each in moved for face in each]
        fill = [colour for each, colour in zip(moved, colours, strict=True) for _ in each]
        solid = Poly3DCollection(faces, facecolors=fill, alpha=_OPACITY, shade=True)
        axes.add_collection3d(
            solid, autolim=False
        )  # Matplotlib reads memory that faces of fewer corners leave unset
        for joints in branches:
            axes.plot(*joints.T, color=styles.NEUTRAL, lw=1.5, marker="o", ms=3, zorder=3)
        for disc in discs:
            axes.plot(*disc.T, color=styles.NEUTRAL, lw=0.8)
        styles.frame_space(axes, middle, size, [4 if each > 0.6 * size.max() else 2 for each in size], 7.0)
        axes.set_box_aspect(size.copy(), zoom=0.84)  # it changes its argument
        axes.view_init(elev=elevation, azim=azimuth)
    handles = [Patch(fc=colours[i], alpha=_OPACITY, label=each.name) for i, each in enumerate(shapes)]
    figure.legend(handles=handles, loc="lower center", ncols=_NAMES)
    return figure


_BESIDE, _UP = 0.75, 0.42  # rad, and a share of 1: where the viewer stands, seen from the robot to the path
_SAMPLES = 1000  # of a path, in a picture of 300 pixels across
_SHELL, _EDGE = "#d9dce1", "#50555c"
_BARS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # m


@styles.styled
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
    figure = styles.new_figure(3.0, 2.6)
    axes: Any = figure.subplots()
    finite = np.flatnonzero(np.isfinite(record.q).all(axis=1) & np.isfinite(record.position).all(axis=1))
    frames = paths.recorded_frames(robot, record, finite[:1])[0]
    branches, discs = silhouette(robot, frames)
    desired = algebra.translation(paths.desired_in_room(robot, record.q, record.desired_pose))
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
        axes.plot(*(links[1:-1] @ onto.T).T, "o", ms=4, color=styles.COLOURS[1], mew=0)
    axes.plot(*(desired @ onto.T).T, color=styles.DESIRED, ls="--", lw=1.1)
    for path in paths.tip_paths(robot, record):
        axes.plot(*(path @ onto.T).T, color=styles.COLOURS[0], lw=1.4)
    for links in branches:
        axes.plot(*(links[-1] @ onto.T), "o", ms=5, mec=styles.COLOURS[0], mfc="white", mew=1.3)
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
    axes.plot([left, left + length], [y, y], color=styles.NEUTRAL, lw=2.0, solid_capstyle="butt")
    text = f"{1e3 * length:g} mm" if length < 0.1 else f"{length:g} m"
    axes.text(left + 1.1 * length + 0.01 * (right - left), y, text, va="center", color=styles.NEUTRAL)
