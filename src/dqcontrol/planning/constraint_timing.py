"""Timing of a way that laws with constraints let pass: time-optimal [Pham and Pham 2018], and slow where it is narrow.

Such a law holds d' ≥ −η (d − kept). A plan that passes something faster is braked there, and the robot leaves it; so
−ρ η (d − kept) is a limit of the speed along the way, with ρ below 1. It also lets no command pass after which its
inputs, all braked as hard as they may be, would come too near: where that is so the way is passed more slowly.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import Error, from_extra
from dqcontrol.laws.law import check_steps
from dqcontrol.planning.base_path import BasePath
from dqcontrol.planning.smooth_way import SmoothWay
from dqcontrol.robots import Robot
from dqcontrol.robots.kinematics.driving import RIM_LEVER

# rad or m between points of the grid: 1° of a joint, over which a distance changes nearly evenly
_STEP = 0.02
_LEAST_POINTS = 16  # of a part's grid
# 22 %: speeds between two points are then 0.5 % above what the distance lets pass; ρ leaves 10 %
_STEEP = 0.2
_ROUNDS = 8  # of making a grid finer
_FINEST = 1e-4  # rad or m between its points
_NARROW = 5e-3  # rad or m: the same where distances limit the speed, whose rates jump where other points are nearest
_STOPS = 6  # instants of braking that are looked at, twice as many as the law looks at
_INSTANT = 1e-4  # s: in it a distance changes evenly, and by more than rounding
_KEPT_SHARE = 0.98  # of η that commands of samples use at most
_SLOWER = 0.85  # how much slower is passed what the law would brake
_SLOWED = 20  # how often: to 4 % of the speed at the last
_CREEP = 1e-3  # rad/s or m/s: what touches already is left this fast, at least


class WayTiming(NamedTuple):
    """When a way is where: between instants its speed along it changes evenly.

    Attributes
    ----------
    times, lengths, speeds
        Of the instants, shape (G,): s, rad or m, rad/s or m/s.
    """

    times: Array
    lengths: Array
    speeds: Array

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return length, speed and acceleration along the way at times (N,), s."""
        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        steps = np.diff(self.times)
        rate = np.diff(self.speeds) / steps
        after = np.clip(times - self.times[k], 0.0, steps[k])
        speed = self.speeds[k] + rate[k] * after
        length = self.lengths[k] + after * 0.5 * (self.speeds[k] + speed)
        return np.minimum(length, self.lengths[-1]), speed, rate[k]


def constraint_timing(
    way: SmoothWay | BasePath,
    kept: PreparedConstraints,
    velocity: Array,
    acceleration: Array,
    brake: Array,
    approach: float,
) -> WayTiming:
    """Return the fastest timing from rest to rest within limits that constraints do not brake.

    Parameters
    ----------
    way
        Where to go; it rests at its corners.
    kept
        The constraints.
    velocity, acceleration
        Limits of the coordinates, shape (n,); of a driven base those of v and ω in the columns of x and φ.
    brake
        How hard the law lets each of them brake, shape (n,).
    approach
        ρ, share of η at which distances shrink at most.

    Raises
    ------
    MissingExtraError
        If TOPP-RA is not installed.
    Error
        If there is no timing.
    """
    times, lengths, speeds = [np.zeros(1)], [np.zeros(1)], [np.zeros(1)]
    for part in way.parts():
        grid, speed = _timed(part, kept, velocity, acceleration, brake, approach)
        times.append(times[-1][-1] + _instants(grid, speed)[1:])
        lengths.append(lengths[-1][-1] + grid[1:])
        speeds.append(speed[1:])
    return WayTiming(*map(np.concatenate, (times, lengths, speeds)))


