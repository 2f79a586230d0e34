"""The base of all robots that are a chain of screws: poses, Jacobians and their rates from its table."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, WRONG_SIZE, Kernel
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.robots.kinematics import kinematics_kernels as chains
from dqcontrol.robots.poses import positions

_new, _empty, _ndarray = object.__new__, np.empty, np.ndarray


class Kinematics:
    """Pose and Jacobians of one configuration.

    Attributes
    ----------
    pose
        End pose, shape (8,), inertial frame.
    pose_jacobian
        J with vec8(ẋ) = J u, shape (8, m).
    twist_jacobian
        J_w with vec6(ξ) = J_w u, ξ = ω + ε(ṗ + p × ω) inertial, shape (6, m).
    """

    __slots__ = ("pose", "pose_jacobian", "twist_jacobian")

    def __init__(self, input_size: int) -> None:
        self.pose: Array = np.empty(8)
        self.pose_jacobian: Array = np.empty((8, input_size))
        self.twist_jacobian: Array = np.empty((6, input_size))


class ChainRobot:
    """Poses and Jacobians of a chain table.

    All methods take configurations q of shape (…, n), rad or m, and inputs u of shape (…, m), rad/s or m/s, which are
    the joint velocities q̇ of an arm; leading axes are batches. They raise `ShapeError` for a wrong size and
    `ValueRangeError` for a number that is not finite.
    """

    # `pose_task_kernels` has functions of the same names for trees
    kernels: ClassVar[ModuleType] = chains
    name: str
    chain: Array  # may not be written
    table: Array  # what the kernels read: the chain
    _table: Array  # the same, as compiled code takes it at once: an array that may not be written costs 0.3 µs more
    # machine code of `kinematics_apart`: three look-ups less than asking for it
    _compute: Callable[..., int] | None
    configuration_size: int
    input_size: int

    def _keep_chain(self, chain: Array) -> None:
        """Keep the table (n + 1, 8); its owner may not write it any more."""
        self._keep_table(chain)
        self.chain = self.table

    def _keep_table(self, table: Array) -> None:
        self._table, self.table, self._compute = table, table.view(), None
        self.table.flags.writeable = False

    def __getstate__(self) -> dict[str, Any]:
        """Return what copies and other processes get: all but machine code."""
        return {**self.__dict__, "_compute": None}

    def fkm(self, q: ArrayLike) -> Array:
        """Return the end pose, shape (…, 8), inertial frame. [P16 3.13]."""
        return self._map(self.kernels.forward, q, self.configuration_size, 8)

    def frames(self, q: ArrayLike) -> Array:
        """Return the poses of all joint frames after their screws, then the end pose: shape (…, n + 1, 8).

        The axis of each joint is the z axis of its frame; the frame of a base is that of its last coordinate, φ.
        """
        n = self.configuration_size
        flat = self._map(chains.forward, q, n, 8 * (n + 1))
        return flat.reshape(*flat.shape[:-1], n + 1, 8)

    def kinematics(self, q: Array, out: Kinematics | None = None) -> Kinematics:
        """Compute pose, pose Jacobian and twist Jacobian in one pass: the fast path.

        Parameters
        ----------
        q
            Configuration, shape (n,), rad or m.
        out
            Written in place and returned, if given; fastest.

        Raises
        ------
        ShapeError, ValueRangeError
            If q has not n elements, or one is not finite.

        Examples
        --------
        >>> import numpy as np, dqcontrol as dqc
        >>> arm = dqc.load_robot("iiwa7")
        >>> arm.kinematics(np.zeros(7)).twist_jacobian.shape
        (6, 7)
        """
        if out is None:
            out, m = _new(Kinematics), self.input_size
            out.pose, out.pose_jacobian, out.twist_jacobian = _empty(8), _empty((8, m)), _empty((6, m))
        compute = self._compute
        if compute is None:
            compute = self._compute = self.kernels.kinematics_apart.compiled
        try:
            status = compute(self._table, q, out.pose, out.pose_jacobian, out.twist_jacobian)
        except TypeError:  # a list, integers, several configurations
            values, status = as_array("q", q), WRONG_SIZE
            if values.ndim == 1:
                status = compute(self._table, values, out.pose, out.pose_jacobian, out.twist_jacobian)
        if status:
            size = out.pose_jacobian.shape[1]
            if size != self.input_size:
                raise ShapeError(f"out: made for {size} inputs, but {self.name} has {self.input_size}")
            self._raise(status, q)
        return out

    def pose_jacobian(self, q: ArrayLike) -> Array:
        """Return J, shape (…, 8, m), with vec8(ẋ) = J u. [P16 3.1; S17 4.3]."""
        if type(q) is _ndarray and q.ndim == 1:
            return self.kinematics(q).pose_jacobian
        return self._columns(q, self.kernels.kinematics, 0, 8)

    def twist_jacobian(self, q: ArrayLike) -> Array:
        """Return J_w, shape (…, 6, m), with vec6(ξ) = J_w u, ξ the inertial twist. [P16 3.14, 3.51]."""
        if type(q) is _ndarray and q.ndim == 1:
            return self.kinematics(q).twist_jacobian
        return self._columns(q, self.kernels.kinematics, 8, 6)

    def translation_jacobian(self, q: ArrayLike) -> Array:
        """Return J_p, shape (…, 3, m), with ṗ = J_p u in m/s, inertial frame."""
        return self._columns(q, self.kernels.hand_kinematics, 11, 3)

    def rotation_jacobian(self, q: ArrayLike) -> Array:
        """Return J_r, shape (…, 4, m), with vec4(ṙ) = J_r u."""
        return self._columns(q, self.kernels.kinematics, 0, 4)

    def hand_jacobian(self, q: ArrayLike) -> Array:
        """Return the Jacobian of [ω ; ṗ], shape (…, 6, m): rad/s and m/s of the end, inertial axes."""
        return self._columns(q, self.kernels.hand_kinematics, 8, 6)

    def pose_jacobian_derivative(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return dJ/dt, shape (…, 8, m), so that vec8(ẍ) = J u̇ + (dJ/dt) u.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> arm = dqc.load_robot("iiwa7")
        >>> arm.pose_jacobian_derivative([0.1] * 7, [0.2] * 7).shape
        (8, 7)
        """
        return _matrix(self._rates(q, u), 8 + 14 * self.input_size, 8, self.input_size)

    def twist_jacobian_derivative(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return dJ_w/dt, shape (…, 6, m): each column turns with the twist of what carries its axis."""
        return _matrix(self._rates(q, u), 8 + 22 * self.input_size, 6, self.input_size)

    def translation_jacobian_derivative(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return dJ_p/dt, shape (…, 3, m), so that p̈ = J_p u̇ + (dJ_p/dt) u."""
        flat, m = self._rates(q, u), self.input_size
        twist, rate = _matrix(flat, 8 + 8 * m, 6, m), _matrix(flat, 8 + 22 * m, 6, m)
        p, speed = positions(flat[..., :8]), as_array("u", u)
        jacobian = twist[..., 3:6, :] - _cross_columns(p, twist[..., 0:3, :])
        velocity = (jacobian @ speed[..., None])[..., 0]
        turned = _cross_columns(velocity, twist[..., 0:3, :]) + _cross_columns(p, rate[..., 0:3, :])
        return rate[..., 3:6, :] - turned

    def rotation_jacobian_derivative(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return dJ_r/dt, shape (…, 4, m), so that vec4(r̈) = J_r u̇ + (dJ_r/dt) u."""
        return _matrix(self._rates(q, u), 8 + 14 * self.input_size, 4, self.input_size)

    def _columns(
        self, q: ArrayLike, function: Kernel, first: int, rows: int, table: Array | None = None
    ) -> Array:
        """Return some of the 14 rows of both Jacobians."""
        m = self.input_size
        flat = self._map(function, q, self.configuration_size, 8 + 14 * m, table)
        return _matrix(flat, 8 + first * m, rows, m)

    def _rates(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return what `jacobian_rates` writes, shape (…, 8 + 28 m)."""
        n, m = self.configuration_size, self.input_size
        if type(q) is _ndarray and type(u) is _ndarray and q.ndim == u.ndim == 1:
            out = _empty(8 + 28 * m)
            try:
                if chains.jacobian_rates.compiled(self._table, q, u, out) == OK:
                    return out
            except TypeError:  # integers
                pass
        values, speeds = self._rows("q", q), self._inputs("u", u)
        if values.shape[:-1] != speeds.shape[:-1]:
            raise ShapeError(f"u: expected shape {(*values.shape[:-1], m)} as q has, got {speeds.shape}")
        rows = np.ascontiguousarray(values.reshape(-1, n)), np.ascontiguousarray(speeds.reshape(-1, m))
        out = np.empty((len(rows[0]), 8 + 28 * m))
        if status := chains.batch_rates(chains.jacobian_rates.pointer, self.chain, *rows, out):
            self._raise(status, values)
        return out.reshape(*values.shape[:-1], 8 + 28 * m)

    def _rows(self, field: str, value: ArrayLike) -> Array:
        return as_array(field, value, (self.configuration_size,))

    def _inputs(self, field: str, value: ArrayLike) -> Array:
        return as_array(field, value, (self.input_size,))

    def _map(
        self, function: Kernel, values: ArrayLike, columns: int, size: int, table: Array | None = None
    ) -> Array:
        """Return what a function of the robot's table, or of another one, makes of each row, shape (…, size)."""
        if table is None:
            table = self._table
        if type(values) is _ndarray and values.ndim == 1:
            out = _empty(size)  # called directly, ten times faster than as a batch
            try:
                if function.compiled(table, values, out) == OK:
                    return out
            except TypeError:  # integers
                pass
        array = as_array("q", values, (columns,))
        rows = np.ascontiguousarray(array.reshape(-1, columns))
        out = np.empty((len(rows), size))
        status = chains.batch(function.pointer, table, rows, out)
        if status:
            self._raise(status, array)
        return out.reshape(*array.shape[:-1], size)

    def _raise(self, status: int, q: Any) -> None:
        if status == WRONG_SIZE:
            raise ShapeError(
                f"q: expected shape ({self.configuration_size},) for {self.name}, got {np.shape(q)}"
            )
        raise ValueRangeError(f"q: must be finite, got {np.asarray(q)}")

    # measures of the end effector's Jacobian [ω ; ṗ], in rad and m: they change with the unit of length

    def manipulability(self, q: ArrayLike) -> Array:
        """Return m = √det(J Jᵀ), or √det(JᵀJ) with fewer than six joints, shape (…). [Yoshikawa 1985].

        It is the product of the singular values, zero where the arm is singular; with six joints or more J_w gives the
        same.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> bool(dqc.load_robot("iiwa7").manipulability([0] * 7) < 1e-9)  # stretched
        True
        """
        return np.prod(self._singular_values(q), axis=-1)

    def condition_number(self, q: ArrayLike) -> Array:
        """Return the largest singular value over the smallest, shape (…); inf where the smallest is zero."""
        values = self._singular_values(q)
        with np.errstate(divide="ignore"):
            return values[..., 0] / values[..., -1]

    def singular_directions(self, q: ArrayLike, threshold: float = 0.02) -> tuple[Array, Array]:
        """Return the directions in which the end effector can hardly move.

        Parameters
        ----------
        q
            One configuration, shape (n,), rad or m.
        threshold
            Singular values below it count, in units of the end effector's Jacobian (rad and m).

        Returns
        -------
        directions, singular_values
            Unit vectors [ω ; ṗ], inertial axes, shape (k, 6), and their singular values, shape (k,), smallest first.
            An arm of n < 6 joints has 6 − n directions of value zero anywhere.

        Raises
        ------
        ShapeError, ValueRangeError
            If q is not one configuration, or the threshold not positive.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> directions, values = dqc.load_robot("iiwa7").singular_directions([0] * 7)
        >>> len(values)  # stretched along z: no motion along z, none about x and y apart from moving sideways
        3
        """
        bound = as_positive("threshold", threshold)
        jacobian = self.hand_jacobian(q)
        if jacobian.ndim != 2:
            raise ShapeError(f"q: expected one configuration, got shape {np.shape(q)}")
        vectors, found, _ = np.linalg.svd(jacobian)
        values = np.zeros(6)
        values[: len(found)] = found
        chosen = np.flatnonzero(values < bound)[::-1]
        return vectors.T[chosen], values[chosen]

    def _singular_values(self, q: ArrayLike) -> Array:
        return np.asarray(np.linalg.svd(self.hand_jacobian(q), compute_uv=False), dtype=np.float64)


def _matrix(flat: Array, first: int, rows: int, columns: int) -> Array:
    """Return some of the last axis' numbers as rows and columns."""
    if flat.ndim == 1:
        return flat[first : first + rows * columns].reshape(rows, columns)
    return flat[..., first : first + rows * columns].reshape(*flat.shape[:-1], rows, columns)


def _cross_columns(vector: Array, matrix: Array) -> Array:
    return np.cross(vector[..., :, None], matrix, axis=-2)
