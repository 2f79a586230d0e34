"""Figures of the end effector's path in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.figures import style as styles
from dqcontrol.figures.surroundings import corners_of, draw_flat, draw_in_space, entries, faces_near
from dqcontrol.loop.record import Record
from dqcontrol.measures.held import PlanOfRun, apart_at_plans, plans_of_run
from dqcontrol.plants.plant import BASE_POSITION, BASE_QUATERNION
from dqcontrol.robots import Robot, TreeRobot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.constraints.constraints import Constraints


_PIECES = 800  # of a curve: one a pixel of a figure across a page, 7.16 in at 96 dots an inch less margins


def outline(curves: Array) -> NDArray[np.intp] | None:
    """Return rows that show each peak of curves (N, k); None where all N are needed.

    Of each piece these are the first, the last, and those with the least and the largest value of each curve.
    """
    count, width = curves.shape
    step = -(-count // _PIECES)
    if step <= 2 * width + 2:
        return None
    whole = count - count % step
    first = np.arange(0, whole, step)
    pieces = curves[:whole].reshape(-1, step, width)
    found = [first, first + step - 1, np.arange(whole, count)]
    for peaks in (pieces.argmin(axis=1), pieces.argmax(axis=1)):
        found.append((first[:, None] + peaks).ravel())
    return np.unique(np.concatenate(found))


def outlined(points: Array) -> Array:
    """Return those of many points (N, k) that show each of their peaks; see `outline`."""
    kept = outline(points)
    return points if kept is None else points[kept]


def tip_paths(robot: Robot, record: Record) -> list[Array]:
    """Return positions (N, 3), m, of the end effector; of a tree those of all tips, and of what two of them hold."""
    if not isinstance(robot, TreeRobot) or not np.isfinite(record.q).all():
        return [record.position]
    tips = algebra.translation(robot.frames(record.q)[:, list(robot.ends)])
    between = [record.position] if robot.task.kind == "absolute" else []
    return [*np.moveaxis(tips, 1, 0), *between]


def desired_in_room(robot: Robot, q: Array, desired: Array) -> Array:
    """Return desired poses (N, 8) at configurations (N, n) in the room: relative ones are seen from the second hand."""
    if not isinstance(robot, TreeRobot) or robot.task.kind != "relative" or not np.isfinite(q).all():
        return desired
    return algebra.multiply(robot.pose_of(robot.task.frames[1], q), desired)


def recorded_frames(robot: Robot, record: Record, samples: NDArray[np.int_] | slice) -> Array:
    """Return the frames of a robot at some samples, tilted and lifted as its base was, (…, n + 1, 8).

    Without a recorded pose of the base they are those of `Robot.frames`.
    """
    frames = robot.frames(record.q[samples])
    lean = base_motion(record, samples)
    return frames if lean is None else algebra.multiply(lean[..., None, :], frames)


def base_motion(record: Record, samples: NDArray[np.int_] | slice) -> Array | None:
    """Return what moves an upright base to where it was at some samples, (…, 8); None if that is not recorded."""
    if BASE_POSITION not in record.readings or BASE_QUATERNION not in record.readings:
        return None
    x, y, heading = record.q[samples, :3].T
    still = np.zeros_like(x)
    upright = algebra.pose(
        np.stack([np.cos(heading / 2), still, still, np.sin(heading / 2)], axis=1),
        np.stack([x, y, still], axis=1),
    )
    rotation = record.readings[BASE_QUATERNION].values[samples]
    unit = rotation / np.linalg.norm(rotation, axis=1)[:, None]
    true = algebra.pose(unit, record.readings[BASE_POSITION].values[samples])
    return algebra.multiply(true, algebra.conjugate(upright))


_FLAT = 0.05  # a path counts as planar if it is this many times thinner than long
_NAMES = "xyz"


@styles.styled
def path_3d(record: Record, constraints: Constraints | None = None) -> Figure:
    """Plot the end effector's path over the desired one; beside it a front view if the desired path is planar.

    Axes have one scale. Start and end of the end effector are marked, and the target if the desired pose rests.

    Parameters
    ----------
    record
        The run; samples that are not finite are left out.
    constraints
        Their obstacles and zones near the path are drawn.

    Examples
    --------
    >>> path_3d(run.record).savefig("path.pdf")  # doctest: +SKIP
    """
    return _paths({"end effector": record}, constraints)


@styles.styled
def compare_paths(records: Mapping[str, Record], constraints: Constraints | None = None) -> Figure:
    """Plot the end effector's paths of several runs by label, over the first run's desired path; see `path_3d`.

    Parameters
    ----------
    records
        Runs by label.
    constraints
        Their obstacles and zones near the paths are drawn.

    Raises
    ------
    ShapeError
        If there is no run.
    """
    return _paths(records, constraints)


def _paths(records: Mapping[str, Record], constraints: Constraints | None) -> Figure:
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    first = styles.first_of(records)
    hands = {label: finite_rows(record.position) for label, record in records.items()}
    made = [each for each in plans_of_run(first) if each.held_by]
    desired = finite_rows(first.desired_position)
    ways = apart_at_plans(first, desired)
    everything = np.concatenate([desired, *hands.values()])
    moving = len(desired) > 1 and np.ptp(desired, axis=0).max() > 1e-6
    plane = path_plane(desired) if moving else None
    drawn = faces_near(constraints, everything, first)

    rows, across = (2 // styles.panels_across(2), styles.panels_across(2)) if plane else (1, 1)
    figure = styles.new_figure(styles.DOUBLE, 0.6 + 3.3 * rows) if plane else styles.new_figure(5.2, 4.6)
    space: Any = figure.add_subplot(rows, across, 1, projection="3d")
    draw_in_space(space, drawn)
    _draw(space, ways, hands, np.eye(3), moving)
    _draw_plans(space, made, np.eye(3))
    _frame_space(
        space, np.vstack([everything, corners_of(drawn)]), plane, 0.88 if across == 2 or not plane else 0.8
    )
    if plane:
        axes_of_plane, labels = plane
        front = figure.add_subplot(rows, across, 2)
        draw_flat(front, drawn, axes_of_plane)
        _draw(front, ways, hands, axes_of_plane, moving)
        _draw_plans(front, made, axes_of_plane)
        front.set_aspect("equal", adjustable="datalim")
        front.set(xlabel=labels[0], ylabel=labels[1])
        front.margins(0.08)
        for axis in (front.xaxis, front.yaxis):
            axis.set_major_locator(MaxNLocator(6))
    kinds = ("start", "end", *(["planned again"] if made else []))
    marks = [Line2D([], [], label=kind, **_mark(kind, styles.NEUTRAL)) for kind in kinds]
    styles.legend_below(figure, space, [*marks, *entries(drawn)])
    return figure


def _draw_plans(axes: Any, made: Sequence[PlanOfRun], onto: Array) -> None:
    """Mark where a way was planned again."""
    for each in made:
        axes.plot(*(onto @ each.place).reshape(-1, 1), **_mark("planned again", styles.NEUTRAL))


def _draw(axes: Any, desired: Sequence[Array], hands: Mapping[str, Array], onto: Array, moving: bool) -> None:
    """Draw all paths, projected onto the rows of a matrix."""
    for i, (label, hand) in enumerate(hands.items()):
        points = outlined(hand @ onto.T).T
        style = styles.line_style(i)
        axes.plot(*points, label=label, **style)
        for kind, at in (("start", slice(0, 1)), ("end", slice(-1, None))):
            axes.plot(*points[:, at], **_mark(kind, style["color"]))
    for k, way in enumerate(desired if moving else ()):
        points = outlined(way @ onto.T).T
        axes.plot(*points, color=styles.DESIRED, ls="--", lw=1.1, label=None if k else "desired")
    if not moving:
        axes.plot(
            *(desired[0][:1] @ onto.T).T,
            color=styles.DESIRED,
            marker="+",
            ms=10,
            mew=1.6,
            ls="",
            label="target",
        )


def _mark(kind: str, colour: str) -> dict[str, Any]:
    """Return the style of a mark: start an open circle, end a square, where it was planned again a star."""
    face = "white" if kind == "start" else colour
    return {
        "ls": "",
        "marker": {"start": "o", "end": "s"}.get(kind, "*"),
        "ms": 6,
        "mew": 1.4,
        "mec": colour,
        "mfc": face,
    }


def _frame_space(axes: Any, points: Array, plane: tuple[Array, tuple[str, str]] | None, zoom: float) -> None:
    """Give a 3-D view one scale, room for its ticks, and an oblique view onto the path's plane."""
    low, high = points.min(axis=0), points.max(axis=0)
    longest = max(float((high - low).max()), 1e-3)
    size = np.maximum(1.1 * (high - low), 0.6 * longest)
    styles.frame_space(
        axes, (low + high) / 2, size, [4 if each > 0.8 * size.max() else 3 for each in size], 2
    )
    axes.set_box_aspect(size, zoom=zoom)
    axes.tick_params(pad=0)
    elevation, azimuth = 24.0, -58.0
    if plane:
        normal = np.cross(*plane[0])
        if abs(normal[2]) > 0.8:
            elevation = 42.0
        else:  # look at the front side, from 32° beside it
            azimuth = np.degrees(np.arctan2(normal[1], normal[0])) + 32.0
    axes.view_init(elev=elevation, azim=azimuth)


def path_plane(points: Array) -> tuple[Array, tuple[str, str]] | None:
    """Return two axes that span the plane of the points and their labels, or None if they lie in no plane."""
    if len(points) < 3:
        return None
    extents = np.ptp(points, axis=0)
    centred = points - points.mean(axis=0)
    _, spread, directions = np.linalg.svd(centred, full_matrices=False)
    if spread[2] > _FLAT * spread[0] or spread[1] < _FLAT * spread[0]:
        return None
    across = int(extents.argmin())
    if extents[across] <= _FLAT * extents.max():
        first, second = (i for i in range(3) if i != across)
        return np.eye(3)[[first, second]], (f"{_NAMES[first]} [m]", f"{_NAMES[second]} [m]")
    normal = directions[2]
    right = np.cross([0, 0, 1.0], normal)  # horizontal; the normal is not vertical, or z were the thin axis
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal, right)]), (
        "horizontal in the plane [m]",
        "upwards in the plane [m]",
    )


def finite_rows(points: Array) -> Array:
    """Return those rows of points or configurations (N, k) that are finite."""
    return points[np.isfinite(points).all(axis=1)]
