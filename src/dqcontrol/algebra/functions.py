"""Products, conjugates, norms and adjoints of dual quaternions, on batches.

A dual quaternion P + εD is ``[P, D]``, 8 numbers, each quaternion scalar first; a pose is the unit dual
quaternion x = r + ε½pr. Leading axes are batches and broadcast as in NumPy. All functions take arrays,
lists or `DualQuaternion` and return new arrays; they raise `ShapeError` for a wrong shape or type and
`ValueRangeError` for NaN or infinity. Inlined operations on one are compiled in one loop per number of operands.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import dual_quaternion_kernels as kernels
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, READ2, WRITE, WRITE2, Kernel, kernel, types
from dqcontrol.compiled.intrinsics import ADDRESS, caller
from dqcontrol.errors import ShapeError, ValueRangeError, as_array

C4 = np.diag([1.0, -1.0, -1.0, -1.0])
C8 = np.diag([1.0, -1.0, -1.0, -1.0] * 2)
C4.flags.writeable = C8.flags.writeable = False


UNIT_TOLERANCE = 1e-6  # how far a value may be from unit norm where a pose is asked for
# the same of a quaternion written with four digits or more, which is then normalised
WRITTEN_TOLERANCE = 1e-3

_UNARY = types.void(READ, WRITE)
_BINARY = types.void(READ, READ, WRITE)
_TERNARY = types.void(READ, READ, READ, WRITE)
_call_unary, _call_binary, _call_ternary = caller(_UNARY), caller(_BINARY), caller(_TERNARY)


@kernel(types.void(ADDRESS, READ2, WRITE2))
def unary_batch(operation, a, out):
    """Apply an operation to every row."""
    for i in range(out.shape[0]):
        _call_unary(operation, a[i], out[i])


@kernel(types.void(ADDRESS, READ2, READ2, WRITE2))
def binary_batch(operation, a, b, out):
    """Apply an operation to every pair of rows; an operand of one row serves all."""
    step_a, step_b = int(a.shape[0] > 1), int(b.shape[0] > 1)
    for i in range(out.shape[0]):
        _call_binary(operation, a[i * step_a], b[i * step_b], out[i])


@kernel(types.void(ADDRESS, READ2, READ2, READ2, WRITE2))
def ternary_batch(operation, a, b, c, out):
    """Apply an operation to every triple of rows; an operand of one row serves all."""
    step_a, step_b, step_c = int(a.shape[0] > 1), int(b.shape[0] > 1), int(c.shape[0] > 1)
    for i in range(out.shape[0]):
        _call_ternary(operation, a[i * step_a], b[i * step_b], c[i * step_c], out[i])


@kernel(types.intp(READ2, types.float64))
def first_not_unit(x, tolerance):
    """Return the first row that is no unit dual quaternion, or −1."""
    for i in range(x.shape[0]):
        primary, dual, along = 0.0, 0.0, 0.0
        for k in range(4):
            primary += x[i, k] * x[i, k]
            dual += x[i, 4 + k] * x[i, 4 + k]
            along += x[i, k] * x[i, 4 + k]
        # For a large lever arm the round-off of ⟨P, D⟩ grows with |D|.
        if not (
            abs(math.sqrt(primary) - 1.0) <= tolerance and abs(along) <= tolerance * max(1.0, math.sqrt(dual))
        ):
            return i
    return -1


_SIGNATURES = {1: _UNARY, 2: _BINARY, 3: _TERNARY}
_BATCHES = {1: unary_batch, 2: binary_batch, 3: ternary_batch}


@cache
def _kernel(operation: Any, operands: int) -> Kernel:
    return Kernel(operation, _SIGNATURES[operands], strict=False)


def apply(operation: Any, size: int, **operands: Array) -> Array:
    """Return the operation on broadcast leading axes, shape (…, size); keywords name operands in errors."""
    compiled = _kernel(operation, len(operands))
    # one element: no need of a loop and a pointer
    if all(operand.ndim == 1 for operand in operands.values()):
        out = np.empty(size)
        compiled(*map(np.ascontiguousarray, operands.values()), out)
        return out
    batch_shape = broadcast_lead(**operands)
    rows = []
    for operand in operands.values():
        width = operand.shape[-1]
        if operand.size != width and operand.shape[:-1] != batch_shape:
            operand = np.broadcast_to(operand, (*batch_shape, width))
        rows.append(np.ascontiguousarray(operand).reshape(-1, width))
    out = np.empty((math.prod(batch_shape), size))
    _BATCHES[len(rows)](compiled.pointer, *rows, out)
    return out.reshape(*batch_shape, size)


def broadcast_lead(**operands: Array) -> tuple[int, ...]:
    """Return the common shape of the leading axes (all but the last), or an error naming the operands."""
    leads = [operand.shape[:-1] for operand in operands.values()]
    try:
        return np.broadcast_shapes(*leads)
    except ValueError:
        raise ShapeError(
            f"{', '.join(operands)}: batches of shapes {', '.join(map(str, leads))} do not broadcast"
        ) from None


def as_unit(field: str, value: ArrayLike) -> Array:
    """Return unit dual quaternions (…, 8), or raise an error naming the norm of the first that is not."""
    x = as_array(field, value, (8,))
    rows = np.ascontiguousarray(x).reshape(-1, 8)
    i = first_not_unit(rows, UNIT_TOLERANCE)
    if i >= 0:
        norm = float(np.linalg.norm(rows[i, :4]))
        dual = float(rows[i, :4] @ rows[i, 4:]) / norm if norm else 0.0
        where = index_of(np.arange(len(rows)).reshape(x.shape[:-1]) == i)
        raise ValueRangeError(
            f"{field}: expected a unit dual quaternion (norm 1), got norm {norm:.9g} + ε {dual:.6g}{where}"
        )
    return x


def index_of(bad: Any) -> str:
    """Return `` at index (…)`` of the first true element; nothing if there is but one."""
    return f" at index {tuple(map(int, np.argwhere(bad)[0]))}" if bad.ndim else ""


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Return ab = P₁P₂ + ε(P₁D₂ + D₁P₂), shape (…, 8), of a and b, shape (…, 8) [S17 3.14].

    Raises
    ------
    ShapeError, ValueRangeError
        If a or b is not (…, 8) or not finite, or the batches do not broadcast.

    Examples
    --------
    >>> multiply([0, 1, 0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0, 0, 0]).tolist()
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    """
    return apply(kernels.multiply, 8, a=as_array("a", a, (8,)), b=as_array("b", b, (8,)))


