"""A law and a motion of one's own, for examples/own.yaml."""

import numpy as np

import dqcontrol as dqc


def damped_transpose(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """q̇ = k Jᵀ vec8(x_d − x), its changes smoothed over some samples."""
    for i in range(out.shape[0]):
        wanted = 0.0
        for k in range(8):
            wanted += parameters[0] * pose_jacobian[k, i] * (sample[k] - pose[k])
        state[i] += parameters[1] * (wanted - state[i])
        out[i] = state[i]


def lissajous(start, size, duration):
    """Return a figure of eight, m and s, that begins at the start pose (8,)."""
    place, rate = dqc.algebra.translation(start), 2 * np.pi / duration

    def position(t):
        return place + size * np.array([0.0, np.sin(rate * t), 0.5 * np.sin(2 * rate * t)])

    return dqc.references.Curve(position, duration, start)
