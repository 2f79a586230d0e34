"""The H∞ guarantee, measured: how much of a disturbance a law lets through. [P16 definition 3.1, theorems 3.1–3.2]"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, islice, product

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_count, as_positive
from dqcontrol.laws import FilteredInverse, HInfinity, HInfinityTracking
from dqcontrol.laws.law import Law
from dqcontrol.loop import Record, simulate
from dqcontrol.plants import (
    BandLimitedTwist,
    ConstantTwist,
    Disturbance,
    Integrator,
    SinusoidalTwist,
    WorstCase,
)
from dqcontrol.references import Reference, SetPoint, ViaPoints
from dqcontrol.robots.files.load import load_robot
from dqcontrol.robots.robot import Robot
from dqcontrol.tables.tables import Cell, Column, Table

Pair = tuple[float, float]

_NOTHING = 1e-9  # a disturbance below it has no such part: its error would be divided by round-off


class PremiseError(ValueRangeError):
    """A run outside of what the H∞ guarantee is about: not at zero at first, near a singularity, half a turn away."""


@dataclass(frozen=True)
class Gammas:
    """The levels to which a law shall attenuate twist (first) and pose disturbances (second), s.

    Parameters
    ----------
    orientation, translation
        γ_O1, γ_O2 and γ_T1, γ_T2.

    Examples
    --------
    >>> gammas = Gammas(orientation=(0.5, 0.5), translation=(0.5, 0.5))
    >>> round(0.5 * gammas.orientation_gain, 9), round(0.5 * gammas.translation_gain, 9)
    (2.0, 1.414213562)
    """

    orientation: Pair
    translation: Pair

    def __post_init__(self) -> None:
        for field in ("orientation", "translation"):
            for gamma in as_array(f"gammas.{field}", getattr(self, field), (2,)):
                as_positive(f"gammas.{field}", gamma)

    @property
    def orientation_gain(self) -> float:
        """The least k_O = √2 √(γ_O1⁻² + γ_O2⁻²), 1/s. [P16 theorem 3.1]"""
        return math.sqrt(2) * math.hypot(*(1 / gamma for gamma in self.orientation))

    @property
    def translation_gain(self) -> float:
        """The least k_T = √(γ_T1⁻² + γ_T2⁻²), 1/s. [P16 theorem 3.1]"""
        return math.hypot(*(1 / gamma for gamma in self.translation))


@dataclass(frozen=True)
class Attenuation:
    """What one run let through: errors over what is allowed, in L2; at most 1 where the guarantee holds.

    Parameters
    ----------
    law, form, robot, disturbance
        Names.
    gammas
        The levels asked for.
    orientation, translation
        ‖O‖ / √(γ₁²‖v_w‖² + γ₂²‖v_c‖²) and the same of T; NaN where the disturbance has no such part.
    orientation_sum, translation_sum
        ‖O‖ / (γ₁‖v_w‖ + γ₂‖v_c‖) and the same of T: the bound as printed, weaker by up to √2.
    largest_angle
        rad.
    """

    law: str
    form: str
    robot: str
    disturbance: str
    gammas: Gammas
    orientation: float
    translation: float
    orientation_sum: float
    translation_sum: float
    largest_angle: float

    @property
    def holds(self) -> bool:
        """Whether neither ratio exceeds 1."""
        return not (self.orientation > 1 or self.translation > 1)


def attenuation(
    law: Law,
    robot: Robot,
    disturbance: Disturbance,
    gammas: Gammas,
    *,
    start: ArrayLike,
    period: float,
    duration: float,
    reference: Reference | None = None,
    seed: int = 0,
    name: str = "",
) -> Attenuation:
    """Run a law on ideal joints against a disturbance, and compare its errors with the bound of definition 3.1.

    For the right error x x_d* = r_e + ε½p_e r_e, O = 1 − r_e, T = p_e, and the disturbances are the inertial twists
    v_w and v_c = Ad(x)(2c*ċ): their primary parts bound O, their dual parts T. For the left error x_d*x all is taken
    in the end effector's axes: |T| = |p − p_d|, and the dual parts are velocities of its own point. The bound
    proved is ‖O‖² ≤ γ₁²‖v_w‖² + γ₂²‖v_c‖²; the printed ‖O‖ ≤ γ₁‖v_w‖ + γ₂‖v_c‖ follows from it. [P16 3.26, corrected]
    It is a bound in continuous time: samples add errors of the order of T to those of the disturbance.

    Parameters
    ----------
    law
        `HInfinity` or `HInfinityTracking` in its own form; others by the right error.
    robot
        The arm.
    disturbance
        What acts.
    gammas
        The levels; `Gammas.orientation_gain` and `Gammas.translation_gain` are the least gains for them.
    start
        Configuration at the target, shape (n,), rad or m.
    period, duration
        s. The bound needs k_T T ≤ 1.
    reference
        Begins at the start; rests there if omitted.
    seed
        Of the disturbance.
    name
        Of the disturbance, for the table.

    Raises
    ------
    PremiseError
        If a premise does not hold: zero error at the start, an exact inverse along the whole run, a disturbance that
        the arm can make, an orientation error below half a turn.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.plants import Disturbance, WorstCase
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.HInfinity(orientation_gamma=0.5, translation_gamma=0.5)
    >>> push = Disturbance(worst_case=WorstCase(level=0.05, direction=(1, 0, 0), gammas=(0.5, 0.5)))
    >>> gammas = Gammas(orientation=(0.5, 0.5), translation=(0.5, 0.5))
    >>> row = attenuation(law, arm, push, gammas, start=q, period=0.01, duration=10.0)
    >>> round(row.translation, 2), round(row.translation_sum, 2)
    (0.97, 0.69)
    """
    values = as_array("start", start, (robot.configuration_size,))
    target = reference or SetPoint(robot.fkm(values))
    record = simulate(
        robot, target, law, Integrator(), values, period, duration, disturbance=disturbance, seed=seed
    )
    form = law.form if isinstance(law, HInfinity) else "right"
    error = _error(record, form)
    _check_premises(law, robot, record, error)
    twist, pose = _sources(disturbance, record, seed, form)
    orientation = algebra.rotation(error) - [1, 0, 0, 0]
    (turned, turned_sum), (moved, moved_sum) = (
        _ratios(seen, period, (twist[:-1, part], pose[:-1, part]), levels)  # the last is held no more
        for seen, part, levels in (
            (orientation, slice(0, 3), gammas.orientation),
            (algebra.translation(error), slice(3, 6), gammas.translation),
        )
    )
    return Attenuation(
        law=str(type(law).__struct_config__.tag),
        form=form,
        robot=robot.name,
        disturbance=name or _name(disturbance),
        gammas=gammas,
        orientation=turned,
        translation=moved,
        orientation_sum=turned_sum,
        translation_sum=moved_sum,
        largest_angle=float(record.orientation_error.max()),
    )


def _error(record: Record, form: str) -> Array:
    """Return x x_d* or x_d*x, the sign such that the run begins at 1, shape (N, 8)."""
    opposite = algebra.conjugate(record.desired_pose)
    pair = (opposite, record.pose) if form == "left" else (record.pose, opposite)
    error = algebra.multiply(*pair)
    return math.copysign(1.0, error[0, 0]) * error


def _check_premises(law: Law, robot: Robot, record: Record, error: Array) -> None:
    if record.stopped != "duration":
        raise PremiseError(f"law: the run {record.stopped}")
    if np.abs(error[0] - np.eye(8)[0]).max() > 1e-9:
        raise PremiseError("start: the guarantee is for zero error at the start; start at the reference")
    inverse = getattr(law, "inverse", None)
    if not isinstance(inverse, FilteredInverse):
        raise PremiseError(
            f"law.inverse: must be a FilteredInverse, exact away from singularities, got {inverse}"
        )
    smallest = np.linalg.svd(robot.twist_jacobian(record.q), compute_uv=False)[:, -1].min()
    if robot.input_size < 6 or smallest < inverse.threshold:
        raise PremiseError(
            f"start: the arm comes to a singular value of {smallest:.3g}, where the inverse is not exact; "
            f"it must stay above {inverse.threshold:g}"
        )
    if (error[:, 0] <= 0).any():
        raise PremiseError(
            "disturbance: turns the end effector half a turn from its target, where no law can hold the orientation"
        )


def _sources(disturbance: Disturbance, record: Record, seed: int, form: str) -> tuple[Array, Array]:
    """Return the twists of both sources, inertial for the right form, body twists for the left, (N, 6)."""
    rows = disturbance.samples(record.time, seed)
    twist, pose = rows[:, :6], algebra.adjoint_twist(record.pose, rows[:, 6:])
    if disturbance.worst_case is not None:  # given as one push
        shares = disturbance.worst_case.shares()
        twist, pose = (share / sum(shares) * twist for share in shares)
    miss = np.abs(twist + pose - np.asarray(record.disturbance)).max()
    if miss > 1e-9:
        raise PremiseError(f"start: the arm cannot make the disturbance there; it misses it by {miss:.3g}")
    if form == "left":
        back = algebra.conjugate(record.pose)
        return algebra.adjoint_twist(back, twist), algebra.adjoint_twist(back, pose)
    return twist, pose


def _ratios(error: Array, period: float, sources: tuple[Array, Array], gammas: Pair) -> tuple[float, float]:
    """Return the L2 norm of an error over the root sum of squares and over the sum of γ‖v‖; sums of held values."""
    norm = math.sqrt(period) * float(np.linalg.norm(error))
    levels = zip(gammas, sources, strict=True)
    weighted = [gamma * math.sqrt(period) * float(np.linalg.norm(v)) for gamma, v in levels]
    if math.hypot(*weighted) < _NOTHING:
        return math.nan, math.nan
    return norm / math.hypot(*weighted), norm / sum(weighted)


def _name(disturbance: Disturbance) -> str:
    if disturbance.worst_case is not None:
        return "worst case"
    sources = (disturbance.twist, disturbance.pose)
    return " + ".join(str(type(s).__struct_config__.tag) for s in sources if s is not None)


def attenuation_table(rows: Sequence[Attenuation]) -> Table:
    """Return the largest ratios, one row for each law, form and disturbance.

    Examples
    --------
    >>> gammas = Gammas(orientation=(1, 1), translation=(1, 1))
    >>> rows = [Attenuation("K", "right", "arm", "constant", gammas, 0.6, x, 0.4, 0.5, 0.1) for x in (0.7, 0.9)]
    >>> attenuation_table(rows).rows[0][:6]
    ['K', 'right', 'constant', 2, 0.6, 0.9]
    """
    groups: dict[tuple[str, str, str], list[Attenuation]] = {}
    for row in rows:
        groups.setdefault((row.law, row.form, row.disturbance), []).append(row)
    body: list[list[Cell]] = []
    ratios = ("orientation", "translation", "orientation_sum", "translation_sum")
    for labels, group in groups.items():
        every = ((*(getattr(row, name) for name in ratios), math.degrees(row.largest_angle)) for row in group)
        largest = (
            max((value for value in values if not math.isnan(value)), default=None)
            for values in zip(*every, strict=True)
        )
        body.append([*labels, len(group), *largest, "yes" if all(row.holds for row in group) else "no"])
    columns = [
        Column("Law"),
        Column("Error"),
        Column("Disturbance"),
        Column("Runs"),
        Column("O ÷ root sum", "", ".3f"),
        Column("T ÷ root sum", "", ".3f"),
        Column("O ÷ printed sum", "", ".3f"),
        Column("T ÷ printed sum", "", ".3f"),
        Column("Largest angle", "°", ".0f"),
        Column("Holds"),
    ]
    return Table(columns, body, "Attenuation of disturbances: the largest ratio of error and bound in L2")


_ROBOTS = ("iiwa7", "panda", "ur5", "kuka-lwr4", "meka-a2", "barrett-wam")
_LAWS = (HInfinity, HInfinityTracking)
_FORMS = ("right", "left")
_KINDS = ("worst case", "rotation", "constant", "sinusoidal", "band-limited")
_EQUAL = (False, True)
_TRIES = 100  # cases drawn for one that the theorem is about


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
