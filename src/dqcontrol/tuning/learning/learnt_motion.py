"""The shift of a reference that is learnt, in the inertial axes, and the motion that it makes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.files.whole_file import whole_file
from dqcontrol.measures.metrics import low_passed
from dqcontrol.references import Points
from dqcontrol.references.points_file import DUAL_QUATERNION
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.tuning.learning.convergence import Convergence

_TAPER = 1.0  # s, in which errors fade beyond both ends of a record
TRACKED_POSE = "tracked_pose"  # among the readings of a record: where a tracker saw the end effector, (N, 8)
LEVER = 0.3  # m: so far from its axis a turn counts as a way


def hand_error(desired: Array, poses: Array) -> Array:
    """Return [rotation vector of r_d r*; p_d − p] of poses (N, 8), shape (N, 6), rad and m, inertial axes."""
    relative = algebra.multiply(_rotations(desired), algebra.conjugate(_rotations(poses)))
    relative = relative * np.where(relative[:, :1] < 0, -1.0, 1.0)
    turns = 2 * algebra.log_body(relative)[:, :3]
    return np.hstack([turns, algebra.translation(desired) - algebra.translation(poses)])


def shifted_poses(desired: Array, shift: Array) -> Array:
    """Return [exp(w_rot) r_d ; p_d + w_p] of poses (N, 8) and shifts (N, 6)."""
    half = np.zeros((len(shift), 6))
    half[:, :3] = shift[:, :3] / 2
    turned = algebra.multiply(algebra.exp_screw(half), _rotations(desired))
    return algebra.pose(turned[:, :4], algebra.translation(desired) + shift[:, 3:])


def _rotations(poses: Array) -> Array:
    out = np.zeros_like(poses)
    out[:, :4] = poses[:, :4]
    return out


def motion_of(samples: Array, shift: Array) -> Points:
    """Return the motion that goes through shifted samples: its twists are those from each to the next."""
    return Points(samples[:, TIME], shifted_poses(samples[:, POSE], shift))


def filtered(time: Array, values: Array, cutoff: float) -> Array:
    """Return values (N, k) without what is faster than the cut-off: Q of `Convergence`."""
    return low_passed(time, values, cutoff)


def increment(convergence: Convergence, time: Array, error: Array) -> Array:
    """Return Q L Q e, the change of the shift that an error (N, 6) asks for."""
    count = len(time)
    beyond = max(int(_TAPER / convergence.shape.period), 1)
    fade = (0.5 + 0.5 * np.cos(np.pi * np.arange(1, beyond + 1) / (beyond + 1)))[:, None]
    smooth = filtered(time, error, convergence.cutoff)
    size = 1 << int(np.ceil(np.log2(2 * count + 2 * beyond)))
    joined = np.zeros((size, error.shape[1]))
    joined[:count] = smooth
    joined[count : count + beyond] = fade * smooth[-1]  # a jump to 0 would be learnt
    joined[size - beyond :] = fade[::-1] * smooth[0]  # before the start, as the transform goes round
    spectrum = np.fft.rfft(joined, axis=0)
    frequencies: Array = np.asarray(np.fft.rfftfreq(size, convergence.shape.period), dtype=np.float64)
    spectrum *= convergence.operator(frequencies)[:, None]
    wanted = np.fft.irfft(spectrum, size, axis=0)[:count]
    return filtered(time, wanted, convergence.cutoff)


def weighted_norm(error: Array) -> float:
    """Return the root of the mean square of errors (N, 6) as ways, m: turns at the end of a lever."""
    return float(
        np.sqrt(np.mean(np.sum(error[:, 3:] ** 2, axis=1) + LEVER**2 * np.sum(error[:, :3] ** 2, axis=1)))
    )


def start_weights(time: Array, skip: float) -> Array:
    """Return 0 up to a time, 1 from its double on, smooth between, shape (N, 1)."""
    if not skip:
        return np.ones((len(time), 1))
    share = np.clip((time - skip) / skip, 0.0, 1.0)
    return (share * share * (3 - 2 * share))[:, None]


def write_motion(path: str | os.PathLike[str], motion: Points, notes: Sequence[str]) -> None:
    """Write a points file that gives the same motion to the last digits; comments first."""
    rows = np.column_stack([np.asarray(motion.times), np.asarray(motion.poses)])
    lines = [f"# {note}" for note in notes] + [", ".join(("time", *DUAL_QUATERNION))]
    lines += [", ".join(f"{value:.17g}" for value in row) for row in rows.tolist()]
    with whole_file(Path(path)) as draft:
        draft.write_text("\n".join(lines) + "\n", encoding="utf-8")