def conjugate(x: ArrayLike) -> Array:
    """Return x*, shape (…, 8): the imaginary parts of P and D negated; (ab)* = b* a* [S17 def. 3.3].

    Raises `ShapeError` or `ValueRangeError` if x is not (…, 8) or not finite.
    """
    return apply(kernels.conjugate, 8, x=as_array("x", x, (8,)))


def norm(x: ArrayLike) -> Array:
    """Return the dual number √(xx*) = |P| + ε⟨P, D⟩/|P| as shape (…, 2); 1 + ε0 for poses [S17 def. 3.3].

    Raises `ShapeError` or `ValueRangeError` if x is not (…, 8) or not finite.
    """
    return apply(kernels.norm, 2, x=as_array("x", x, (8,)))


def inverse(x: ArrayLike) -> Array:
    """Return x⁻¹, shape (…, 8); for poses it is x*.

    Raises
    ------
    ShapeError, ValueRangeError
        If x is not (…, 8) or not finite, or its primary part is zero, which has no inverse.

    Examples
    --------
    >>> inverse([2.0, 0, 0, 0, 4.0, 0, 0, 0])[[0, 4]].tolist()
    [0.5, -1.0]
    """
    return _nonzero("inverse", apply(kernels.inverse, 8, x=as_array("x", x, (8,))))


