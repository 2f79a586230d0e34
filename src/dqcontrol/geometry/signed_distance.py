"""Signed distances between shapes, their Jacobians and their rates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.geometry import distance_kernels as kernels
from dqcontrol.geometry.shapes import Shape


@dataclass(frozen=True, eq=False)
class Distance:
    """How far two shapes are apart, and where.

    Attributes
    ----------
    distance
        Signed distance of the surfaces, m: below zero it is the least motion that separates them.
    normal
        Unit vector from b to a, shape (3,): moving a along it increases the distance as fast as anything can.
    on_a, on_b
        The points of the surfaces where this is so, shape (3,), m: on_a − on_b = distance · normal.
    """

    distance: float
    normal: Array
    on_a: Array
    on_b: Array

    @property
    def row(self) -> Array:
        """The numbers that compiled code takes, shape (10,): distance, normal, point on a and on b."""
        return np.concatenate([[self.distance], self.normal, self.on_a, self.on_b])


def distance(a: Shape, b: Shape) -> Distance:
    """Return the signed distance of two shapes, with its direction and the points where it is measured.

    The distance is exact apart from rounding, in penetration too (of round shapes, and of boxes with boxes, capsules
    and planes). Where several pairs of points are nearest (parallel capsules, a capsule along a face), one of them is
    given. Where the cores of two round shapes cross, the normal is across both cores, or any that is across if there
    are many, and away from the middle of b.

    Parameters
    ----------
    a, b
        Two shapes in one frame.

    Returns
    -------
    Distance
        ``distance``, ``normal``, ``on_a`` and ``on_b``.

    Raises
    ------
    ShapeError
        If one is no shape.
    ValueRangeError
        If both are planes, or one is a plane and the other a line or cylinder that crosses it: those meet somewhere.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm = dqc.geometry.Capsule([0, 0, 0], [0, 0, 1], 0.1)
    >>> found = dqc.geometry.distance(arm, dqc.geometry.Sphere([0.5, 0, 0.5], 0.2))
    >>> round(found.distance, 12), found.normal.tolist(), found.on_b.round(12).tolist()
    (0.2, [-1.0, 0.0, 0.0], [0.3, 0.0, 0.5])
    """
    for field, shape in (("a", a), ("b", b)):
        if not isinstance(shape, Shape):
            raise ShapeError(f"{field}: expected a shape of dqcontrol.geometry, got {shape!r:.80}")
    out = np.empty((1, kernels.FOUND))
    found = kernels.distances(a.row[None], b.row[None], out)
    row = out[0]
    if not found or row[kernels.DISTANCE] == -math.inf:
        raise ValueRangeError(f"a, b: {a} and {b} meet somewhere far away; a Capsule or Box has an end")
    return Distance(
        float(row[kernels.DISTANCE]),
        row[kernels.DIRECTION : kernels.ON_A],
        row[kernels.ON_A : kernels.ON_B],
        row[kernels.ON_B :],
    )


def distance_jacobian(
    found: Distance, jacobian_a: ArrayLike | None = None, jacobian_b: ArrayLike | None = None
) -> Array:
    """Return the row J_d with ḋ = J_d u, for shapes that links carry.

    J_d = n·(J_a(c) − J_b(c)) = (c × n, n)·(J_ω,a − J_ω,b), with the twist Jacobians' columns [ω ; ṗ + p × ω] and any
    point c of the line on which both witness points lie.

    Parameters
    ----------
    found
        What `distance` returned, in the frame of the Jacobians.
    jacobian_a, jacobian_b
        Twist Jacobians, shape (6, m), of the links that carry a and b, as `Robot.twist_jacobian` gives them; columns of
        inputs that do not move the link are zero. None for a shape that no input moves.

    Returns
    -------
    Array
        Shape (m,), m/s per unit of the inputs; ∂d/∂q where these are q̇.

    Raises
    ------
    ShapeError, ValueRangeError
        If both are None, or sizes do not fit.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> hand = dqc.geometry.Sphere([0, 0, 0], 0.05).moved(arm.fkm(q))
    >>> found = dqc.geometry.distance(hand, dqc.geometry.Plane([0, 0, 1], 0.0))
    >>> abs(dqc.geometry.distance_jacobian(found, arm.twist_jacobian(q))).round(3).tolist()
    [0.0, 0.16, 0.0, 0.386, 0.0, 0.049, 0.0]
    """
    given = [
        (sign, as_array(field, value, (6, None)))
        for sign, field, value in ((1, "jacobian_a", jacobian_a), (-1, "jacobian_b", jacobian_b))
        if value is not None
    ]
    shapes = {jacobian.shape for _, jacobian in given}
    if len(shapes) != 1 or any(len(shape) != 2 for shape in shapes):
        raise ShapeError(
            "jacobian_a, jacobian_b: expected one shape (6, m), of one or both, got "
            f"{', '.join(map(str, shapes)) or 'none'}"
        )
    row = np.zeros(given[0][1].shape[1])
    for sign, jacobian in given:
        kernels.distance_row(found.row, sign, np.ascontiguousarray(jacobian), row)
    return row


def distance_rate(
    found: Distance, twist_a: ArrayLike | None = None, twist_b: ArrayLike | None = None
) -> float:
    """Return ḋ = n·(v_a(c) − v_b(c)), m/s, of shapes that move by themselves: the residual of moving obstacles.

    Parameters
    ----------
    found
        What `distance` returned.
    twist_a, twist_b
        Twists [ω ; ṗ + p × ω] of the bodies, shape (6,), in the same frame; None stands still. One that only slides
        has [0, 0, 0, vx, vy, vz].

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong or a value is not finite.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> found = dqc.geometry.distance(dqc.geometry.Point([0, 0, 0]), dqc.geometry.Sphere([1, 0, 0], 0.2))
    >>> dqc.geometry.distance_rate(found, twist_b=[0, 0, 0, -0.3, 0, 0])  # the ball comes nearer
    -0.3
    """
    rate = 0.0
    for sign, field, twist in ((1, "twist_a", twist_a), (-1, "twist_b", twist_b)):
        if twist is not None:
            value = as_array(field, twist, (6,))
            if value.ndim != 1:
                raise ShapeError(f"{field}: expected shape (6,), got {value.shape}")
            rate += sign * float(np.cross(found.on_a, found.normal) @ value[:3] + found.normal @ value[3:])
    return rate
