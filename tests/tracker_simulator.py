"""Poses of arms whose geometry is not what it is said to be, written without the package's corrections."""

import numpy as np

import dqcontrol as dqc
from dqcontrol.algebra import translation
from dqcontrol.robots import SerialArm


def _rotation(vector):
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.array([1.0, 0, 0, 0])
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * vector / angle])


def _moved(row, shift, turn):
    """Return a fixed pose (7,) followed by a small motion."""
    x = dqc.DualQuaternion.from_pose(row[:4], row[4:7]) * dqc.DualQuaternion.from_pose(_rotation(turn), shift)
    return np.concatenate([x.vec8[:4], x.translation])


def spoiled_dh(rng, theta, d, a, alpha, length=1e-3, angle=2e-3, **others):
    """Return an arm of a DH table and one whose parameters are wrong by random amounts."""
    n = len(theta)
    sizes = (theta, angle), (d, length), (a, length), (alpha, angle)
    wrong = [np.asarray(each) + size * rng.normal(size=n) for each, size in sizes]
    return SerialArm.from_dh(theta, d, a, alpha, **others), SerialArm.from_dh(*wrong, **others)


def spoiled(rng, arm, length=1e-3, angle=2e-3):
    """Return an arm whose frames, each of them, are off by random shifts and turns."""
    fixed = [_moved(row, length * rng.normal(size=3), angle * rng.normal(size=3)) for row in arm.chain]
    return SerialArm(
        np.array(fixed), arm.joint_types, limits=arm.limits, joint_names=arm.joint_names, name=arm.name
    )


def measured(rng, arm, count, noise=1e-4, turn_noise=2e-4, base=None, tool=None):
    """Return joint positions (N, n), measured positions (N, 3) and orientations (N, 4)."""
    lower, upper = np.maximum(arm.limits.lower, -2.0), np.minimum(arm.limits.upper, 2.0)
    q = rng.uniform(lower, upper, (count, arm.configuration_size))
    left = dqc.DualQuaternion.identity() if base is None else base
    right = dqc.DualQuaternion.identity() if tool is None else tool
    poses = [left * dqc.DualQuaternion(each) * right for each in arm.fkm(q)]
    position = np.array([each.translation for each in poses]) + noise * rng.normal(size=(count, 3))
    turned = [
        (dqc.DualQuaternion.from_pose(_rotation(turn_noise * rng.normal(size=3)), [0, 0, 0]) * each).vec8[:4]
        for each in poses
    ]
    return q, position, np.array(turned)


def write_poses(path, q, position, rotation=None, unit=""):
    """Write a table of measured poses."""
    names = [f"q{i + 1}" for i in range(q.shape[1])] + [f"{name}{unit}" for name in "xyz"]
    columns = [q, position]
    if rotation is not None:
        names += ["qw", "qx", "qy", "qz"]
        columns.append(rotation)
    np.savetxt(path, np.hstack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.10g")
    return path


def hand_error(rng, true, model, count=300):
    """Return the RMS distance (m) of two arms' hands over random configurations."""
    lower, upper = np.maximum(true.limits.lower, -2.0), np.minimum(true.limits.upper, 2.0)
    q = rng.uniform(lower, upper, (count, true.configuration_size))
    away = translation(model.fkm(q)) - translation(true.fkm(q))
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
