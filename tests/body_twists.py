"""Twists in the hand's axes, and the one that feedback linearisation asks for, as S17 prints it."""

import numpy as np

from dqcontrol import algebra


def cross(a, b):
    return np.r_[np.cross(a[:3], b[:3]), np.cross(a[:3], b[3:]) + np.cross(a[3:], b[:3])]


def adjoint(x, twist):
    return algebra.adjoint_twist(x, twist)


def body_jacobian(robot, q):
    opposite = algebra.conjugate(robot.fkm(q))
    return np.stack([adjoint(opposite, column) for column in robot.twist_jacobian(q).T], axis=1)


def wanted_twist(robot, q, sample, last_twist, stiffness, damping, period):
    """Return ξ_b + T U as [S17 4.14, 4.18] print it, in terms of body twists."""
    x = robot.fkm(q)
    error = algebra.short(algebra.multiply(algebra.conjugate(sample.pose), x))
    back, opposite = algebra.conjugate(error), algebra.conjugate(sample.pose)
    desired, desired_rate = (
        adjoint(back, adjoint(opposite, part)) for part in (sample.twist, sample.twist_rate)
    )
    error_twist = last_twist - desired
    acceleration = (
        -0.5 * stiffness * algebra.log_body(error)
        - damping * error_twist
        + desired_rate
        + cross(desired, error_twist)
    )
    return last_twist + period * acceleration
