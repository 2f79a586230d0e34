"""The H∞ guarantee in random cases: levels, arms, targets, disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, islice, product

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import as_count
from dqcontrol.laws import FilteredInverse, HInfinity, HInfinityTracking
from dqcontrol.measures.attenuation import Attenuation, Gammas, PremiseError, attenuation
from dqcontrol.plants import BandLimitedTwist, ConstantTwist, Disturbance, SinusoidalTwist, WorstCase
from dqcontrol.references import ViaPoints
from dqcontrol.robots.files.load import load_robot
from dqcontrol.robots.robot import Robot

_ROBOTS = ("iiwa7", "panda", "ur5", "kuka-lwr4", "meka-a2", "barrett-wam")
_LAWS = (HInfinity, HInfinityTracking)
_FORMS = ("right", "left")
_KINDS = ("worst case", "rotation", "constant", "sinusoidal", "band-limited")
_EQUAL = (False, True)
_TRIES = 100


def verify_attenuation(cases: int = 100, seed: int = 0) -> list[Attenuation]:
    """Measure H∞ laws at the least gains for random levels, against random disturbances on several arms.

    Both laws (`HInfinity` at rest, `HInfinityTracking` along a turning path), both forms, equal and unequal γ, and five
    kinds of disturbances take turns: the worst case of the position; a constant push and turn, the turn shared as γ⁻²;
    and constant, sinusoidal and band-limited twists in all six directions. Twist and pose sources act together. A case
    that leaves the premises of the guarantee, mostly by an arm near a singularity, is drawn again (about one in 30).

    Parameters
    ----------
    cases
        How many; all combinations have had a turn after 40.
    seed
        Draws everything.

    Raises
    ------
    PremiseError
        If a hundred draws of one case leave the premises.

    Examples
    --------
    >>> all(row.holds for row in verify_attenuation(cases=8))
    True
    """
    rng = np.random.default_rng(as_count("seed", seed))
    robots = [load_robot(name) for name in _ROBOTS]
    turns = cycle(product(_EQUAL, _FORMS, _LAWS, _KINDS))
    return [_drawn(rng, robots, *turn) for turn in islice(turns, as_count("cases", cases))]


def _drawn(
    rng: np.random.Generator,
    robots: Sequence[Robot],
    equal: bool,
    form: str,
    law: type[HInfinity],
    kind: str,
) -> Attenuation:
    tries = 0
    while True:
        tries += 1
        try:
            return _case(rng, robots[int(rng.integers(len(robots)))], equal, form, law, kind)
        except PremiseError:
            if tries == _TRIES:
                raise


def _case(
    rng: np.random.Generator, robot: Robot, equal: bool, form: str, law: type[HInfinity], kind: str
) -> Attenuation:
    gammas = Gammas(*(_levels(rng, equal) for _ in range(2)))
    k_o, k_t = gammas.orientation_gain, gammas.translation_gain
    slow, fast = sorted((0.5 * k_o, k_t))  # rates of decay
    duration = rng.uniform(20, 40) / slow
    start = _dexterous(rng, robot)
    nearby = start + np.array([[0], [1], [0.5]]) * rng.uniform(-0.15, 0.15, len(start))
    path = ViaPoints(duration * np.array([0, 0.4, 1]), robot.fkm(nearby))
    return attenuation(
        law(
            orientation_gain=k_o,
            translation_gain=k_t,
            form="left" if form == "left" else "right",
            inverse=FilteredInverse(threshold=1e-3, growth=0.0),
        ),
        robot,
        _disturbance(rng, kind, gammas, robot.fkm(start)),
        gammas,
        start=start,
        period=rng.uniform(0.01, 0.1) / fast,
        duration=duration,
        reference=path if law is HInfinityTracking else None,
        seed=int(rng.integers(1 << 31)),
        name=kind,
    )


def _levels(rng: np.random.Generator, equal: bool) -> tuple[float, float]:
    first, second = rng.uniform(0.15, 0.6, 2).tolist()
    return first, first if equal else second


def _dexterous(rng: np.random.Generator, robot: Robot) -> Array:
    """Return the best conditioned of some random configurations."""
    low, high = np.maximum(robot.limits.lower, -1.5), np.minimum(robot.limits.upper, 1.5)
    drawn = rng.uniform(low, high, (64, robot.configuration_size))
    return drawn[np.argmin(robot.condition_number(drawn))]


def _disturbance(rng: np.random.Generator, kind: str, gammas: Gammas, hand: Array) -> Disturbance:
    """Return a disturbance of a kind, in proportion to what the gains can hold."""
    k_o, k_t = gammas.orientation_gain, gammas.translation_gain
    if kind == "worst case":
        level, direction = k_t * rng.uniform(0.02, 0.06), tuple(rng.standard_normal(3).tolist())
        return Disturbance(worst_case=WorstCase(level=level, direction=direction, gammas=gammas.translation))
    if kind == "rotation":
        axis = rng.standard_normal(3)
        rate = k_o * rng.uniform(0.2, 0.7) * axis / np.linalg.norm(axis)
        velocity = 0.03 * k_t * rng.standard_normal(3)
        inertial = np.concatenate([rate, velocity + np.cross(algebra.translation(hand), rate)])
        own = algebra.adjoint_twist(algebra.conjugate(hand), inertial)
        shares = np.array(gammas.orientation) ** -2.0 / np.sum(np.array(gammas.orientation) ** -2.0)
        return Disturbance(
            twist=ConstantTwist(value=tuple(shares[0] * inertial)),
            pose=ConstantTwist(value=tuple(shares[1] * own)),
        )
    scale = np.repeat([0.1 * min(k_o, k_t), 0.03 * k_t], 3)
    twist, pose = (_source(rng, kind, scale * rng.standard_normal(6), k_t) for _ in range(2))
    return Disturbance(twist=twist, pose=pose)


def _source(
    rng: np.random.Generator, kind: str, size: Array, rate: float
) -> ConstantTwist | SinusoidalTwist | BandLimitedTwist:
    six = tuple(size)
    if kind == "constant":
        return ConstantTwist(value=six)
    if kind == "sinusoidal":
        frequency, phase = rate * rng.uniform(0.02, 0.5), rng.uniform(0, 2 * np.pi)
        return SinusoidalTwist(amplitude=six, frequency=frequency, phase=phase)
    return BandLimitedTwist(rms=tuple(np.abs(size)), bandwidth=rate * rng.uniform(0.1, 0.5))
