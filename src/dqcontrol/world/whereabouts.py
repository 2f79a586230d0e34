"""Poses of a body of the world in a run: as it says itself, or as physics moved it and a recording has it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.world.body import Body, Hinge, Slide


def poses_of(name: str, body: Body, times: Array, readings: Mapping[str, Array]) -> Array:
    """Return a body's poses at times (N,), s: unit dual quaternions, shape (N, 8), inertial frame.

    Parameters
    ----------
    name, body
        Of the world.
    times
        s.
    readings
        What was recorded of it, by name, each (N, size); what physics did not move is where it was at the start.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> ball = dqc.world.Body(sphere=0.1, position=(1, 0, 0), moves=dqc.world.Motion(velocity=(0, 0.5, 0)))
    >>> dqc.algebra.translation(poses_of("ball", ball, np.array([0.0, 2.0]), {})).tolist()
    [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    """
    if (body.role == "free" or body.held is not None) and f"{name}_position" in readings:
        return algebra.pose(readings[f"{name}_quaternion"], readings[f"{name}_position"])
    start = np.tile(body.pose, (len(times), 1))
    if body.hinge is not None and f"{name}_angle" in readings:
        return algebra.multiply(start, turned(body.hinge, readings[f"{name}_angle"].reshape(-1)))
    if body.slide is not None and f"{name}_way" in readings:
        return algebra.multiply(start, slid(body.slide, readings[f"{name}_way"].reshape(-1)))
    if body.moves is not None:
        start = algebra.multiply(_shifts(body.moves.shifts(times)), start)
    if f"{name}_displacement" in readings:
        start = algebra.multiply(start, _shifts(readings[f"{name}_displacement"]))
    return start


def turned(hinge: Hinge, angles: Array) -> Array:
    """Return how a body is turned by angles (N,), rad, of its hinge, seen from its start, shape (N, 8)."""
    axis = np.tile(np.asarray(hinge.axis) / np.linalg.norm(hinge.axis), (len(angles), 1))
    there = _shifts(np.tile(hinge.at, (len(angles), 1)))
    turns = algebra.pose(algebra.rotation_from_axis_angle(axis, angles), np.zeros(3))
    return algebra.multiply(algebra.multiply(there, turns), algebra.conjugate(there))


def slid(slide: Slide, ways: Array) -> Array:
    """Return how a body is shifted by ways (N,), m, of its slide, seen from its start, shape (N, 8)."""
    return _shifts(np.outer(ways, np.asarray(slide.axis) / np.linalg.norm(slide.axis)))


def _shifts(ways: Array) -> Array:
    return algebra.pose(np.array([1.0, 0, 0, 0]), ways)