def _timed(
    part: SmoothWay | BasePath,
    kept: PreparedConstraints,
    velocity: Array,
    acceleration: Array,
    brake: Array,
    approach: float,
) -> tuple[Array, Array]:
    """Return the grid of a part without corners, and the speed at its points."""
    toppra = from_extra("toppra", "plan", "timings of plans")
    grid, fastest = _grid_and_limit(part, kept, velocity, approach)
    turning = toppra.constraint.JointVelocityConstraint(velocity)
    braking = toppra.constraint.JointAccelerationConstraint(np.column_stack([-acceleration, acceleration]))
    path = _Path(part, len(velocity))
    for tried in range(_SLOWED):
        limits = [turning, braking, _speed_limit(toppra, fastest, len(velocity))]
        timed = toppra.algorithm.TOPPRA(limits, path, gridpoints=grid)
        speeds = timed.compute_parameterization(0.0, 0.0)[1]
        if speeds is None or not np.isfinite(speeds).all() or (speeds[:-1] + speeds[1:] <= 0).any():
            break
        too_fast = _too_fast(part, kept, grid, speeds, brake)
        if not too_fast.any() or tried == _SLOWED - 1:  # the law brakes the rest, where it creeps anyway
            return grid, speeds
        fastest = np.where(too_fast, np.maximum(_SLOWER * np.minimum(fastest, speeds), _CREEP), fastest)
    raise Error("plan: no timing of the way keeps the limits")


def _too_fast(
    part: SmoothWay | BasePath, kept: PreparedConstraints, grid: Array, speeds: Array, brake: Array
) -> NDArray[np.bool_]:
    """Return at which points of a grid the law would not let a sample's command pass."""
    near = np.zeros(len(grid), dtype=bool)
    timing = WayTiming(_instants(grid, speeds), grid, speeds)
    check_steps("period", float(timing.times[-1]) / kept.period)
    samples = np.arange(0.0, timing.times[-1], kept.period)
    begins, ends = timing.at(samples)[0], timing.at(samples + kept.period)[0]
    moved = (part.driven(ends) - part.driven(begins))[:, kept.robot.input_coordinates]
    short = is_braked(kept, part.at(begins)[0], moved / kept.period, brake[kept.robot.input_coordinates])
    for begin, end in zip(begins[short], ends[short], strict=True):
        first = np.searchsorted(grid, begin, side="right") - 1
        near[max(first, 0) : np.searchsorted(grid, end) + 1] = True
    return near & (speeds > _CREEP)


def is_braked(kept: PreparedConstraints, q: Array, u: Array, brake: Array) -> NDArray[np.bool_]:
    """Return at which of configurations (N, n) the law would not let the inputs (N, m) of a period pass.

    It asks ∇d·u ≥ −η (d − kept) of the mean u of the coming period, which a bend or acceleration makes more than the
    speed at its begin. And the way to rest must be clear, on which an input makes T Σ max(|u| − i a T, 0) in i = 0 … k
    further periods; a, ``brake``, has shape (m,).
    """
    robot, times, need = kept.robot, np.zeros(len(q)), kept.asked + kept.allowances
    values = kept.values(q, times)
    ahead, behind = robot.integrate(q, u, _INSTANT), robot.integrate(q, u, -_INSTANT)
    rates = (kept.values(ahead, times) - kept.values(behind, times)) / (2.0 * _INSTANT)
    short = (rates < -_KEPT_SHARE * kept.rate * (values - need)).any(axis=1)
    loss = brake * kept.period
    steps_to_rest = np.floor(np.abs(u) / loss)
    needed = np.minimum(values, need)
    for share in np.arange(1, _STOPS + 1) / _STOPS:
        count = np.minimum(np.ceil(share * steps_to_rest.max(axis=1, keepdims=True)), steps_to_rest)
        with np.errstate(invalid="ignore"):
            lost = np.where(count > 0, 0.5 * loss * count * (count + 1.0), 0.0)
        there = robot.integrate(q, np.sign(u) * ((count + 1.0) * np.abs(u) - lost), kept.period)
        short |= (kept.values(there, times) < needed).any(axis=1)
    return np.asarray(short)


