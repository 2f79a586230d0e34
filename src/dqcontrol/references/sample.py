"""The desired motion at one instant, and at many: where positions and rotations become poses and twists."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import adjoint_twist, multiply, translation
from dqcontrol.algebra.conversions import as_unit_quaternion
from dqcontrol.algebra.dual_quaternion_kernels import set_pose
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ2, WRITE2, kernel, types
from dqcontrol.errors import ShapeError, ValueRangeError, as_array

POSE, TWIST, TWIST_RATE, TIME = slice(0, 8), slice(8, 14), slice(14, 20), 20
SAMPLE_SIZE = 21  # a sample as compiled code sees it: pose, twist, twist rate, time


@dataclass(frozen=True, eq=False, init=False)
class Sample:
    """Desired pose, twist and twist rate at one time, inertial frame; checked when made.

    Parameters
    ----------
    pose
        Unit dual quaternion, `DualQuaternion` or shape (8,), m; kept as an array.
    twist
        ξ_d = ω + ε(ṗ + p × ω), shape (6,), rad/s and m/s; 0 for a resting target.
    twist_rate
        Its time derivative, shape (6,).
    time
        s.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value is not finite, or the pose has not norm 1.
    """

    pose: Array
    twist: Array
    twist_rate: Array
    time: float
    data: Array = field(repr=False)
    # The same, not to be written, as compiled code takes it at once: an array that is frozen costs 0.3 µs more.
    numbers: Array = field(repr=False)

    def __init__(
        self, pose: ArrayLike, twist: ArrayLike = 0.0, twist_rate: ArrayLike = 0.0, time: float = 0.0
    ) -> None:
        data = np.empty(SAMPLE_SIZE)
        data[POSE] = as_pose("pose", pose)
        data[TWIST] = _six("twist", twist)
        data[TWIST_RATE] = _six("twist_rate", twist_rate)
        data[TIME] = as_array("time", time, ())
        self._keep(data)

    @classmethod
    def of_row(cls, row: Array) -> Sample:
        """Return a row (21,) of `Reference.samples` to the last bit: its pose is not normalised once more."""
        sample = cls.__new__(cls)
        sample._keep(row)
        return sample

    def _keep(self, numbers: Array) -> None:
        data = numbers.view()
        data.flags.writeable = False
        vars(self).update(numbers=numbers, data=data, time=float(data[TIME]))
        vars(self).update(pose=data[POSE], twist=data[TWIST], twist_rate=data[TWIST_RATE])


def _six(field: str, value: ArrayLike) -> Array:
    """Return a twist (6,), or a number that stands for all six."""
    array = as_array(field, value)
    if array.shape not in ((), (6,)):
        raise ShapeError(f"{field}: expected shape (6,), got {array.shape}")
    return array


def as_pose(field: str, pose: ArrayLike) -> Array:
    """Return one pose as unit dual quaternion (8,), renormalised, or say what is wrong with it."""
    x = as_array(field, getattr(pose, "vec8", pose), (8,))
    if x.ndim != 1:
        raise ShapeError(f"{field}: expected shape (8,), got {x.shape}")
    norm, along = np.linalg.norm(x[:4]), x[:4] @ x[4:]
    if abs(norm - 1) > 1e-6 or abs(along) > 1e-6:
        raise ValueRangeError(
            f"{field}: expected a unit dual quaternion, got norm {norm:.6g} + ε {along:.6g}"
        )
    x = x / norm
    x[4:] -= (x[:4] @ x[4:]) * x[:4]
    return x


@kernel(types.void(READ2, READ2, READ2, READ2, READ2, READ2, WRITE2), strict=True)
def _rigid_motion(position, velocity, acceleration, rotation, angular_velocity, angular_acceleration, out):
    """Write samples as `motion_samples` defines them; all but the position may have one row for all."""
    v_step, a_step = int(velocity.shape[0] > 1), int(acceleration.shape[0] > 1)
    r_step, w_step = int(rotation.shape[0] > 1), int(angular_velocity.shape[0] > 1)
    alpha_step = int(angular_acceleration.shape[0] > 1)
    for i in range(out.shape[0]):
        p, v, a, r = position[i], velocity[i * v_step], acceleration[i * a_step], rotation[i * r_step]
        w, alpha = angular_velocity[i * w_step], angular_acceleration[i * alpha_step]
        set_pose(r, p, out[i])
        for k in range(3):
            m, n = (k + 1) % 3, (k + 2) % 3
            out[i, 8 + k] = w[k]
            out[i, 11 + k] = v[k] + (p[m] * w[n] - p[n] * w[m])
            out[i, 14 + k] = alpha[k]
            out[i, 17 + k] = a[k] + (v[m] * w[n] - v[n] * w[m]) + (p[m] * alpha[n] - p[n] * alpha[m])
        out[i, 20] = 0.0


def motion_samples(
    position: ArrayLike,
    velocity: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    rotation: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    angular_velocity: ArrayLike = 0.0,
    angular_acceleration: ArrayLike = 0.0,
) -> Array:
    """Return samples (N, 21), time 0, of a motion given by its position and rotation.

    x = r + ε½pr,  ξ = ω + ε(ṗ + p × ω),  ξ̇ = α + ε(p̈ + ṗ × ω + p × α) [P16 2.1.3; S17 3.7, 3.9].

    Parameters
    ----------
    position, velocity, acceleration
        p, ṗ, p̈, inertial frame, shape (N, 3) or broadcast to it, m, m/s, m/s².
    rotation
        Unit quaternion r, scalar first, shape (N, 4) or (4,).
    angular_velocity, angular_acceleration
        ω, α, inertial frame, shape (N, 3) or broadcast to it, rad/s, rad/s².

    Examples
    --------
    >>> motion_samples([[1.0, 0.0, 0.0]], velocity=[[0.0, 2.0, 0.0]])[0, 8:14].tolist()
    [0.0, 0.0, 0.0, 0.0, 2.0, 0.0]
    """
    p = np.ascontiguousarray(np.atleast_2d(as_array("position", position, (3,))))
    v, a = _rows("velocity", velocity, len(p)), _rows("acceleration", acceleration, len(p))
    w = _rows("angular_velocity", angular_velocity, len(p))
    alpha = _rows("angular_acceleration", angular_acceleration, len(p))
    r = np.ascontiguousarray(np.atleast_2d(as_unit_quaternion("rotation", rotation)))
    if len(r) not in (1, len(p)):
        raise ShapeError(f"rotation: expected shape (4,) or ({len(p)}, 4), got {r.shape}")
    out = np.empty((len(p), SAMPLE_SIZE))
    _rigid_motion(p, v, a, r, w, alpha, out)
    return out


def _rows(field: str, vectors: ArrayLike, count: int) -> Array:
    """Return vectors (N, 3), or one row for all of them."""
    array = np.asarray(vectors, dtype=np.float64)
    if array.ndim < 2:
        return np.full((1, 3), array)
    if array.shape not in ((1, 3), (count, 3)):
        raise ShapeError(f"{field}: expected shape ({count}, 3), got {array.shape}")
    return np.ascontiguousarray(array)


def point_motion(samples: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration (N, 3) of samples (N, 21), m, m/s, m/s²: `motion_samples` undone.

    p = 2 P r*,  ṗ = D(ξ) − p × ω,  p̈ = D(ξ̇) − ṗ × ω − p × α.
    """
    p = translation(samples[:, POSE])
    w, d = samples[:, TWIST][:, :3], samples[:, TWIST][:, 3:]
    alpha, d_rate = samples[:, TWIST_RATE][:, :3], samples[:, TWIST_RATE][:, 3:]
    v = d - np.cross(p, w)
    return p, v, d_rate - np.cross(v, w) - np.cross(p, alpha)


def turned(rotation: Array, axis: Array, angle: Array) -> Array:
    """Return a unit quaternion (4,) turned by angles (N,), rad, about a unit axis (3,): shape (N, 4)."""
    half = 0.5 * angle[:, None]
    turn, whole = np.zeros((len(angle), 8)), np.zeros(8)
    turn[:, :4], whole[:4] = np.concatenate([np.cos(half), np.sin(half) * axis], axis=1), rotation
    return multiply(turn, whole)[:, :4]


def displaced(by: ArrayLike, samples: Array) -> Array:
    """Return samples (N, 21) after a constant displacement y (8,): pose yx, twist Ad(y)ξ, rate Ad(y)ξ̇."""
    out = samples.copy()
    out[:, POSE] = multiply(by, samples[:, POSE])
    for part in (TWIST, TWIST_RATE):
        out[:, part] = adjoint_twist(by, samples[:, part])
    return out
