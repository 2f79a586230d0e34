"""Dual quaternions that read like the papers, with logarithms, exponentials, powers and screw interpolation.

Three pairs exist and must not be mixed. The screw pair is the group's own: powers, interpolation, integration
of twists. The body pair decouples rotation and body-frame position, as feedback linearisation needs it. The
inertial pair is the one that DQ Robotics calls ``log`` and ``exp``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from numbers import Real
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import conversions, dual_quaternion_kernels as kernels, functions
from dqcontrol.algebra.functions import apply, as_unit, broadcast_lead, index_of
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, ShapeError, ValueRangeError, as_array


def log_screw(x: ArrayLike) -> Array:
    """Return the group logarithm [a ; ½V⁻¹(2a)p] of poses: half the twist that reaches x in one second.

    Parameters
    ----------
    x
        Unit dual quaternions, shape (…, 8), m. x and −x have different logarithms; see `short`.

    Returns
    -------
    Array
        Shape (…, 6): half-angle vector a (|a| ≤ π, rad) and dual part (m).

    Raises
    ------
    ShapeError, ValueRangeError
        If x is not (…, 8), not finite, not unit, or has rotation −1, where every axis would do.

    Examples
    --------
    >>> log_screw([1.0, 0, 0, 0, 0, 0.5, 0, 0]).tolist()
    [0.0, 0.0, 0.0, 0.5, 0.0, 0.0]
    """
    return _log(kernels.log_screw, x)


def exp_screw(g: ArrayLike) -> Array:
    """Return the group exponential, shape (…, 8), of g, shape (…, 6), where the twist 2g leads in 1 s.

    Raises `ShapeError` or `ValueRangeError` if g is not (…, 6) or not finite.
    """
    return _exp(kernels.exp_screw, g)


def log_body(x: ArrayLike) -> Array:
    """Return the decoupled logarithm [a ; ½p_b], shape (…, 6), of poses (…, 8) [S17 3.13, with p_b for p].

    Raises the errors of `log_screw`.
    """
    return _log(kernels.log_body, x)


def exp_body(g: ArrayLike) -> Array:
    """Return P + εP g_D with P = exp(g_P), shape (…, 8), for g of shape (…, 6): the inverse of `log_body`.

    Raises `ShapeError` or `ValueRangeError` if g is not (…, 6) or not finite.
    """
    return _exp(kernels.exp_body, g)


def log_inertial(x: ArrayLike) -> Array:
    """Return the decoupled logarithm [a ; ½p], shape (…, 6), of poses (…, 8) [S17 3.13].

    Raises the errors of `log_screw`.
    """
    return _log(kernels.log_inertial, x)


def exp_inertial(g: ArrayLike) -> Array:
    """Return P + εg_D P with P = exp(g_P), shape (…, 8), of g, shape (…, 6): the inverse of `log_inertial`.

    Raises `ShapeError` or `ValueRangeError` if g is not (…, 6) or not finite.
    """
    return _exp(kernels.exp_inertial, g)


def power(x: ArrayLike, t: ArrayLike) -> Array:
    """Return the group power x^t = exp_screw(t log_screw x); power(x, 2) = x x.

    Parameters
    ----------
    x
        Unit dual quaternions, shape (…, 8), m.
    t
        Exponents, a number or shape (…); broadcast against the leading axes of x.

    Returns
    -------
    Array
        Shape (…, 8).

    Raises
    ------
    ShapeError, ValueRangeError
        As for `log_screw`; or if t is not finite or does not broadcast.

    Examples
    --------
    >>> power([1.0, 0, 0, 0, 0, 0.5, 0, 0], [0.0, 3.0])[:, 5].tolist()
    [0.0, 1.5]
    """
    return _defined(apply(kernels.power, 8, x=as_unit("x", x), t=as_array("t", t)[..., None]))


def sclerp(x1: ArrayLike, x2: ArrayLike, t: ArrayLike) -> Array:
    """Return x1 short(x1* x2)^t: screw interpolation with constant twist, the short way round.

    Parameters
    ----------
    x1, x2
        Unit dual quaternions at t = 0 and t = 1, shape (…, 8), m.
    t
        A number or shape (…); broadcast against the leading axes. Beyond [0, 1] the screw continues.

    Returns
    -------
    Array
        Shape (…, 8). At t = 1 this is x2 or −x2, the same pose.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite, or x1 or x2 not unit.

    Examples
    --------
    >>> sclerp([1.0, 0, 0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0.5, 0, 0], 0.5)[5].item()
    0.25
    """
    return apply(kernels.sclerp, 8, x1=as_unit("x1", x1), x2=as_unit("x2", x2), t=as_array("t", t)[..., None])


def _log(operation: Any, x: ArrayLike) -> Array:
    return _defined(apply(operation, 6, x=as_unit("x", x)))


def _exp(operation: Any, g: ArrayLike) -> Array:
    return apply(operation, 8, g=as_array("g", g, (6,)))


def _defined(out: Array) -> Array:
    """Raise where the logarithm does not exist."""
    bad = np.isnan(out[..., 0])
    if bad.any():
        raise ValueRangeError(
            f"x: rotation −1 (a full turn){index_of(bad)} has no logarithm, since every axis would do; "
            "use short(x), the same pose"
        )
    return out


_SHOWN_AS_ZERO = 5e-13  # rounding of poses of some metres; printed with 12 digits
_UNITS = ("", "i", "j", "k")


def as_number(value: Any) -> float | None:
    """Return a real number, or None for a foreign type; arrays are refused: they might mean coefficients."""
    if isinstance(value, Real | np.ndarray) and not getattr(value, "ndim", 0):
        return float(as_array("number", np.asarray(value), ()))
    if isinstance(value, np.ndarray | list | tuple):
        raise ShapeError(
            f"operand: expected a number or a DualQuaternion, got an array of shape {np.shape(value)}; "
            "make coefficients a DualQuaternion(…), or compute with .vec8"
        )
    return None


def coefficients(value: Any) -> Array | None:
    """Return the coefficients of a DualQuaternion or of a real number, or None for a foreign type."""
    if hasattr(value, "vec8"):
        return np.asarray(value)
    number = as_number(value)
    return None if number is None else np.array([number, 0.0, 0, 0, 0, 0, 0, 0])


def add(a: Array, b: Array) -> Array:
    """Return the sum of two batches."""
    broadcast_lead(a=a, b=b)
    return a + b


def close(a: Array, b: Array, tolerance: float) -> NDArray[np.bool_]:
    """Return where all 8 coefficients agree, relative to the largest of them where that exceeds 1."""
    broadcast_lead(value=a, other=b)
    scale = np.maximum(1.0, np.maximum(np.abs(a).max(axis=-1), np.abs(b).max(axis=-1)))
    return np.abs(a - b).max(axis=-1) <= tolerance * scale


def text(x: Array) -> str:
    """Return one dual quaternion as in the papers: ``0.7 + 0.7i + ε(0.1j)``."""
    primary, dual = _quaternion_text(x[:4]), _quaternion_text(x[4:])
    if not dual:
        return primary or "0"
    return f"{primary} + ε({dual})" if primary else f"ε({dual})"


def batch_text(x: Array, shown: int = 6) -> str:
    """Return the first few of a batch, one a line, or one dual quaternion."""
    if x.ndim == 1:
        return text(x)
    lines = [batch_text(row, shown).replace("\n", "\n ") for row in x[:shown]]
    return "[" + ",\n ".join(lines + ["…"] * (len(x) > shown)) + "]"


def _quaternion_text(q: Array) -> str:
    out = ""
    for value, unit in zip(q, _UNITS, strict=True):
        if abs(value) >= _SHOWN_AS_ZERO:
            sign = (" - " if value < 0 else " + ") if out else ("-" if value < 0 else "")
            out += f"{sign}{abs(value):.6g}{unit}"
    return out


def pose_markdown(x: Any) -> str | None:
    """Return what notebooks show of a `DualQuaternion`: position and turn of a pose; None if it is no single pose."""
    if x.batch_shape:
        return None
    try:
        (axis, angle), place = x.axis_angle(), x.translation
    except Error:  # not of unit norm
        return None
    p, n = (", ".join(f"{value + 0.0:.4g}" for value in vector.round(6)) for vector in (place, axis))
    return f"pose: position ({p}) m, turned by {np.rad2deg(angle):.4g}° about ({n})"


TOLERANCE = 1e-12  # of comparisons, relative to the largest coefficient where that exceeds 1


class DualQuaternion:
    """A dual quaternion P + εD, or a batch of them.

    Memory layout: float64, C order, read-only, shape (…, 8); the last axis is ``[P, D]``, each quaternion
    scalar first: ``[Pw, Px, Py, Pz, Dw, Dx, Dy, Dz]``. Leading axes are the batch. A pose is x = r + ε½pr
    with the rotation r as a unit quaternion and the position p (m) in the inertial frame; x and −x are the
    same pose.

    ``x * y`` is the product, ``x**t`` the group power of a pose, ``==`` a comparison within 1e-12 that tells
    x from −x (`same_pose` does not). A number added counts as real part. NumPy sees the coefficients.

    Parameters
    ----------
    vec8
        Coefficients, shape (…, 8); copied.

    Raises
    ------
    ShapeError, ValueRangeError
        If the shape is not (…, 8) or a coefficient is not finite. What needs a pose (rotation, translation,
        log, power, matrix, …) raises `ValueRangeError`, naming the norm, where this is not unit.

    Examples
    --------
    >>> import numpy as np
    >>> x = DualQuaternion.from_axis_angle([0, 0, 1], np.pi / 2, translation=[1, 0, 0])
    >>> (x * x).translation.round(12).tolist()
    [1.0, 1.0, 0.0]
    >>> x**2 == x * x
    True
    >>> print(x.conj() * x)
    1
    """

    __slots__ = ("_data",)
    __array_priority__: float = 1000.0  # array * x calls x.__rmul__
    __hash__: ClassVar[None] = None  # type: ignore[assignment]  # equality has a tolerance

    _data: Array

    def __init__(self, vec8: ArrayLike) -> None:
        self._data = np.array(as_array("vec8", vec8, (8,)), order="C")
        self._data.flags.writeable = False

    @classmethod
    def identity(cls, batch_shape: tuple[int, ...] = ()) -> DualQuaternion:
        """Return 1, the pose that moves nothing."""
        return _wrap(np.broadcast_to([1.0, 0, 0, 0, 0, 0, 0, 0], (*batch_shape, 8)).copy())

    @classmethod
    def from_pose(cls, rotation: ArrayLike, translation: ArrayLike) -> DualQuaternion:
        """Return r + ε½pr of unit quaternions (…, 4), scalar first, and positions (…, 3), m."""
        return _wrap(conversions.pose(rotation, translation))

    @classmethod
    def from_translation(cls, translation: ArrayLike) -> DualQuaternion:
        """Return 1 + ε½p of positions (…, 3), m."""
        return cls.from_pose([1.0, 0, 0, 0], translation)

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> DualQuaternion:
        """Return poses of homogeneous (…, 4, 4) or rotation matrices (…, 3, 3), real part ≥ 0."""
        values = as_array("matrix", matrix)
        if values.shape[-2:] == (3, 3):
            return cls.from_pose(conversions.rotation_from_matrix(values), np.zeros(3))
        return _wrap(conversions.pose_from_matrix(values))

    @classmethod
    def from_axis_angle(
        cls, axis: ArrayLike, angle: ArrayLike, translation: ArrayLike = (0.0, 0, 0)
    ) -> DualQuaternion:
        """Return poses turned by angles (…), rad, about axes (…, 3), at positions (…, 3), m."""
        return cls.from_pose(conversions.rotation_from_axis_angle(axis, angle), translation)

    @classmethod
    def from_rpy(cls, angles: ArrayLike, translation: ArrayLike = (0.0, 0, 0)) -> DualQuaternion:
        """Return the pose with (roll, pitch, yaw) (…, 3), rad: R = Rz(yaw) Ry(pitch) Rx(roll)."""
        return cls.from_pose(conversions.rotation_from_rpy(angles), translation)

    @classmethod
    def unvec(cls, v: ArrayLike) -> DualQuaternion:
        """Return the dual quaternion whose vec3, vec4, vec6 or vec8 is v, told apart by the last axis."""
        return _wrap(functions.unvec(v))

    @property
    def vec8(self) -> Array:
        """Coefficients [P, D], shape (…, 8), read-only."""
        return self._data

    @property
    def P(self) -> Array:  # noqa: N802 - the papers' name
        """Primary part, shape (…, 4), read-only."""
        return self._data[..., :4]

    @property
    def D(self) -> Array:  # noqa: N802 - the papers' name
        """Dual part, shape (…, 4), read-only."""
        return self._data[..., 4:]

    @property
    def vec6(self) -> Array:
        """[Im P ; Im D], shape (…, 6), of a pure dual quaternion."""
        return functions.vec6(self._data)

    @property
    def vec4(self) -> Array:
        """P, shape (…, 4), of a quaternion (D = 0)."""
        return functions.vec4(self._data)

    @property
    def vec3(self) -> Array:
        """Im P, shape (…, 3), of a pure quaternion."""
        return functions.vec3(self._data)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Shape of the batch; () for one."""
        return self._data.shape[:-1]

    @property
    def rotation(self) -> Array:
        """Rotation r of a pose as unit quaternion, scalar first, shape (…, 4)."""
        return functions.rotation(self._data)

    @property
    def translation(self) -> Array:
        """Position p = 2DP* of a pose in the inertial frame, shape (…, 3), m."""
        return functions.translation(self._data)

    @property
    def body_translation(self) -> Array:
        """Position p_b = 2P*D of a pose in its own frame, shape (…, 3), m."""
        return functions.body_translation(self._data)

    def matrix(self) -> Array:
        """Return the homogeneous matrices [R p; 0 1] of a pose, shape (…, 4, 4)."""
        return conversions.matrix_from_pose(self._data)

    def axis_angle(self) -> tuple[Array, Array]:
        """Return unit axes (…, 3) and angles (…) in [0, π], rad, of a pose's rotation."""
        return conversions.axis_angle_from_rotation(self.rotation)

    def rpy(self) -> Array:
        """Return (roll, pitch, yaw) of a pose's rotation, shape (…, 3), rad."""
        return conversions.rpy_from_rotation(self.rotation)

    def norm(self) -> Array:
        """Return the dual number |P| + ε⟨P, D⟩/|P| as shape (…, 2)."""
        return functions.norm(self._data)

    def conj(self) -> DualQuaternion:
        """Return x*; for a pose its inverse."""
        return _wrap(functions.conjugate(self._data))

    def inverse(self) -> DualQuaternion:
        """Return x⁻¹; `ValueRangeError` if P = 0."""
        return _wrap(functions.inverse(self._data))

    def renormalise(self) -> DualQuaternion:
        """Return the nearest unit dual quaternion; `ValueRangeError` if P = 0."""
        return _wrap(functions.renormalise(self._data))

    def short(self) -> DualQuaternion:
        """Return x or −x, whichever has Re P ≥ 0: the same pose, the short way round."""
        return _wrap(functions.short(self._data))

    def log(self) -> DualQuaternion:
        """Return the screw logarithm of a pose, a pure dual quaternion; `ValueRangeError` at rotation −1."""
        return _wrap(functions.unvec(log_screw(self._data)))

    def exp(self) -> DualQuaternion:
        """Return the screw exponential of a pure dual quaternion, a pose."""
        return _wrap(exp_screw(self.vec6))

    def adjoint(self, other: ArrayLike) -> DualQuaternion:
        """Return Ad(x) y = x y x*."""
        return _wrap(functions.adjoint(self._data, other))

    def cross(self, other: ArrayLike) -> DualQuaternion:
        """Return (ab − ba)/2 of pure dual quaternions."""
        return _wrap(functions.cross(self._data, other))

    def dot(self, other: ArrayLike) -> DualQuaternion:
        """Return −(ab + ba)/2 of pure dual quaternions, a dual number."""
        return _wrap(functions.dot(self._data, other))

    def sclerp(self, other: ArrayLike, t: ArrayLike) -> DualQuaternion:
        """Return the pose on the screw from this (t = 0) to the other (t = 1); t, shape (…), broadcasts."""
        return _wrap(sclerp(self._data, other, t))

    def __mul__(self, other: Any) -> DualQuaternion:
        if isinstance(other, DualQuaternion):
            return _wrap(functions.multiply(self._data, other._data))
        number = as_number(other)
        return _wrap(self._data * number) if number is not None else NotImplemented

    __rmul__ = __mul__  # reached by numbers only

    def __truediv__(self, other: Any) -> DualQuaternion:
        number = as_number(other)
        if number == 0:
            raise ValueRangeError("division: a dual quaternion cannot be divided by 0")
        return _wrap(self._data / number) if number is not None else NotImplemented

    def __add__(self, other: Any) -> DualQuaternion:
        term = coefficients(other)
        return _wrap(add(self._data, term)) if term is not None else NotImplemented

    def __sub__(self, other: Any) -> DualQuaternion:
        term = coefficients(other)
        return _wrap(add(self._data, -term)) if term is not None else NotImplemented

    def __rsub__(self, other: Any) -> DualQuaternion:
        return -self + other

    __radd__ = __add__

    def __neg__(self) -> DualQuaternion:
        return _wrap(-self._data)

    def __pow__(self, t: ArrayLike) -> DualQuaternion:
        if isinstance(t, DualQuaternion):
            return NotImplemented
        return _wrap(power(self._data, t))

    def __eq__(self, other: object) -> Any:
        if isinstance(other, Real):
            y = np.broadcast_to(np.asarray(coefficients(other)), self._data.shape)
        elif isinstance(other, DualQuaternion | np.ndarray):
            y = np.asarray(other)
        else:
            return NotImplemented
        return y.shape == self._data.shape and bool(np.all(close(self._data, y, TOLERANCE)))

    def isclose(self, other: ArrayLike, tolerance: float = TOLERANCE) -> NDArray[np.bool_]:
        """Return where all coefficients agree, shape (…); x and −x differ."""
        return close(self._data, as_array("other", other, (8,)), tolerance)

    def same_pose(self, other: ArrayLike, tolerance: float = TOLERANCE) -> NDArray[np.bool_]:
        """Return where both are the same pose, shape (…); x and −x are."""
        y = as_array("other", other, (8,))
        return close(self._data, y, tolerance) | close(self._data, -y, tolerance)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self._data, dtype=dtype, copy=copy)

    def __len__(self) -> int:
        if not self.batch_shape:
            raise TypeError("a single DualQuaternion has no length; its coefficients are in .vec8")
        return self.batch_shape[0]

    def __getitem__(self, index: Any) -> DualQuaternion:
        if not self.batch_shape:
            raise TypeError("a single DualQuaternion cannot be indexed; its coefficients are in .vec8")
        return _wrap(self._data[(*(index if isinstance(index, tuple) else (index,)), slice(None))])

    def __iter__(self) -> Iterator[DualQuaternion]:
        return (self[i] for i in range(len(self)))

    def __reduce__(self) -> tuple[Any, ...]:
        return DualQuaternion, (np.array(self._data),)

    def __repr__(self) -> str:
        if math.prod(self.batch_shape) > 8:
            return f"<DualQuaternion batch {self.batch_shape}: {self._data.reshape(-1, 8)[0].tolist()}, …>"
        return f"DualQuaternion({(self._data + 0.0).tolist()})"  # + 0.0 turns −0 into 0

    def __str__(self) -> str:
        return batch_text(self._data)

    _repr_markdown_ = pose_markdown


def _wrap(data: Array) -> DualQuaternion:
    """Make a DualQuaternion of a fresh array without a copy."""
    out = DualQuaternion.__new__(DualQuaternion)
    data.flags.writeable = False
    out._data = data
    return out