def renormalise(x: ArrayLike) -> Array:
    """Return the unit dual quaternion nearest to x, shape (…, 8): P/|P|, and D without its part along P.

    Raises
    ------
    ShapeError, ValueRangeError
        If x is not (…, 8) or not finite, or its primary part is zero.
    """
    return _nonzero("unit dual quaternion near it", apply(kernels.renormalise, 8, x=as_array("x", x, (8,))))


def short(x: ArrayLike) -> Array:
    """Return x or −x (the same pose), whichever has Re P ≥ 0, shape (…, 8): at most half a turn.

    Raises `ShapeError` or `ValueRangeError` if x is not (…, 8) or not finite.
    """
    return apply(kernels.short, 8, x=as_array("x", x, (8,)))


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """Return a × b = (ab − ba)/2, shape (…, 8), of pure dual quaternions (…, 8) [S17 3.11, 4.12].

    Raises
    ------
    ShapeError, ValueRangeError
        If a or b is not (…, 8), not finite or has a real part.
    """
    return unvec(cross_twist(vec6(a, field="a"), vec6(b, field="b")))


def cross_twist(a: ArrayLike, b: ArrayLike) -> Array:
    """Return vec6(a × b) = [ω₁×ω₂ ; ω₁×v₂ + v₁×ω₂], shape (…, 6), of twists [ω ; v], shape (…, 6).

    Raises `ShapeError` or `ValueRangeError` if a or b is not (…, 6) or not finite.
    """
    return apply(kernels.cross_twist, 6, a=as_array("a", a, (6,)), b=as_array("b", b, (6,)))


def dot(a: ArrayLike, b: ArrayLike) -> Array:
    """Return ⟨a, b⟩ = −(ab + ba)/2, a dual number as (…, 8), of pure dual quaternions (…, 8) [S17 3.10].

    Raises
    ------
    ShapeError, ValueRangeError
        If a or b is not (…, 8), not finite or has a real part.
    """
    a, b = unvec(vec6(a, field="a")), unvec(vec6(b, field="b"))
    return -0.5 * (multiply(a, b) + multiply(b, a))


def adjoint(x: ArrayLike, y: ArrayLike) -> Array:
    """Return Ad(x) y = x y x*, shape (…, 8) [S17 4.9].

    Raises `ShapeError` or `ValueRangeError` if x or y is not (…, 8) or not finite.
    """
    return apply(kernels.adjoint, 8, x=as_array("x", x, (8,)), y=as_array("y", y, (8,)))


def adjoint_twist(x: ArrayLike, twist: ArrayLike) -> Array:
    """Return vec6(x ξ x*) = [Rω ; Rv + p × Rω], shape (…, 6): a twist [ω ; v] of frame x in inertial axes.

    Raises
    ------
    ShapeError, ValueRangeError
        If x is not (…, 8), the twist not (…, 6), a value not finite, or x not unit.
    """
    return apply(kernels.adjoint_twist, 6, x=as_unit("x", x), twist=as_array("twist", twist, (6,)))


def adjoint_matrix(x: ArrayLike) -> Array:
    """Return Ad6(x) = [R 0 ; [p]×R R], shape (…, 6, 6), with vec6(x ξ x*) = Ad6(x) vec6(ξ).

    Raises
    ------
    ShapeError, ValueRangeError
        If x is not (…, 8), not finite or not unit.
    """
    return _square(apply(kernels.adjoint_matrix, 36, x=as_unit("x", x)), 6)


def hamilton_plus(x: ArrayLike) -> Array:
    """Return H⁺(x), shape (…, 8, 8), with vec8(xy) = H⁺(x) vec8(y) [P16 2.3; S17 3.16].

    Raises `ShapeError` or `ValueRangeError` if x is not (…, 8) or not finite.
    """
    return _square(apply(kernels.hamilton_plus, 64, x=as_array("x", x, (8,))), 8)


def hamilton_minus(y: ArrayLike) -> Array:
    """Return H⁻(y), shape (…, 8, 8), with vec8(xy) = H⁻(y) vec8(x) [P16 2.3; S17 3.16].

    Raises `ShapeError` or `ValueRangeError` if y is not (…, 8) or not finite.
    """
    return _square(apply(kernels.hamilton_minus, 64, y=as_array("y", y, (8,))), 8)


