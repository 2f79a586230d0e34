"""Distances between pairs of shapes along a run, compiled."""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import position, rotated
from dqcontrol.compiled.compile import OK, READ2, STATUS, WRITE, WRITE2, inline, kernel
from dqcontrol.geometry.distance_kernels import (
    ALONG,
    BOX,
    CENTER,
    CORE,
    DISTANCE,
    HULL,
    KIND,
    NORMAL,
    OFFSET,
    PLANE,
    ROTATION,
    ROUND,
    find_distance,
)


# frames of each sample in a row, each shape's frame and its numbers there, pairs of shapes, shifts, scratch, distances
@kernel(STATUS(READ2, READ2, READ2, READ2, WRITE2, WRITE, WRITE2))
def pair_distances(frames, shapes, pairs, shifts, placed, found, out):
    """Write how far the shapes of each pair are apart at each sample, m; infinity where one is not there."""
    for i in range(out.shape[0]):
        for s in range(shapes.shape[0]):
            body, row = shapes[s, 1:], placed[s]
            for k in range(row.shape[0]):
                row[k] = body[k]
            if shapes[s, 0] > 0.0:
                first = 8 * (int(shapes[s, 0]) - 1)
                _move(frames[i, first : first + 8], body, row)
            if shifts.shape[0] > 0:
                _shift(shifts[i, 3 * s], shifts[i, 3 * s + 1], shifts[i, 3 * s + 2], row)
        for p in range(pairs.shape[0]):
            find_distance(placed[int(pairs[p, 0])], placed[int(pairs[p, 1])], found)
            out[i, p] = found[DISTANCE] if found[DISTANCE] == found[DISTANCE] else math.inf
    return OK


@inline
def _move(pose, body, out):
    """Write a ball, capsule or box where a pose takes it."""
    px, py, pz = position(pose)
    at = CORE if body[KIND] == ROUND else CENTER
    out[at], out[at + 1], out[at + 2] = rotated(pose, body[at : at + 3])
    out[at] += px
    out[at + 1] += py
    out[at + 2] += pz
    if body[KIND] == ROUND:
        out[ALONG], out[ALONG + 1], out[ALONG + 2] = rotated(pose, body[ALONG : ALONG + 3])
    else:
        for k in range(ROTATION, ROTATION + 3):
            out[k], out[k + 3], out[k + 6] = rotated(pose, (body[k], body[k + 3], body[k + 6]))


@inline
def _shift(x, y, z, out):
    if out[KIND] == PLANE:
        out[OFFSET] += out[NORMAL] * x + out[NORMAL + 1] * y + out[NORMAL + 2] * z
    else:
        at = CENTER if out[KIND] == BOX or out[KIND] == HULL else CORE
        out[at] += x
        out[at + 1] += y
        out[at + 2] += z