def _instants(grid: Array, speeds: Array) -> Array:
    """Return when points of a grid are passed, s, from 0 on."""
    return np.concatenate([[0.0], np.cumsum(2.0 * np.diff(grid) / (speeds[:-1] + speeds[1:]))])


class _Path:
    """A way as TOPP-RA takes it."""

    waypoints = None

    def __init__(self, way: SmoothWay | BasePath, n: int) -> None:
        self._way = way
        self.dof = n
        self.path_interval: Array = np.array([0.0, way.begins[-1]])

    def __call__(self, lengths: ArrayLike, order: int = 0) -> Array:
        """Return the way or a derivative of it at lengths, shape (N,) or ()."""
        found = self._way.at(np.atleast_1d(np.asarray(lengths, np.float64)))[order]
        return found if np.ndim(lengths) else found[0]


def _speed_limit(toppra: Any, fastest: Array, n: int) -> Any:
    """Return a limit of the speed along the path at each point of the grid, as TOPP-RA takes it."""

    class SpeedLimit(toppra.constraint.LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.dof = n

        def compute_constraint_params(self, *_: object) -> tuple[Any, ...]:
            return (*[None] * 6, np.column_stack([np.zeros(len(fastest)), fastest**2]))

    return SpeedLimit()


def _grid(part: SmoothWay | BasePath) -> Array:
    """Return lengths at which a part is looked at: ends of its pieces, and between them."""
    step = min(_STEP, part.begins[-1] / _LEAST_POINTS)
    inner = [
        np.linspace(a, b, math.ceil((b - a) / step) + 1)[:-1]
        for a, b in zip(part.begins[:-1], part.begins[1:], strict=True)
    ]
    return np.concatenate([*inner, part.begins[-1:]])


def _grid_and_limit(
    part: SmoothWay | BasePath, kept: PreparedConstraints, velocity: Array, approach: float
) -> tuple[Array, Array]:
    """Return a grid, and how fast the way may be passed at its points.

    It is finer where distances limit that, and the faster they change it: between its points TOPP-RA lets squares of
    speeds change evenly, which is faster than the speeds themselves would.
    """
    grid = _grid(part)
    rounds = 0
    while True:
        q, along, _ = part.at(grid)
        turning = _turning(kept.robot, along, velocity)
        fastest = np.clip(np.minimum(_approaching(kept, q, grid, approach), turning), _CREEP, None)
        narrow = fastest < turning
        size = np.diff(grid)
        coarse = (np.abs(np.diff(np.log(fastest))) > _STEEP) & (size > _FINEST)
        coarse |= (narrow[1:] | narrow[:-1]) & (size > _NARROW)
        if rounds == _ROUNDS or not coarse.any():
            return grid, fastest
        grid = np.sort(np.concatenate([grid, 0.5 * (grid[:-1] + grid[1:])[coarse]]))
        rounds += 1


def _approaching(kept: PreparedConstraints, q: Array, grid: Array, approach: float) -> Array:
    """Return the speeds at which no distance shrinks faster than it may."""
    values = kept.values(q, np.zeros(len(grid)))
    room = np.maximum(values - (kept.asked + kept.allowances), 0.0)
    shrinks = np.maximum(-np.diff(values, axis=0) / np.diff(grid)[:, None], 0.0)
    nearer = np.maximum(np.vstack([shrinks, shrinks[-1:]]), np.vstack([shrinks[:1], shrinks]))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(nearer > 0, approach * kept.rate * room / nearer, np.inf).min(axis=1, initial=np.inf)


def _turning(robot: Robot, along: Array, velocity: Array) -> Array:
    """Return the speeds at which no input, and no rim of a base, is faster than it may be."""
    with np.errstate(divide="ignore"):
        fastest = (velocity / np.abs(along)).min(axis=1)
        for drive in robot.drives:
            i = int(drive[0])
            rim = np.abs(along[:, i]) + drive[RIM_LEVER] * np.abs(along[:, i + 2])
            fastest = np.minimum(fastest, velocity[i] / rim)
    return fastest
