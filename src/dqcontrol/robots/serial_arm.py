"""Serial arms: the data of a chain, and calls into its compiled kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.compile import WRONG_SIZE, Kernel
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.robots import kernels
from dqcontrol.robots.dh import JOINT_TYPES, chain_from_dh, compose
from dqcontrol.robots.gravity import body_table, gravity_torques
from dqcontrol.robots.limits import Inertia, Limits

Array = NDArray[np.float64]


class Kinematics:
    """Pose and Jacobians of one configuration, views into one buffer.

    Attributes
    ----------
    data
        The buffer, shape (8 + 14 m,).
    pose
        End pose, shape (8,), inertial frame.
    pose_jacobian
        J with vec8(ẋ) = J u, shape (8, m).
    twist_jacobian
        J_w with vec6(ξ) = J_w u, ξ = ω + ε(ṗ + p × ω) inertial, shape (6, m).
    """

    __slots__ = ("data", "pose", "pose_jacobian", "twist_jacobian")

    def __init__(self, input_size: int) -> None:
        m = input_size
        self.data: Array = np.zeros(8 + 14 * m)
        self.pose = self.data[:8]
        self.pose_jacobian = self.data[8 : 8 + 8 * m].reshape(8, m)
        self.twist_jacobian = self.data[8 + 8 * m :].reshape(6, m)


class SerialArm:
    """An arm of n revolute or prismatic joints in a row.

    Parameters
    ----------
    fixed
        The n + 1 fixed poses, shape (n + 1, 7): unit quaternion (scalar first) and position (m) of each joint's frame in
        the frame after the joint before it (the first in the base frame), and of the tool after the last joint. Each
        joint turns about or slides along its z axis.
    joint_types
        ``"revolute"`` or ``"prismatic"`` for each joint.
    limits
        Joint limits; none if omitted.
    joint_names
        ``joint_1`` … if omitted.
    name
        Shown in tables.
    inertia
        Link inertias, needed for gravity and physics.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If a size, a value or a joint type is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm = dqc.SerialArm.from_dh(theta=[0, 0], d=[0, 0], a=[1, 1], alpha=[0, 0])
    >>> dqc.DualQuaternion(arm.fkm([0.0, 0.0])).translation.round(12).tolist()
    [2.0, 0.0, 0.0]
    """

    def __init__(
        self,
        fixed: ArrayLike,
        joint_types: Sequence[str],
        *,
        limits: Limits | None = None,
        joint_names: Sequence[str] | None = None,
        name: str | None = None,
        inertia: Inertia | None = None,
    ) -> None:
        n = len(joint_types)
        table = as_array("fixed", fixed, (n + 1, 7))
        norms = np.linalg.norm(table[:, :4], axis=1)
        if (np.abs(norms - 1) > 1e-6).any():
            raise ValueRangeError(f"fixed: quaternions must have norm 1, got norms {norms}")
        chain = np.zeros((n + 1, 8))
        chain[:, :7] = table
        chain[:, :4] /= norms[:, None]
        chain[:n, 7] = [JOINT_TYPES.index(kind) for kind in joint_types]
        chain.flags.writeable = False

        self.name = name or "arm"
        self.chain: Array = chain
        self.joint_types = tuple(joint_types)
        self.joint_names = tuple(joint_names) if joint_names is not None else tuple(f"joint_{i + 1}" for i in range(n))
        self.limits = limits if limits is not None else Limits.none(n)
        self.inertia = inertia
        self.configuration_size = n
        self.input_size = n
        for field, size in (
            ("joint_names", len(self.joint_names)),
            ("limits", len(self.limits.lower)),
            ("inertia", len(inertia.mass) if inertia is not None else n),
        ):
            if size != n:
                raise ShapeError(f"{field}: the arm has {n} joints, got {size} entries")

    def __repr__(self) -> str:
        return f"SerialArm({self.name!r}, {self.configuration_size} joints)"

    @classmethod
    def from_dh(
        cls,
        theta: ArrayLike,
        d: ArrayLike,
        a: ArrayLike,
        alpha: ArrayLike,
        joint_types: list[str] | None = None,
        convention: str = "standard",
        base: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        limits: Limits | None = None,
        name: str | None = None,
        joint_names: Sequence[str] | None = None,
        inertia: Inertia | None = None,
    ) -> SerialArm:
        """Make an arm from Denavit–Hartenberg parameters.

        Parameters
        ----------
        theta, d, a, alpha
            One number a joint: rad, m, m, rad. The joint variable adds to theta (revolute) or d (prismatic).
        joint_types
            ``"revolute"`` (default) or ``"prismatic"`` for each joint.
        convention
            ``"standard"``: Rz(θ) Tz(d) Tx(a) Rx(α); ``"modified"`` (Craig): Tx(a) Rx(α) Rz(θ) Tz(d).
        base, tool
            Unit dual quaternions (8,): pose of the first frame in the inertial one, and of the tool in the last.
        limits, name, joint_names, inertia
            As for the class.
        """
        fixed, types = chain_from_dh(theta, d, a, alpha, joint_types, convention)
        if base is not None:
            fixed[0] = compose(_pose7("base", base), fixed[0])
        if tool is not None:
            fixed[-1] = compose(fixed[-1], _pose7("tool", tool))
        return cls(np.array(fixed), types, limits=limits, joint_names=joint_names, name=name, inertia=inertia)

    def fkm(self, q: ArrayLike) -> Array:
        """Return the end pose, shape (…, 8), for configurations q, shape (…, n), rad or m. [P16 3.13]"""
        return self._map(kernels.forward, q, 8)

    def frames(self, q: ArrayLike) -> Array:
        """Return the poses of all joint frames after their screws, then the end pose: shape (…, n + 1, 8)."""
        n = self.configuration_size
        flat = self._map(kernels.forward, q, 8 * (n + 1))
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
            out = Kinematics(self.input_size)
        try:
            status = kernels.kinematics(self.chain, q, out.data)
        except TypeError:  # a list, integers, several configurations
            values = as_array("q", q)
            status = WRONG_SIZE if values.ndim != 1 else kernels.kinematics(self.chain, values, out.data)
        if status:
            self._raise(status, q)
        return out

    def pose_jacobian(self, q: ArrayLike) -> Array:
        """Return J, shape (…, 8, n), with vec8(ẋ) = J q̇. [P16 3.1; S17 4.3]"""
        return self._jacobians(q)[1]

    def twist_jacobian(self, q: ArrayLike) -> Array:
        """Return J_w, shape (…, 6, n), with vec6(ξ) = J_w q̇, ξ the inertial twist. [P16 3.14, 3.51]"""
        return self._jacobians(q)[2]

    def translation_jacobian(self, q: ArrayLike) -> Array:
        """Return J_p, shape (…, 3, n), with ṗ = J_p q̇ in m/s, inertial frame."""
        pose, _, twist = self._jacobians(q)
        w, v = pose[..., :1], pose[..., 1:4]
        dw, dv = pose[..., 4:5], pose[..., 5:8]
        p = 2 * (w * dv - dw * v - np.cross(dv, v))
        return twist[..., 3:6, :] - np.cross(p[..., :, None], twist[..., 0:3, :], axis=-2)

    def rotation_jacobian(self, q: ArrayLike) -> Array:
        """Return J_r, shape (…, 4, n), with vec4(ṙ) = J_r q̇."""
        return self._jacobians(q)[1][..., :4, :]

    def gravity_torque(self, q: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)) -> Array:
        """Return the joint torques that hold the arm still, τ_g = ∂U/∂q.

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.
        gravity
            Acceleration of free fall in the base frame, shape (3,), m/s².

        Returns
        -------
        Array
            Shape (…, n), N·m or N.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong, a value is not finite, or the arm has no inertia.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> dqc.load_robot("iiwa7").gravity_torque([0, 1.57, 0, 0, 0, 0, 0]).shape
        (7,)
        """
        if self.inertia is None:
            raise ValueRangeError(f"inertia: {self.name} has none, so its gravity torque is unknown")
        n = self.configuration_size
        values, fall = as_array("q", q, (n,)), as_array("gravity", gravity, (3,))
        if fall.ndim != 1:
            raise ShapeError(f"gravity: expected shape (3,), got {fall.shape}")
        rows = np.ascontiguousarray(values.reshape(-1, n))
        out = np.empty_like(rows)
        bodies = body_table(self.inertia)
        gravity_torques(self.chain, bodies, rows, np.ascontiguousarray(fall), out)
        return out.reshape(values.shape)

    def _jacobians(self, q: ArrayLike) -> tuple[Array, Array, Array]:
        m = self.input_size
        flat = self._map(kernels.kinematics, q, 8 + 14 * m)
        lead = flat.shape[:-1]
        return (
            flat[..., :8],
            flat[..., 8 : 8 + 8 * m].reshape(*lead, 8, m),
            flat[..., 8 + 8 * m :].reshape(*lead, 6, m),
        )

    def _map(self, function: Kernel, q: ArrayLike, size: int) -> Array:
        n = self.configuration_size
        values = as_array("q", q, (n,))
        rows = np.ascontiguousarray(values.reshape(-1, n))
        out = np.empty((len(rows), size))
        status = kernels.batch(function.pointer, self.chain, rows, out)
        if status:
            self._raise(status, values)
        return out.reshape(*values.shape[:-1], size)

    def _raise(self, status: int, q: Any) -> None:
        if status == WRONG_SIZE:
            raise ShapeError(f"q: expected shape ({self.configuration_size},) for {self.name}, got {np.shape(q)}")
        raise ValueRangeError(f"q: must be finite, got {np.asarray(q)}")


def _pose7(field: str, pose: ArrayLike) -> Array:
    """Return [quaternion, position] of a unit dual quaternion."""
    x = as_array(field, getattr(pose, "vec8", pose), (8,))
    if abs(np.linalg.norm(x[:4]) - 1) > 1e-6 or abs(x[:4] @ x[4:]) > 1e-6:
        raise ValueRangeError(f"{field}: expected a unit dual quaternion, got {x}")
    w, v, dw, dv = x[0], x[1:4], x[4], x[5:]
    return np.concatenate([x[:4], 2 * (w * dv - dw * v - np.cross(dv, v))])
