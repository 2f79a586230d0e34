"""A run as what a scene needs of it: frames and paths at any time, extent, view, and numbers beside it as HTML."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.browser.served_page import FIELD
from dqcontrol.constraints.constraint_view import ConstraintView, NearestPair
from dqcontrol.constraints.constraints import Constraints
from dqcontrol.figures.paths import desired_in_room, finite_rows, recorded_frames, tip_paths
from dqcontrol.figures.robot_bodies import wheel_angles
from dqcontrol.figures.style import LIMIT
from dqcontrol.loop.record import Record
from dqcontrol.measures.held import PlanOfRun, apart_at_plans, plans_of_run
from dqcontrol.robots import Robot, TreeRobot
from dqcontrol.robots.poses import compose, pose7, shift

if TYPE_CHECKING:
    from dqcontrol.experiments.run import Run

_PIECES = 800  # of a path, at most
_DASH = 0.02  # m
_BAD = f"color:{LIMIT};font-weight:bold"


class Reading(NamedTuple):
    """What the numbers beside the scene say of one sample.

    ``margin`` is the distance of the joint nearest to a position limit, rad or m as ``unit`` says, infinite without
    limits; ``speed`` is the largest share of a velocity limit that is commanded, NaN if none is known; ``nearest`` the
    pair of shapes with least room beyond what constraints ask for; ``plan`` what is proved of the way that it follows.
    """

    time: float
    position_error: float
    orientation_error: float
    joint: str
    margin: float
    unit: str
    input: str
    speed: float
    stopped: str
    nearest: NearestPair | None = None
    plan: str = ""


class Track:
    """One run on a robot, to be looked at; a run in progress gives it ever longer records.

    Parameters
    ----------
    label
        Name of the run.
    robot
        The arm or whole body.
    record
        Its samples.
    constraints
        That its law kept: what is around the robot is drawn, and the nearest pair.
    planned
        Positions that the hand shall pass, shape (M, 3), m, if more is known than the record shows.

    Examples
    --------
    >>> track = Track("first", run.robot, run.record)  # doctest: +SKIP
    >>> track.frames(track.index(1.5)).shape  # doctest: +SKIP
    (8, 7)
    """

    label: str
    robot: Robot

    def __init__(
        self,
        label: str,
        robot: Robot,
        record: Record,
        planned: Array | None = None,
        constraints: Constraints | None = None,
    ) -> None:
        self.label, self.robot, self._planned = label, robot, planned
        period = float(record.time[1] - record.time[0]) if len(record) > 1 else 1e-3
        self.around: ConstraintView | None = (
            ConstraintView(constraints, robot, period) if constraints else None
        )
        self.take(record)

    @classmethod
    def of_run(cls, label: str, run: Run) -> Track:
        """Return that of a saved run."""
        return cls(label, run.robot, run.record, constraints=run.surroundings)

    def take(self, record: Record) -> None:
        """Show this record from now on."""
        self.record = record
        finite = np.isfinite(record.q).all(axis=1) & np.isfinite(record.position).all(axis=1)
        # A run that diverged keeps its last pose.
        self._shown = np.maximum.accumulate(np.where(finite, np.arange(len(record)), 0))
        self._wheels = wheel_angles(self.robot, record.q)
        self.plans: list[PlanOfRun] = plans_of_run(record)

    def index(self, time: float) -> int:
        """Return the number of the sample at a time, s: the last one before it, or the first."""
        return max(int(np.searchsorted(self.record.time, time + 1e-9, side="right")) - 1, 0)

    def frames(self, k: int) -> Array:
        """Return poses [quaternion, position] of all joint frames, of the hand, and of the wheels, inertial frame.

        Rows are those of `Robot.frames`, then the right and the left wheel of each differential drive.
        """
        k = int(self._shown[k])
        if not np.isfinite(self.record.q[k]).all():
            rows = len(self.robot.frames(np.zeros(self.robot.configuration_size)))
            return np.tile(shift(), (rows + self._wheels.shape[1], 1))
        (frames,) = recorded_frames(self.robot, self.record, slice(k, k + 1))
        return with_wheels(self.robot, [pose7("frame", frame) for frame in frames], self._wheels[k])

    def nearest(self, k: int) -> NearestPair | None:
        """Return the pair of shapes that is nearest to what constraints ask for; None without constraints."""
        if self.around is None:
            return None
        k = int(self._shown[k])
        return self.around.nearest(self.record.q[k], float(self.record.time[k]))

    def desired(self, k: int) -> Array:
        """Return the desired pose of the hand, [quaternion, position]; of a relative one where it is in the room."""
        return pose7("desired", self._in_room(slice(k, k + 1))[0])

    def _in_room(self, rows: slice) -> Array:
        return desired_in_room(self.robot, self.record.q[rows], self.record.desired_pose[rows])

    @property
    def target(self) -> Array:
        """Desired positions of the hand in the room, shape (M, 3), m."""
        if isinstance(self.robot, TreeRobot) and self.robot.task.kind == "relative":
            return algebra.translation(self._in_room(slice(None)))
        return self.record.desired_position if self._planned is None else self._planned

    def hand_path(self) -> Array:
        """Return the path of the hand, of a tree of all its tips, as pieces, shape (M, 2, 3), m."""
        return np.concatenate([pieces(path) for path in tip_paths(self.robot, self.record)])

    def desired_path(self) -> Array:
        """Return the desired path as dashes, shape (M, 2, 3), m; none where it rests."""
        path = np.concatenate([pieces(way) for way in apart_at_plans(self.record, self.target)])
        middle = np.cumsum(np.linalg.norm(path[:, 1] - path[:, 0], axis=1))
        return path[middle % _DASH < 0.6 * _DASH]

    def reading(self, k: int) -> Reading:
        """Return the numbers of a sample."""
        record, limits = self.record, self.robot.limits
        margins = np.minimum(record.q[k] - limits.lower, limits.upper - record.q[k])
        near = int(np.argmin(np.where(np.isnan(margins), np.inf, margins)))
        shares = np.abs(record.command[k]) / limits.velocity
        known = np.isfinite(limits.velocity) & np.isfinite(shares)
        fastest = int(np.argmax(np.where(known, shares, -1.0)))
        return Reading(
            float(record.time[k]),
            float(record.position_error[k]),
            float(record.orientation_error[k]),
            record.joint_names[near],
            float(margins[near]),
            "rad" if self.robot.joint_types[near] == "revolute" else "m",
            record.input_names[fastest] if record.input_names else "",
            float(shares[fastest]) if known.any() else np.nan,
            record.stopped if k == len(record) - 1 else "",
            self.nearest(k),
            next((each.proof for each in reversed(self.plans) if each.time <= record.time[k]), ""),
        )


def pieces(points: Array) -> Array:
    """Return a path through points (N, 3) as pieces (M, 2, 3) that are not empty, at most some hundreds."""
    points = finite_rows(points)
    kept = points[np.linspace(0, len(points) - 1, min(len(points), _PIECES + 1)).astype(int)]
    pairs = np.stack([kept[:-1], kept[1:]], axis=1)
    return pairs[np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1) > 1e-9]


def with_wheels(robot: Robot, frames: Sequence[Array], angles: Array) -> Array:
    """Return poses of frames (7,), then those of the wheels, right and left of each drive, turned by angles."""
    poses = list(frames)
    for j, (first, _, radius, half_track, *_) in enumerate(robot.drives):
        for side, y in enumerate((-half_track, half_track)):
            half = angles[2 * j + side] / 2
            axle = np.array([np.cos(half), 0, np.sin(half), 0, 0, y, radius])
            poses.append(compose(poses[int(first) + 2], axle))
    return np.array(poses)


def numbers(readings: Sequence[tuple[str, str, Reading]]) -> str:
    """Return the read-outs of some runs, given by label, colour and numbers, as HTML."""
    return "".join(_block(*reading) for reading in readings)


def html_table(rows: Iterable[tuple[str, str, bool]]) -> str:
    """Return names, values, and whether they are beyond what is allowed, as a table of HTML."""
    cells = "".join(
        f"<tr><td>{html.escape(name)}</td>"
        f"<td style='text-align:right;white-space:nowrap;{_BAD if bad else ''}'>{html.escape(value)}</td></tr>"
        for name, value, bad in rows
    )
    return f"<table style='width:100%;font-variant-numeric:tabular-nums'>{cells}</table>"


def plain(name: str) -> str:
    """Return a joint's name in plain words: ``panda_joint4`` is joint 4.

    Examples
    --------
    >>> plain("panda_joint4"), plain("joint_6"), plain("elbow")
    ('joint 4', 'joint 6', 'elbow')
    """
    found = re.search(r"joint_?(\d+)$", name)
    return f"joint {found[1]}" if found else name.replace("_", " ")


def _block(label: str, css: str, reading: Reading) -> str:
    scale, unit = (180 / np.pi, "°") if reading.unit == "rad" else (1e3, " mm")
    rows = [
        ("Position error", f"{1e3 * reading.position_error:.3f} mm", False),
        ("Orientation error", f"{np.degrees(reading.orientation_error):.3f}°", False),
    ]
    if np.isfinite(reading.margin):
        name = f"Position, {plain(reading.joint)}: to its limit"
        rows.append((name, f"{scale * reading.margin:.1f}{unit}", reading.margin < 0))
    if np.isfinite(reading.speed):
        name = f"Speed, {plain(reading.input)}"
        rows.append((name, f"{100 * reading.speed:.0f} % of limit", reading.speed > 1))
    if reading.nearest is not None:
        room = reading.nearest.room
        rows.append((f"Clearance above margin, {reading.nearest.label}", f"{1e3 * room:.1f} mm", room < 0))
    if reading.plan:
        rows.append(("Planned way", reading.plan, False))
    if reading.stopped:
        rows.append(("Ended", reading.stopped, False))
    return (
        f"<div style='border-left:4px solid {css};margin:8px 12px;padding-left:8px;font-size:0.85em'>"
        f"<b>{html.escape(label)}</b>{html_table(rows)}</div>"
    )


_MOMENTS = 12  # of a run that are looked at
_BESIDE = 0.6  # rad; the viewer stands so far beside the line from the robot to the path
_UP = 0.42
ASPECT = 0.95  # of the scene beside the controls in a window of 1000 × 640, width by height


class Extent(NamedTuple):
    """Box around all robots and paths, m."""

    lower: Array
    upper: Array

    @property
    def size(self) -> float:
        """Its diagonal."""
        return float(np.linalg.norm(self.upper - self.lower)) or 1.0


def extent(tracks: Sequence[Track]) -> Extent:
    """Return the box around some runs, at rest in one place."""
    points = [np.zeros((1, 3))]
    for track in tracks:
        for k in np.linspace(0, len(track.record) - 1, _MOMENTS).astype(int):
            points.append(track.frames(k)[:, 4:])
        points += [track.hand_path().reshape(-1, 3), track.target]
    cloud = np.vstack(points)
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    return Extent(cloud.min(axis=0), cloud.max(axis=0))


def viewpoint(foot: Array, hands: Sequence[Array], box: Extent) -> tuple[Array, Array]:
    """Return where the viewer stands and looks, m: the paths of hands (N, 3) from the front, robots behind them."""
    middle = (box.lower + box.upper) / 2
    ahead = np.nanmean(np.vstack(hands), axis=0) - foot
    azimuth = np.arctan2(ahead[1], ahead[0]) + _BESIDE if np.linalg.norm(ahead[:2]) > 1e-6 else _BESIDE
    towards = np.array([np.cos(azimuth), np.sin(azimuth), _UP])
    return middle + 1.3 * (box.size + 0.2) * towards / np.linalg.norm(towards), middle


def places(count: int, box: Extent, towards: Array) -> Array:
    """Return the displacement of each of several runs, shape (count, 3), m: from left to right for a viewer.

    Parameters
    ----------
    count
        Number of runs.
    box
        Around them all in one place.
    towards
        Direction from what is looked at to the viewer, shape (3,), not vertical.
    """
    right = _right(towards)
    width = float(np.abs(right) @ (box.upper - box.lower))
    out: Array = np.outer(np.arange(count) - (count - 1) / 2, (width + 0.1 * box.size) * right)
    return out


def step_back(apart: Array, box: Extent, towards: Array) -> float:
    """Return how many times as far off the viewer must stand to see all runs side by side; at least 1.

    Parameters
    ----------
    apart
        Displacements of the runs, as `places` gives them.
    box, towards
        As for `places`; ``towards`` as long as the viewer is off.
    """
    half = (box.upper - box.lower) / 2
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    corners = (apart[:, None] + signs * half).reshape(-1, 3)
    distance = float(np.linalg.norm(towards))
    across = np.abs(corners @ _right(towards)) / (ASPECT * np.tan(FIELD / 2))
    return max(1.0, float((across + corners @ towards / distance).max()) / distance)


def _right(towards: Array) -> Array:
    """Return the viewer's direction to the right, horizontal, of length 1."""
    right = np.array([-towards[1], towards[0], 0.0])
    return right / np.linalg.norm(right)