def rotation(x: ArrayLike) -> Array:
    """Return the rotation r = P of poses (…, 8) as unit quaternions, scalar first, shape (…, 4).

    Raises `ShapeError` or `ValueRangeError` if x is not (…, 8), not finite or not unit.
    """
    return as_unit("x", x)[..., :4].copy()


def translation(x: ArrayLike) -> Array:
    """Return the position p = 2DP* of poses (…, 8) in the inertial frame, shape (…, 3), m [S17 3.7].

    Raises `ShapeError` or `ValueRangeError` if x is not (…, 8), not finite or not unit.
    """
    return apply(kernels.translation, 3, x=as_unit("x", x))


def body_translation(x: ArrayLike) -> Array:
    """Return the position p_b = 2P*D of poses (…, 8) in their own frame, shape (…, 3), m [S17 3.8].

    Raises `ShapeError` or `ValueRangeError` if x is not (…, 8), not finite or not unit.
    """
    return apply(kernels.body_translation, 3, x=as_unit("x", x))


def vec8(x: ArrayLike) -> Array:
    """Return the 8 coefficients [P, D] as a new array, shape (…, 8)."""
    return as_array("x", x, (8,)).copy()


def vec4(x: ArrayLike) -> Array:
    """Return the coefficients, shape (…, 4), of quaternions (…, 8); `ValueRangeError` if they are dual."""
    x = as_array("x", x, (8,))
    _vanish("x", "a quaternion (dual part 0)", x, slice(4, 8))
    return x[..., :4].copy()


def vec3(x: ArrayLike) -> Array:
    """Return Im P, shape (…, 3), of pure quaternions (…, 8); `ValueRangeError` if they are not."""
    x = as_array("x", x, (8,))
    _vanish("x", "a pure quaternion (real and dual parts 0)", x, [0, 4, 5, 6, 7])
    return x[..., 1:4].copy()


def vec6(x: ArrayLike, *, field: str = "x") -> Array:
    """Return [Im P ; Im D], shape (…, 6), of pure values (…, 8); `ValueRangeError` if they are not."""
    x = as_array(field, x, (8,))
    _vanish(field, "a pure dual quaternion (real parts 0)", x, [0, 4])
    return x[..., [1, 2, 3, 5, 6, 7]]


def unvec(v: ArrayLike) -> Array:
    """Return dual quaternions (…, 8) from their vec3, vec4, vec6 or vec8, told apart by the last axis.

    Raises
    ------
    ShapeError, ValueRangeError
        If the last axis has another length, or a value is not finite.

    Examples
    --------
    >>> unvec([1, 2, 3, 4, 5, 6]).tolist()
    [0.0, 1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 6.0]
    """
    v = as_array("v", v)
    places = {3: [1, 2, 3], 4: [0, 1, 2, 3], 6: [1, 2, 3, 5, 6, 7], 8: list(range(8))}
    if v.ndim == 0 or v.shape[-1] not in places:
        raise ShapeError(f"v: expected shape (…, 3), (…, 4), (…, 6) or (…, 8), got shape {v.shape}")
    x = np.zeros((*v.shape[:-1], 8))
    x[..., places[v.shape[-1]]] = v
    return x


def _square(flat: Array, size: int) -> Array:
    return flat.reshape(*flat.shape[:-1], size, size)


def _nonzero(what: str, out: Array) -> Array:
    bad = ~np.isfinite(out).all(axis=-1)
    if bad.any():
        raise ValueRangeError(f"x: primary part is zero (or nearly){index_of(bad)}; there is no {what}")
    return out


def _vanish(field: str, kind: str, x: Array, places: slice | list[int]) -> None:
    """Raise unless some coefficients are zero up to round-off."""
    rest = np.abs(x[..., places]).max(initial=0.0)
    if rest > 1e-9 * max(1.0, np.abs(x).max(initial=0.0)):
        raise ValueRangeError(f"{field}: expected {kind}, got a remainder of {rest:.6g}")
