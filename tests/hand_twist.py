"""What every law's command is by NumPy's SVD: the hand's twist nearest to what is asked, through a filtered inverse."""

import numpy as np

from dqcontrol import algebra
from dqcontrol.laws import DampedInverse, FilteredInverse

PURE = np.zeros((8, 6))
PURE[1:4, :3] = PURE[5:8, 3:] = np.eye(3)


def cross(p):
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])


def hand_jacobian(arm, q):
    """Return the Jacobian of the hand's [ω ; ṗ]."""
    jacobian = arm.twist_jacobian(q).copy()
    jacobian[3:] -= cross(algebra.translation(arm.fkm(q))) @ jacobian[:3]
    return jacobian


def inertial_from_hand(arm, q):
    """Return the matrix that takes [ω ; ṗ] to the inertial twist [ω ; ṗ + p × ω]."""
    matrix = np.eye(6)
    matrix[3:, :3] = cross(algebra.translation(arm.fkm(q)))
    return matrix


def pose_rate(arm, q):
    """Return the matrix (8 × 6) that takes [ω ; ṗ] to vec8(ẋ)."""
    return 0.5 * algebra.hamilton_minus(arm.fkm(q)) @ PURE @ inertial_from_hand(arm, q)


def error_rate(arm, q, desired):
    """Return the matrix (8 × 6) that takes [ω ; ṗ] to N u. [P16 3.7]"""
    return algebra.hamilton_minus(desired) @ algebra.C8 @ pose_rate(arm, q)


def inverse_by_svd(matrix, inverse):
    """Return the inverse of a matrix in metres as its formula says."""
    u, s, v = np.linalg.svd(matrix, full_matrices=False)
    if isinstance(inverse, DampedInverse):
        damping = np.full(len(s), inverse.damping**2)
    else:
        assert isinstance(inverse, FilteredInverse)
        eps = inverse.threshold
        damping = np.where(s < eps, (1 - (s / eps) ** 2) * inverse.damping**2, 0.0)
    gain = np.divide(s, s**2 + damping, out=np.zeros_like(s), where=s > 1e-12)
    return (v.T * gain) @ u.T


def command(arm, q, twist, inverse=None, z=0.0):
    """Return z + J⁺ (t − J z) for the hand's twist t, in the measure |[ℓω ; ṗ]|."""
    inverse = inverse or FilteredInverse()
    weight = np.diag([inverse.characteristic_length] * 3 + [1.0] * 3)
    jacobian = weight @ hand_jacobian(arm, q)
    z = np.zeros(jacobian.shape[1]) + z
    return z + inverse_by_svd(jacobian, inverse) @ (weight @ twist - jacobian @ z)


def nearest(matrix, wanted):
    """Return the hand's twist that comes nearest to a wanted rate of eight numbers."""
    return np.linalg.lstsq(matrix, wanted, rcond=None)[0]
