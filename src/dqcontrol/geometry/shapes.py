"""Points, lines, planes, spheres, cylinders, capsules, boxes and hulls: bodies that keep their form; their distances.

All lengths are in m, in whatever frame their owner says; `moved` carries a shape from a frame into another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.geometry import distance_kernels as kernels


@dataclass(frozen=True, eq=False, repr=False)
class Shape:
    """A shape in space; `distance` takes any two."""

    _positions: ClassVar[tuple[str, ...]] = ()  # fields that a motion turns and shifts,
    _directions: ClassVar[tuple[str, ...]] = ()  # that it only turns, unit vectors,
    _lengths: ClassVar[tuple[str, ...]] = ()  # and that it leaves alone, ≥ 0

    def __post_init__(self) -> None:
        for name in self._positions:
            _keep(self, name)
        for name in self._directions:
            _keep_direction(self, name)
        for name in self._lengths:
            object.__setattr__(self, name, as_positive(name, getattr(self, name), zero_allowed=True))

    def moved(self, pose: ArrayLike) -> Self:
        """Return the shape where a pose takes it: from the frame of the link that carries it to the inertial frame.

        Parameters
        ----------
        pose
            Unit dual quaternion (8,).

        Raises
        ------
        ShapeError, ValueRangeError
            If it is not one.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> ball = dqc.geometry.Sphere([0, 0, 0.1], 0.05)
        >>> ball.moved(dqc.DualQuaternion.from_translation([1, 0, 0])).center.tolist()
        [1.0, 0.0, 0.1]
        """
        return self._carried(_one_pose(pose))

    def _carried(self, pose: Array) -> Self:
        matrix = algebra.matrix_from_pose(pose)
        rotation, position = matrix[:3, :3], matrix[:3, 3]
        positions = {name: rotation @ getattr(self, name) + position for name in self._positions}
        directions = {name: rotation @ getattr(self, name) for name in self._directions}
        return replace(self, **positions, **directions)

    @cached_property
    def row(self) -> Array:
        """The numbers that compiled code takes, shape (16,): ``geometry.distance_kernels`` says which."""
        row = np.zeros(kernels.SHAPE)
        self._fill(row)
        row.flags.writeable = False
        return row

    def _fill(self, row: Array) -> None:
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Shape) and type(self) is type(other) and np.array_equal(self.row, other.row)

    def __hash__(self) -> int:
        return hash((type(self), self.row.tobytes()))

    def __repr__(self) -> str:
        parts = (f"{each.name}={_text(getattr(self, each.name))}" for each in fields(self))
        return f"{type(self).__name__}({', '.join(parts)})"


@dataclass(frozen=True, eq=False, repr=False)
class Point(Shape):
    """A point.

    Parameters
    ----------
    position
        Shape (3,), m.
    """

    position: Array
    _positions = ("position",)

    def _fill(self, row: Array) -> None:
        row[kernels.CORE : kernels.CORE + 3] = self.position


@dataclass(frozen=True, eq=False, repr=False)
class Sphere(Shape):
    """A ball.

    Parameters
    ----------
    center
        Shape (3,), m.
    radius
        m, ≥ 0.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.
    """

    center: Array
    radius: float
    _positions, _lengths = ("center",), ("radius",)

    def _fill(self, row: Array) -> None:
        row[kernels.CORE : kernels.CORE + 3] = self.center
        row[kernels.RADIUS] = self.radius


@dataclass(frozen=True, eq=False, repr=False)
class Capsule(Shape):
    """All points within a radius of a segment; a sphere where its ends are one point.

    Parameters
    ----------
    start, end
        Ends of the segment, shape (3,), m: centres of the two half spheres.
    radius
        m, ≥ 0.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.
    """

    start: Array
    end: Array
    radius: float
    _positions, _lengths = ("start", "end"), ("radius",)

    @property
    def volume(self) -> float:
        """π r² (|end − start| + 4/3 r), m³."""
        length = float(np.linalg.norm(self.end - self.start))
        return np.pi * self.radius**2 * (length + 4 / 3 * self.radius)

    def _fill(self, row: Array) -> None:
        _fill_segment(row, self.start, self.end)
        row[kernels.RADIUS] = self.radius


@dataclass(frozen=True, eq=False, repr=False)
class Line(Shape):
    """An infinite line.

    Parameters
    ----------
    point
        Any of its points, shape (3,), m.
    direction
        Shape (3,), not zero; made a unit vector.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> print(dqc.geometry.Line([0, 1, 0], [2, 0, 0]).dual_quaternion)
    1i + ε(-1k)
    """

    point: Array
    direction: Array
    _positions, _directions = ("point",), ("direction",)

    @property
    def dual_quaternion(self) -> algebra.DualQuaternion:
        """Plücker line l + εm, m = p × l; a motion x takes it to x (l + εm) x*."""
        moment = np.cross(self.point, self.direction)
        return algebra.DualQuaternion([0.0, *self.direction, 0.0, *moment])

    def _fill(self, row: Array) -> None:
        _fill_line(row, self.point, self.direction)


@dataclass(frozen=True, eq=False, repr=False)
class Cylinder(Shape):
    """A solid cylinder with flat ends.

    Parameters
    ----------
    start, end
        Middles of its ends, shape (3,), m, not the same.
    radius
        m, ≥ 0.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> can = dqc.geometry.Cylinder([0, 0, 0], [0, 0, 1], 0.1)
    >>> round(dqc.geometry.distance(dqc.geometry.Sphere([0.4, 0, 1.4], 0.1), can).distance, 9)  # from its rim
    0.4
    """

    start: Array
    end: Array
    radius: float
    _positions, _lengths = ("start", "end"), ("radius",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if float(np.linalg.norm(self.end - self.start)) < 1e-12:
            raise ValueRangeError(f"end: must not be the start, got {self.end.tolist()}")

    def _fill(self, row: Array) -> None:
        row[kernels.KIND] = kernels.CYLINDER
        _fill_segment(row, self.start, self.end)
        row[kernels.RADIUS] = self.radius


@dataclass(frozen=True, eq=False, repr=False)
class InfiniteCylinder(Shape):
    """An infinite cylinder: all points within a radius of a line.

    Parameters
    ----------
    point, direction
        Of its axis, as of a `Line`.
    radius
        m, ≥ 0.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.
    """

    point: Array
    direction: Array
    radius: float
    _positions, _directions, _lengths = ("point",), ("direction",), ("radius",)

    def _fill(self, row: Array) -> None:
        _fill_line(row, self.point, self.direction)
        row[kernels.RADIUS] = self.radius


@dataclass(frozen=True, eq=False, repr=False)
class Plane(Shape):
    """A plane with a free side: n·p ≥ offset is free, the half-space behind it is solid.

    Parameters
    ----------
    normal
        n towards the free side, shape (3,), not zero.
    offset
        m if n is a unit vector. Otherwise both are divided by its length, which leaves the free side what it was.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> table = dqc.geometry.Plane([0, 0, 1], 0.4)
    >>> round(dqc.geometry.distance(dqc.geometry.Sphere([0, 0, 1], 0.1), table).distance, 12)
    0.5
    """

    normal: Array
    offset: float

    def __post_init__(self) -> None:
        length = _keep_direction(self, "normal")
        object.__setattr__(self, "offset", float(as_array("offset", self.offset, ())) / length)

    @property
    def dual_quaternion(self) -> algebra.DualQuaternion:
        """Plane n + ε offset; a motion x = P + εD takes it to x♯ (n + ε offset) x*, x♯ = P − εD."""
        return algebra.DualQuaternion([0.0, *self.normal, self.offset, 0.0, 0.0, 0.0])

    @property
    def axes(self) -> Array:
        """Rotation matrix (3, 3) whose z is the normal; x and y lie in the plane."""
        first = np.cross(self.normal, np.eye(3)[int(np.argmin(np.abs(self.normal)))]).astype(np.float64)
        first /= np.linalg.norm(first)
        return np.column_stack([first, np.cross(self.normal, first), self.normal])

    def _carried(self, pose: Array) -> Self:
        matrix = algebra.matrix_from_pose(pose)
        normal = matrix[:3, :3] @ self.normal
        return type(self)(normal, self.offset + float(normal @ matrix[:3, 3]))

    def _fill(self, row: Array) -> None:
        row[kernels.KIND], row[kernels.OFFSET] = kernels.PLANE, self.offset
        row[kernels.NORMAL : kernels.NORMAL + 3] = self.normal


HalfSpace = Plane  # the solid behind a plane and the plane with a free side are one thing


@dataclass(frozen=True, eq=False, repr=False)
class Box(Shape):
    """A solid box.

    Parameters
    ----------
    pose
        Unit dual quaternion (8,) of its middle.
    size
        Its edges along the axes of the pose, shape (3,), m, > 0.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.
    """

    pose: Array
    size: Array

    def __post_init__(self) -> None:
        _keep_pose(self)
        _keep(self, "size")
        if (self.size <= 0).any():
            raise ValueRangeError(f"size: must be > 0, got {self.size.tolist()}")

    def _carried(self, pose: Array) -> Self:
        return type(self)(algebra.multiply(pose, self.pose), self.size)

    def _fill(self, row: Array) -> None:
        matrix = algebra.matrix_from_pose(self.pose)
        row[kernels.KIND] = kernels.BOX
        row[kernels.HALF : kernels.HALF + 3] = 0.5 * self.size
        row[kernels.CENTER : kernels.CENTER + 3] = matrix[:3, 3]
        row[kernels.ROTATION :] = matrix[:3, :3].ravel()


@dataclass(frozen=True, eq=False, repr=False)
class Hull(Shape):
    """The convex hull of points, solid.

    Parameters
    ----------
    pose
        Unit dual quaternion (8,) of the frame of the points.
    points
        Shape (N, 3), m, not all in one plane; those inside are dropped.

    Attributes
    ----------
    faces
        Numbers of the three corners of each triangle of its surface, shape (F, 3); they turn left as seen from outside.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape or a value is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> wedge = dqc.geometry.Hull([1, 0, 0, 0, 0, 0, 0, 0], [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> round(dqc.geometry.distance(dqc.geometry.Sphere([1, 1, 1], 0.1), wedge).distance, 9)  # (3 − 1)/√3 − 0.1
    1.054700538
    """

    pose: Array
    points: Array
    faces: NDArray[np.intp] = field(init=False)

    def __post_init__(self) -> None:
        from scipy.spatial import ConvexHull, QhullError

        _keep_pose(self)
        given = as_array("points", self.points, (None, 3))
        if given.ndim != 2:
            raise ShapeError(f"points: expected shape (N, 3), got {given.shape}")
        try:
            hull = ConvexHull(given)
        except (QhullError, ValueError):
            raise ValueRangeError(f"points: {len(given)} of them span no volume") from None
        faces = np.searchsorted(hull.vertices, hull.simplices)
        _freeze(self, "points", given[hull.vertices])
        a, b, c = (self.points[faces[:, k]] for k in range(3))
        inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
        faces[inward] = faces[inward][:, ::-1]
        object.__setattr__(self, "faces", faces)

    @property
    def corners(self) -> Array:
        """Its corners in the frame of the pose's, shape (N, 3), m."""
        matrix = algebra.matrix_from_pose(self.pose)
        return self.points @ matrix[:3, :3].T + matrix[:3, 3]

    def _carried(self, pose: Array) -> Self:
        found = object.__new__(type(self))
        _freeze(found, "pose", algebra.as_unit("pose", algebra.multiply(pose, self.pose)))
        object.__setattr__(found, "points", self.points)
        object.__setattr__(found, "faces", self.faces)
        return found

    @cached_property
    def row(self) -> Array:
        """The numbers that compiled code takes, shape (16 + 3 N,), corners in the axes of the pose last."""
        row = np.concatenate([np.zeros(kernels.SHAPE), self.points.ravel()])
        matrix = algebra.matrix_from_pose(self.pose)
        row[kernels.KIND] = kernels.HULL
        row[kernels.FIRST_CORNER], row[kernels.CORNERS] = kernels.SHAPE, len(self.points)
        row[kernels.EXTENT] = np.linalg.norm(self.points, axis=1).max()
        row[kernels.CENTER : kernels.CENTER + 3] = matrix[:3, 3]
        row[kernels.ROTATION : kernels.SHAPE] = matrix[:3, :3].ravel()
        row.flags.writeable = False
        return row

    def __repr__(self) -> str:
        return f"Hull(pose={_text(self.pose)}, points={len(self.points)})"


def _freeze(shape: Shape, field: str, value: Array) -> None:
    value = value.copy()
    value.flags.writeable = False
    object.__setattr__(shape, field, value)


def _one_pose(pose: ArrayLike) -> Array:
    x = as_array("pose", pose, (8,))
    if x.ndim != 1:
        raise ShapeError(f"pose: expected one pose, shape (8,), got {x.shape}")
    return x


def _keep_pose(shape: Box | Hull) -> None:
    _freeze(shape, "pose", algebra.as_unit("pose", _one_pose(shape.pose)))


def _keep(shape: Shape, field: str) -> None:
    value = as_array(field, getattr(shape, field), (3,))
    if value.ndim != 1:
        raise ShapeError(f"{field}: expected shape (3,), got {value.shape}")
    _freeze(shape, field, value)


def _keep_direction(shape: Shape, field: str) -> float:
    """Make a direction a unit vector, and return the length that it had."""
    _keep(shape, field)
    value = getattr(shape, field)
    length = float(np.linalg.norm(value))
    if length < 1e-12:
        raise ValueRangeError(f"{field}: must not be zero, got {value.tolist()}")
    _freeze(shape, field, value / length)
    return length


def _fill_segment(row: Array, start: Array, end: Array) -> None:
    row[kernels.CORE : kernels.CORE + 3] = start
    row[kernels.ALONG : kernels.ALONG + 3] = end - start
    row[kernels.LAST] = 1.0


def _fill_line(row: Array, point: Array, direction: Array) -> None:
    row[kernels.CORE : kernels.CORE + 3] = point
    row[kernels.ALONG : kernels.ALONG + 3] = direction
    row[kernels.FIRST], row[kernels.LAST] = -np.inf, np.inf


def _text(value: Array | float) -> str:
    if isinstance(value, np.ndarray):
        return "[" + ", ".join(f"{number:.6g}" for number in value) + "]"
    return f"{value:.6g}"


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
    for name, shape in (("a", a), ("b", b)):
        if not isinstance(shape, Shape):
            raise ShapeError(f"{name}: expected a shape of dqcontrol.geometry, got {shape!r:.80}")
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
    for sign, name, twist in ((1, "twist_a", twist_a), (-1, "twist_b", twist_b)):
        if twist is not None:
            value = as_array(name, twist, (6,))
            if value.ndim != 1:
                raise ShapeError(f"{name}: expected shape (6,), got {value.shape}")
            rate += sign * float(np.cross(found.on_a, found.normal) @ value[:3] + found.normal @ value[3:])
    return rate
