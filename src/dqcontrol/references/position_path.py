"""The positions of a reference as rows of times and shifts, as bodies of a world move by them."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.references.reference import Reference
from dqcontrol.references.sample import POSE

_EXACT = 1e-4  # m that a straight line between two rows may be off
_FIRST, _MOST = 16, 16_384  # rows
_TURNED = 1e-6  # of an orientation's numbers: what turns by less does so by rounding


def position_path(reference: Reference) -> Array:
    """Return rows [t, x, y, z] of a reference, shape (N, 4), s and m: shifts from its first position.

    Between rows it is off a straight line by at most 0.1 mm. They are the ``path`` of a `world.Motion`.

    Parameters
    ----------
    reference
        A motion with an end that does not turn.

    Raises
    ------
    ValueRangeError
        If it never ends, turns, or is so long and bent that it takes more than 16 000 rows.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> circle = dqc.references.Circle(start=[1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=4.0)
    >>> rows = position_path(circle)
    >>> rows[[0, -1], 0].tolist()  # s
    [0.0, 4.0]
    >>> rows[0, 1:].tolist()  # m
    [0.0, 0.0, 0.0]
    """
    if not math.isfinite(reference.duration):
        raise ValueRangeError("it never ends; give its duration")
    rows = _FIRST
    while True:
        even = np.linspace(0.0, reference.duration, 2 * rows + 1)
        times = np.unique(np.concatenate([even[::2], reference.corners]))
        middles = 0.5 * (times[:-1] + times[1:])
        poses = reference.samples(np.concatenate([times, middles]))[:, POSE]
        at, between = np.split(translation(poses), [len(times)])
        if 1.0 - np.abs(poses[:, :4] @ poses[0, :4]).min() > _TURNED:
            raise ValueRangeError("it turns, and bodies that move by themselves keep their orientation")
        off = np.linalg.norm(between - 0.5 * (at[:-1] + at[1:]), axis=1)
        if off.max() <= _EXACT:
            return np.column_stack([times, at - at[0]])
        rows *= 2
        if rows > _MOST:
            raise ValueRangeError(
                f"it takes more than {_MOST:,} straight lines of which none is {1e3 * _EXACT:g} mm off"
            )
