"""Paths that microcontrollers compute instead of keeping their samples: lines and arcs on a plane, at changing pace.

`Reference.samples` says the same, from NumPy and to rounding; a table of it takes 168 bytes a period.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    multiply,
    position,
    quaternion_product,
    set_pose,
)
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, STATUS, WRITE, inline, kernel, types
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.references.modifiers import Paced, Transformed
from dqcontrol.references.planar import PlanarReference
from dqcontrol.references.reference import SNAP, Reference, begun

_UNMOVED = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


class PathHead(NamedTuple):
    """What a computed path has besides its tables.

    Attributes
    ----------
    pieces, paces, corners
        Rows of the tables.
    duration, inner_duration
        With and without paces, s.
    start, axes, advance
        Of the sheet of paper: its origin at time 0, as a pose, its axes, and how it moves, m/s.
    follow, follow_from
        Whether the end effector turns with its path, 1 or 0, and its yaw at the start, rad.
    displacement
        Of all of it.
    """

    pieces: float
    paces: float
    corners: float
    duration: float
    inner_duration: float
    start: Annotated[Array, 8]
    axes: Annotated[Array, 6]
    advance: Annotated[Array, 3]
    follow: float
    follow_from: float
    displacement: Annotated[Array, 8]


class PathTables(NamedTuple):
    """Begin (s) and numbers of each piece, as of `PenPath`; paces, as of `Paced`; corners with and without paces, s."""

    pieces: Annotated[Array, "pieces", 8]
    paces: Annotated[Array, "paces", 5]
    corners: Annotated[Array, "corners", 2]


path_head: MemoryLayout[PathHead] = MemoryLayout(PathHead)
path_tables: MemoryLayout[PathTables] = MemoryLayout(PathTables, "pieces", "paces", "corners")
_HEAD = path_head.size()


def path_parameters(reference: Reference) -> Array | None:
    """Return what `computed_path` takes for a reference; None if it is no such path."""
    displacement, corners = _UNMOVED, reference.corners
    if isinstance(reference, Transformed):
        displacement, reference = np.asarray(reference.by), reference.reference
    duration, inner, paces = reference.duration, reference, np.zeros((0, 5))
    if isinstance(reference, Paced):
        inner, paces = reference.inner, reference.pieces.T
    if not isinstance(inner, PlanarReference):
        return None
    inner_corners = inner.corners if len(inner.corners) == len(corners) else corners
    trace = inner.trace
    columns = trace.start, trace.heading, trace.speed, trace.turn_rate, trace.yaw, trace.yaw_rate
    head = path_head.pack(
        pieces=len(trace.speed),
        paces=len(paces),
        corners=len(corners),
        duration=duration,
        inner_duration=inner.duration,
        **inner.sheet(),
        displacement=displacement,
    )
    tables = path_tables.pack(
        pieces=np.column_stack([trace.times[:-1], *columns]),
        paces=paces,
        corners=np.column_stack([corners, inner_corners]),
    )
    return np.concatenate([head, tables])


@inline
def _row_before(rows, time):
    """Return the last row that begins at or before a time."""
    return max(begun(rows[:, 0], time) - 1, 0)


@inline
def _paced_time(paces, time):
    """Return the inner time, and its first and second rate."""
    row = paces[_row_before(paces, time)]
    start, inner_start, seconds, before, after = row[0], row[1], row[2], row[3], row[4]
    s, gain = (time - start) / seconds, after - before
    s2 = s * s
    inner = inner_start + seconds * (before * s + gain * s2 * s2 * (2.5 - 3.0 * s + s2))
    rate = before + gain * s2 * s * (10.0 - 15.0 * s + 6.0 * s2)
    return inner, rate, gain * 30.0 * s2 * (1.0 - s) ** 2 / seconds


@inline
def _on_paper(piece, time, head, out):
    """Write the sample of a piece, for the time of the paper."""
    t = time - piece[0]
    speed, rate = piece[4], piece[5]
    heading, middle = piece[3] + rate * t, piece[3] + 0.5 * rate * t
    half = 0.5 * rate * t
    chord = speed * t * (math.sin(half) / half if half != 0.0 else 1.0)
    along, across = math.cos(heading), math.sin(heading)
    x, y = piece[1] + chord * math.cos(middle), piece[2] + chord * math.sin(middle)
    px, py, pz = position(head.start)
    axes, advance, p, v, a = head.axes, head.advance, out[11:14], out[8:11], out[14:17]
    origin = (px, py, pz)
    for i in range(3):
        p[i] = origin[i] + x * axes[i] + y * axes[3 + i] + time * advance[i]
        v[i] = speed * (along * axes[i] + across * axes[3 + i]) + advance[i]
        a[i] = speed * rate * (along * axes[3 + i] - across * axes[i])
    r = (head.start[0], head.start[1], head.start[2], head.start[3])
    place, velocity, acceleration = (p[0], p[1], p[2]), (v[0], v[1], v[2]), (a[0], a[1], a[2])
    wx, wy, wz = 0.0, 0.0, 0.0
    if head.follow != 0.0:
        nx, ny, nz = (
            axes[1] * axes[5] - axes[2] * axes[4],
            axes[2] * axes[3] - axes[0] * axes[5],
            axes[0] * axes[4] - axes[1] * axes[3],
        )
        angle = 0.5 * (piece[6] + piece[7] * t - head.follow_from)
        s = math.sin(angle)
        quaternion_product((math.cos(angle), s * nx, s * ny, s * nz), r, out[0:4])
        r = (out[0], out[1], out[2], out[3])
        wx, wy, wz = piece[7] * nx, piece[7] * ny, piece[7] * nz
    set_pose(r, place, out[0:8])
    w = (wx, wy, wz)
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        out[8 + k] = w[k]
        out[11 + k] = velocity[k] + (place[m] * w[n] - place[n] * w[m])
        out[14 + k] = 0.0
        out[17 + k] = acceleration[k] + (velocity[m] * w[n] - velocity[n] * w[m])


# parameters, time (s), sample (21)
@kernel(STATUS(READ, types.float64, WRITE))
def computed_path(parameters, time, out):
    """Write the sample of a path at a time; beyond its end that of its end."""
    head = path_head(parameters[0:_HEAD])
    tables = path_tables(parameters[_HEAD:], int(head.pieces), int(head.paces), int(head.corners))
    inside = min(max(time, 0.0), head.duration)
    corner = -1
    for k in range(tables.corners.shape[0]):
        if abs(inside - tables.corners[k, 0]) <= SNAP:
            corner = k
    if corner >= 0:
        inside = tables.corners[corner, 0]
    elif head.duration - inside <= SNAP:
        inside = head.duration
    inner, rate, change = inside, 1.0, 0.0
    if tables.paces.shape[0] > 0:
        inner, rate, change = _paced_time(tables.paces, inside)
        if corner >= 0:
            inner = tables.corners[corner, 1]
        inner = min(max(inner, 0.0), head.inner_duration)
    _on_paper(tables.pieces[_row_before(tables.pieces, inner)], inner, head, out)
    for i in range(8, 14):
        out[6 + i] = rate * rate * out[6 + i] + change * out[i]
        out[i] *= rate
    moved = head.displacement
    if moved[0] != 1.0 or moved[5] != 0.0 or moved[6] != 0.0 or moved[7] != 0.0:
        at = (out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7])
        multiply(moved, at, out[0:8])
        for first in (8, 14):
            twist = out[first : first + 6]
            adjoint_twist(moved, twist, twist)
    for i in range(14, 20):
        if corner >= 0 or inside >= head.duration:
            out[i] = 0.0
    for i in range(8, 14):
        if inside >= head.duration:
            out[i] = 0.0
    out[20] = time
    return OK
