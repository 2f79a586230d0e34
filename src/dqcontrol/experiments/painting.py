"""Light painting: an arm holds a lamp and draws what a file says, pen up and pen down. [P16 5.9]"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.errors import (
    FileFormatError,
    ReachError,
    ValueRangeError,
    as_array,
    as_positive,
)
from dqcontrol.experiments.prepared_experiment import FULL_POSE
from dqcontrol.files.input_file import read_text
from dqcontrol.laws import Law, LinearQuadraticDQ
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import Record, simulate
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.planning.followed_path import start_through
from dqcontrol.plants import Plant, Servo
from dqcontrol.references import Drawing, JerkLimited, Reference, Sequence as InSequence, StraightStroke
from dqcontrol.references.drawing import box_of, parse_drawing, scaled
from dqcontrol.references.planar import Plane, plane_axes
from dqcontrol.references.sample import POSE
from dqcontrol.references.strokes import PenPath, PenStroke, Stroke
from dqcontrol.references.svg_file import load_svg
from dqcontrol.robots import Robot, load_robot, postures

PERIOD = 0.01  # s
LAW, PLANT = LinearQuadraticDQ(error_weight=100.0, control_weight=1.0), Servo()
# Of the Panda, whose end effector then points forward, along y.
START = (1.5708, -0.8, 0.0, -2.4, 0.0, 3.1708, 0.7854)
_WIDEST, _NARROWEST = 0.45, 0.05  # m; what is tried if no width is given
_SHRINK = 0.88  # a try
_POSES = 60  # of the drawing that must be reached
_POSITION, _ORIENTATION = 1e-3, 1e-2  # m, rad
_TRAVEL = 2.0  # times as fast with the lamp off
_ACCELERATION, _JERK = 1.0, 12.0  # m/s², m/s³
_LONGEST = 1200.0  # s
_SPACED = 0.01  # m: between poses of a drawing that starts are tried with


@dataclass(frozen=True)
class Painting:
    """What was drawn.

    Attributes
    ----------
    record
        The run.
    lit
        Whether the lamp was on, shape (N,).
    robot
        The arm.
    size
        Width and height of the drawing, m.
    """

    record: Record
    lit: NDArray[np.bool_]
    robot: Robot
    size: tuple[float, float]


def paint(
    drawing: str | Path,
    robot: Robot | str = "panda",
    start: ArrayLike | None = None,
    *,
    width: float | None = None,
    speed: float = 0.1,
    plane: Plane = "xz",
    law: Law = LAW,
    plant: Plant = PLANT,
) -> Painting:
    """Draw a file with a lamp in the hand, unless told otherwise by the law LQR-DQ on the default servos.

    The middle of the drawing is where the end effector is in the start configuration. Between two outlines the lamp is
    off. The end effector rests at corners; joints keep their velocity limits.

    Parameters
    ----------
    drawing
        An SVG file, or a drawing file (``.txt``).
    robot
        An arm, or what `load_robot` takes.
    start
        Configuration with the end effector in the middle of the paper, rad or m; default, for the Panda only: it looks
        along y.
    width
        m; default: as wide as the arm reaches, up to 0.45 m; a drawing file keeps its own size.
    speed
        Of the lit lamp, m/s.
    plane
        How the paper lies; see `Drawing`.
    law, plant
        What drives, and what is driven.

    Raises
    ------
    ReachError
        If the drawing is too wide; the message says how wide it may be.
    Error
        If the file cannot be drawn or an argument does not fit.
    """
    pens = _pens(drawing)
    arm = load_robot(robot) if isinstance(robot, str) else robot
    if start is None:
        if robot != "panda":
            raise ValueRangeError(
                f"start: needed to paint with {arm.name}; only for 'panda' there is a default (dqcontrol robots solve "
                "finds joint angles for a pose of the end effector)"
            )
        start = START
    q = as_array("start", start, (arm.configuration_size,))
    axes, pace = plane_axes("plane", plane), as_positive("speed", speed)
    low, high = box_of(pens)
    extent = high - low

    def placed(scale: float) -> list[PenStroke]:
        return scaled(pens, 0.5 * (low + high), scale, pace)

    def largest(wide: float) -> float:
        """Return the largest scale that is reached and tried, from a width on, or 0."""
        while wide > _NARROWEST:
            if _reached(arm, q, axes, placed(scale := wide / float(extent.max()))):
                return scale
            wide *= _SHRINK
        return 0.0

    if width is not None or Path(drawing).suffix.lower() == ".txt":  # which has a size of its own
        wide = float(extent[0]) if width is None else as_positive("width", width)
        scale = wide / float(extent[0] or extent[1])
        if not _reached(arm, q, axes, placed(scale)):
            best = largest(wide)
            hint = f"at most about {best * extent[0] * 1e3:.0f} mm" if best else "move it: another start"
            raise ReachError(f"width: {1e3 * wide:.0f} mm is more than {arm.name} reaches here; {hint}")
    elif not (scale := largest(_WIDEST)):
        raise ReachError(f"drawing: {arm.name} cannot reach any of it from this start; give another")
    reference, switched = _motion(arm.fkm(q), axes, placed(scale), pace)
    if reference.duration > _LONGEST:
        raise ValueRangeError(
            f"speed: {pace:g} m/s makes a drawing of {reference.duration:.0f} s, at most {_LONGEST:g} s are drawn"
        )
    first = _start_through(arm, reference, arm.solve(reference.at(0.0).pose, q).q, pace)
    limits = CommandLimits(velocity=True)
    record = simulate(arm, reference, law, plant, first, PERIOD, limits=limits)
    lit = np.searchsorted(switched, record.time, side="right") % 2 == 1
    return Painting(record, lit, arm, (scale * float(extent[0]), scale * float(extent[1])))


def _start_through(arm: Robot, reference: Reference, first: Array, pace: float) -> Array:
    """Return a configuration from which the end effector can go all of a drawing: the given one if it can.

    Where none can, it is the given one, and a note says the sample that stops the farthest.
    """
    if arm.configuration_size < FULL_POSE or len(arm.drives):
        return first
    count = math.ceil(reference.duration * pace / _SPACED) + 1
    poses = reference.samples(np.linspace(0.0, reference.duration, count))[:, POSE]
    others = [each.q for each in postures(arm, poses[0])]
    edges = CertifiedEdges(arm, Constraints())
    return start_through([(start, poses) for start in (first, *others)], edges, aside=False)


def _pens(drawing: str | Path) -> tuple[PenStroke, ...]:
    suffix = Path(drawing).suffix.lower()
    if suffix == ".svg":
        return load_svg(drawing)
    if suffix == ".txt":
        return (PenStroke((0.0, 0.0), parse_drawing(read_text(drawing), str(drawing)).strokes),)
    raise FileFormatError(f"{drawing}: expected a .svg or a .txt file, got '{suffix}'")


def _reached(arm: Robot, q: Array, axes: Array, pens: Sequence[PenStroke]) -> bool:
    traces = [(PenPath.of(pen.strokes), pen.start) for pen in pens]
    flat = np.concatenate([of.at(np.linspace(0.0, of.times[-1], 8))[0] + start for of, start in traces])
    flat = flat[np.unique(np.linspace(0, len(flat) - 1, _POSES).astype(int))]
    hand = arm.fkm(q)
    poses = algebra.pose(hand[:4], algebra.translation(hand) + flat @ axes)
    found = arm.solve(poses, q, position_tolerance=_POSITION, orientation_tolerance=_ORIENTATION, restarts=10)
    return bool(np.all(found.success))


def _motion(hand: Array, axes: Array, pens: Sequence[PenStroke], pace: float) -> tuple[InSequence, Array]:
    """Return the motion, and the times at which the lamp is switched on and off in turn."""
    parts, switched, now, pen_at = [], [], 0.0, None
    for pen in pens:
        begin = np.array(pen.start)
        if pen_at is not None and (gap := begin - pen_at) @ gap > 1e-12:
            way = [StraightStroke(float(gap[0]), float(gap[1]), _TRAVEL * pace)]
            parts.append(_part(hand, axes, pen_at, way, _TRAVEL * pace))
            now += parts[-1].duration
        parts.append(_part(hand, axes, begin, pen.strokes, pace))
        switched += [now, now := now + parts[-1].duration]
        pen_at = begin + PenPath.of(pen.strokes).ends()[0][-1]
    return InSequence(parts), np.array(switched)


def _part(hand: Array, axes: Array, begin: Array, strokes: Sequence[Stroke], pace: float) -> JerkLimited:
    origin = algebra.pose(hand[:4], algebra.translation(hand) + begin @ axes)
    drawing = Drawing(origin, strokes, plane=axes)
    return JerkLimited(drawing, velocity=pace, acceleration=_ACCELERATION, jerk=_JERK)
