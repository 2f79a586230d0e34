"""Stability of a wheeled base under its arm: the centre of mass over wheels and casters, wherever the arm reaches."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.plants.mobile.wheeled_base import Foot, RunningGear, SolidBase
from dqcontrol.robots.robot import Robot

_STARTS, _SWEEPS = 8, 30  # of the search for the worst posture
_SAMPLES = np.array([0.0, 2 * math.pi / 3, -2 * math.pi / 3])
_FARTHEST = 100.0  # m; how far a sliding joint without limits is moved


@dataclass(frozen=True)
class Stance:
    """How a robot stands in the posture of its arm that tips it most.

    Attributes
    ----------
    margin
        Of the centre of mass from the nearest edge of the polygon of wheels and casters, m; negative outside.
    posture
        The arm's joints there, shape (n,), rad or m.
    edge
        Between which wheels and casters that edge runs.
    least_mass
        Chassis mass with which the robot would just stand in all postures, kg; infinite if none does.
    """

    margin: float
    posture: Array
    edge: tuple[str, str]
    least_mass: float


def check_standing(name: str, gear: RunningGear, arm: Robot) -> None:
    """Raise if a robot at rest would fall over in some posture within its joint limits.

    Parameters
    ----------
    name
        Of the robot.
    gear
        What it stands on.
    arm
        What it carries, with inertias, from the floor below the middle of the axle on.

    Raises
    ------
    ValueRangeError
        With how far the centre of mass is outside, and what helps.
    """
    found = _known(gear.base, gear.feet, _Arm(_numbers(arm), arm))
    if found.margin > 0:
        return
    heavier = f"a chassis of more than {found.least_mass:.3g} kg"
    remedies = [heavier] if math.isfinite(found.least_mass) else []
    casters = " and casters" if gear.base.caster_distance is not None else ""
    remedies += [f"wheels{casters} farther apart", "tighter joint limits"]
    posture = ", ".join(f"{value:.2f}" for value in found.posture)
    raise ValueRangeError(
        f"plant.base: {name} would fall over: with its arm at ({posture}) its centre of mass is "
        f"{1e3 * -found.margin:.0f} mm outside the line from the {found.edge[0]} to the {found.edge[1]} "
        f"(chassis {gear.base.mass:g} kg, arm {arm.inertia.mass.sum() if arm.inertia else 0:.3g} kg); "
        f"what helps: {', '.join(remedies[:-1])}, or {remedies[-1]}"
    )


@dataclass(frozen=True)
class _Arm:
    """An arm that equals others with the same numbers."""

    numbers: bytes
    arm: Robot = field(compare=False)


def _numbers(arm: Robot) -> bytes:
    assert arm.inertia is not None
    arrays = arm.chain, arm.parents, arm.limits.lower, arm.limits.upper, arm.inertia.mass, arm.inertia.center
    return b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)


@lru_cache(maxsize=16)
def _known(base: SolidBase, feet: tuple[Foot, ...], arm: _Arm) -> Stance:
    """Return `stance`, which takes a fifth of a second, once for all repeats of a run."""
    return stance(base, feet, arm.arm)


def stance(base: SolidBase, feet: tuple[Foot, ...], arm: Robot) -> Stance:
    """Return how a robot stands in its worst posture.

    With n the outward normal of an edge of the polygon of the feet and d its distance from the middle of the base, the
    robot tips over that edge if Σ m_i (n · c_i − d) > 0, all bodies counted; the middle of the wheels is that of the
    base.
    In a revolute joint that sum is A + B cos q + C sin q, in a sliding one a straight line: from random postures joint
    after joint is set to where it is largest, until nothing grows.

    Parameters
    ----------
    base
        Its masses.
    feet
        Where it stands, counter-clockwise.
    arm
        As for `check_standing`.
    """
    at = np.array([[foot.x, foot.y] for foot in feet])
    along = np.roll(at, -1, axis=0) - at
    normals = np.column_stack([along[:, 1], -along[:, 0], np.zeros(len(at))])
    normals /= np.linalg.norm(along, axis=1)[:, None]
    distances = (normals[:, :2] * at).sum(axis=1)
    q, tipping = _worst_postures(arm, normals, distances)
    own = distances - normals[:, 0] * base.centre_ahead  # of the chassis, for each kilogram
    wheel_mass = len(base.wheel_errors) * base.wheel_mass
    wheels = wheel_mass * distances
    assert arm.inertia is not None
    total = base.mass + wheel_mass + float(arm.inertia.mass.sum())
    margins = (base.mass * own + wheels - tipping) / total
    worst = int(margins.argmin())
    needed = (tipping - wheels) / np.where(own > 0, own, np.nan)
    least = float(needed.max()) if (own > 0).all() else math.inf
    edge = feet[worst].name, feet[(worst + 1) % len(feet)].name
    return Stance(float(margins[worst]), q[worst], edge, least)


def _worst_postures(arm: Robot, normals: Array, distances: Array) -> tuple[Array, Array]:
    """Return for each edge the posture (n,) that tips the robot most over it, and Σ m (n · c − d) of the arm there."""
    slides = np.array([kind == "prismatic" for kind in arm.joint_types])
    reach = np.where(slides, _FARTHEST, math.pi)
    lower, upper = np.maximum(arm.limits.lower, -reach), np.minimum(arm.limits.upper, reach)
    edges, n = len(normals), arm.configuration_size
    q = np.random.default_rng(0).uniform(lower, upper, (edges * _STARTS, n))
    towards, away = np.repeat(normals, _STARTS, axis=0), np.repeat(distances, _STARTS)

    def tipping(at: Array) -> Array:
        return _moments(arm, at, towards, away)

    best = tipping(q)
    for _ in range(_SWEEPS):
        before = best
        for i in range(n):
            q[:, i] = _best_angle(tipping, q, i, lower[i], upper[i], slides=bool(slides[i]))
        best = tipping(q)
        if (best - before).max() < 1e-6 * max(1.0, float(np.abs(best).max())):
            break
    chosen = best.reshape(edges, _STARTS).argmax(axis=1) + _STARTS * np.arange(edges)
    return q[chosen], best[chosen]


def _best_angle(
    tipping: Callable[[Array], Array], q: Array, i: int, lower: float, upper: float, *, slides: bool
) -> Array:
    """Return where joint i, within its limits, makes a sum largest that is sinusoidal or linear in it, shape (N,)."""
    trial = q.copy()

    def at(value: float | Array) -> Array:
        trial[:, i] = value
        return tipping(trial)

    if slides:
        return np.where(at(upper) >= at(lower), upper, lower)
    values = np.array([at(angle) for angle in _SAMPLES])
    cosine, sine = 2 / 3 * np.cos(_SAMPLES) @ values, 2 / 3 * np.sin(_SAMPLES) @ values
    top = np.arctan2(sine, cosine)
    turned = lower + np.mod(top - lower, 2 * math.pi)  # the first angle from the lower limit on
    at_upper, at_lower = (cosine * math.cos(end) + sine * math.sin(end) for end in (upper, lower))
    return np.where(turned <= upper, turned, np.where(at_upper >= at_lower, upper, lower))


def _moments(arm: Robot, q: Array, normals: Array, distances: Array) -> Array:
    """Return Σ m_i (n · c_i − d) of an arm's links at configurations (N, n), one normal (3,) and distance each."""
    assert arm.inertia is not None
    mass, center = arm.inertia.mass, arm.inertia.center
    frames = arm.frames(q)[:, : len(mass)]
    centres = algebra.translation(frames) + _rotated(frames[..., :4], center)
    return np.einsum("i,kij,kj->k", mass, centres, normals) - mass.sum() * distances


def _rotated(rotation: Array, vector: Array) -> Array:
    """Return vectors (…, 3) turned by unit quaternions (…, 4)."""
    w, v = rotation[..., :1], rotation[..., 1:]
    t = 2 * np.cross(v, vector)
    return vector + w * t + np.cross(v, t)
