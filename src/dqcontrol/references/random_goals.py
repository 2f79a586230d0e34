"""Random goals that a robot can reach, the same ones for everybody who names the same numbers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import translation
from dqcontrol.errors import ValueRangeError, as_array, as_count, as_positive
from dqcontrol.robots import Robot
from dqcontrol.robots.robot import base_coordinates

_MOST_DRAWS = 1000  # for each goal


def random_goals(
    robot: Robot,
    start: ArrayLike,
    count: int = 100,
    *,
    reach: float,
    heading: float = math.pi,
    arm: float = math.inf,
    lowest: float = 0.05,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Return configurations whose poses a robot may be tried with: uniform around a start, within its limits.

    Each base is moved by up to ± reach in x and in y and turned by up to ± heading, each joint by up to ± arm, as far
    as its limits go. A configuration with the end effector lower than ``lowest`` is drawn again. So each goal can be
    reached; that a law finds its way there from the start is not said.

    Parameters
    ----------
    robot
        An arm or a whole body.
    start
        Configuration in the middle of them, shape (n,), rad or m.
    count
        How many; the first of many are those of few.
    reach
        Half the side of the box for each base, m.
    heading
        rad.
    arm
        rad or m; the whole range of each joint if infinite. A joint without limits needs a finite one.
    lowest
        Least height of the end effector, z in the inertial frame, m; −inf for any.
    seed
        Of the random numbers.

    Returns
    -------
    configurations : ndarray, shape (count, n)
        ``robot.fkm(configurations)`` are the goals.

    Raises
    ------
    ShapeError, ValueRangeError
        If a size or number is wrong, or hardly a configuration has the end effector high enough.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> robot, start = dqc.load_robot("little-john"), [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    >>> goals = robot.fkm(dqc.references.random_goals(robot, start, 100, reach=1.5, seed=1))
    >>> goals.shape
    (100, 8)
    """
    middle = as_array("start", start, (robot.configuration_size,))
    bases = np.flatnonzero(base_coordinates(robot))
    away = np.full(len(middle), arm if arm == math.inf else as_positive("arm", arm, zero_allowed=True))
    away[bases] = as_positive("reach", reach, zero_allowed=True)
    away[bases[2::3]] = as_positive("heading", heading, zero_allowed=True)
    lower = np.maximum(middle - away, robot.limits.lower)
    upper = np.minimum(middle + away, robot.limits.upper)
    if not np.isfinite(upper - lower).all():
        raise ValueRangeError("arm: must be finite, because a joint has no limits")
    if (lower > upper).any():
        raise ValueRangeError(
            f"start: {robot.joint_names[int(np.argmax(lower > upper))]} is outside its limits"
        )
    count = as_count("count", count)
    random = np.random.default_rng(seed)
    found = np.empty((0, len(middle)))
    for _ in range(_MOST_DRAWS):
        drawn = random.uniform(lower, upper, (count, len(middle)))
        high = translation(robot.fkm(drawn))[:, 2] >= lowest
        found = np.vstack([found, drawn[high]])
        if len(found) >= count:
            return found[:count]
    raise ValueRangeError(
        f"lowest: {lowest:g} m is higher than the end effector comes in almost any configuration"
    )
