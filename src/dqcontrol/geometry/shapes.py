"""Points, lines, planes, spheres, cylinders, capsules, boxes and hulls: numbers of a body that keeps its form.

All lengths are in m, in whatever frame their owner says; `moved` carries a shape from a frame into another.
"""

from __future__ import annotations

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
        x = as_array("pose", pose, (8,))
        if x.ndim != 1:
            raise ShapeError(f"pose: expected one pose, shape (8,), got {x.shape}")
        return self._carried(x)

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


def _keep_pose(shape: Box | Hull) -> None:
    x = as_array("pose", shape.pose, (8,))
    if x.ndim != 1:
        raise ShapeError(f"pose: expected one pose, shape (8,), got {x.shape}")
    _freeze(shape, "pose", algebra.as_unit("pose", x))


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
