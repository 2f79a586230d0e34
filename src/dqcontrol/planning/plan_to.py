"""The hand's motion along a plan, timed so that a law that keeps the same constraints lets it pass."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.algebra import DualQuaternion
from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import NoteWarning, ShapeError, ValueRangeError, as_array, as_positive, unknown_name
from dqcontrol.named_fields import NamedFields
from dqcontrol.planning.certified_edges import driven_coordinates
from dqcontrol.planning.constraint_timing import WayTiming, constraint_timing
from dqcontrol.planning.plan import EFFORT, ProvedWay, plan, way_now
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.reference import NO_CORNERS, Reference, SpecStart, Vector
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST, TWIST_RATE
from dqcontrol.references.set_points import SetPoint
from dqcontrol.robots import Robot
from dqcontrol.world import World

Share = Annotated[float, Meta(gt=0, le=1)]


class Goal(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a plan leads.

    Parameters
    ----------
    configuration
        rad or m; or
    position, quaternion, rpy
        the pose of the end effector, m and rad, in the inertial frame, or in the axes of
    body
        one of the world, where it is at the start.
    """

    spec_key: ClassVar[str] = "reference.goal"
    configuration: Annotated[list[float], Meta(min_length=1, description="rad or m")] | None = None
    position: Annotated[Vector, Meta(description="m")] | None = None
    quaternion: Annotated[tuple[float, float, float, float], Meta(description="scalar first")] | None = None
    rpy: Annotated[Vector, Meta(description="roll, pitch, yaw: Rz(y) Ry(p) Rx(r), rad")] | None = None
    body: Annotated[str, Meta(min_length=1)] | None = None

    def pose(self, start: Array) -> Array:
        """Return the pose that it gives, shape (8,); what it leaves out is that of a start pose, of a body none."""
        given = [
            key for key in ("configuration", "position", "quaternion", "rpy", "body") if getattr(self, key)
        ]
        if not given:
            raise ShapeError("goal: give position, quaternion or rpy, body, or configuration")
        if given[0] == "configuration" and len(given) > 1:
            raise ShapeError(f"goal: give either 'configuration' or '{given[1]}'")
        if self.quaternion and self.rpy:
            raise ShapeError("goal: has both 'quaternion' and 'rpy'; leave out one of them")
        left = algebra.pose([1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0]) if self.body else start
        turn = algebra.rotation(left)
        if self.rpy:
            turn = algebra.rotation_from_rpy(self.rpy)
        elif self.quaternion:
            turn = algebra.as_unit_quaternion("goal.quaternion", self.quaternion)
        return algebra.pose(turn, algebra.translation(left) if self.position is None else self.position)

    def target(self, pose: Array, world: World | None) -> Array | DualQuaternion:
        """Return the configuration, or the pose in the inertial frame, that a plan leads to."""
        if self.configuration is not None:
            return np.array(self.configuration, dtype=np.float64)
        if self.body is None:
            return DualQuaternion(pose)
        bodies = world.bodies if world else {}
        if self.body not in bodies:
            raise unknown_name("goal.body", self.body, bodies)
        return DualQuaternion(algebra.multiply(bodies[self.body].pose, pose))


class Again(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When a way is planned again, while the robot is on it.

    Parameters
    ----------
    when
        ``held``: constraints have held the hand against what its law asks for 0.4 s.
    most
        How often.
    """

    spec_key: ClassVar[str] = "reference.again"
    when: Literal["held"] = "held"
    most: Annotated[int, Meta(ge=1, le=100)] = 5


_STEP = 1e-5  # rad or m along the way: rounding and curvature each take 10⁻¹⁰ of a difference
_RAMP = 0.5  # s: no input reaches its full speed sooner, where nothing says how fast it may


def limits_of_ways(
    robot: Robot, kept: PreparedConstraints, speed_fraction: float
) -> tuple[Array, Array, Array]:
    """Return speed, acceleration and braking that coordinates may have, each (n,); see `constraint_timing`.

    Raises
    ------
    ValueRangeError
        If the fraction is none, or an input has no velocity limit.
    """
    fraction = _share("speed_fraction", speed_fraction)
    velocity, driven = robot.limits.velocity, driven_coordinates(robot)
    unknown = np.isinf(velocity) & ~driven[robot.input_coordinates]
    if unknown.any():
        name = robot.input_names[int(unknown.argmax())]
        raise ValueRangeError(f"robot: {name} of {robot.name} has no velocity limit to plan with")
    asked = robot.acceleration_limits("constraints.acceleration", kept.given.acceleration)
    acceleration = np.where(np.isfinite(asked), asked, velocity / _RAMP)
    limits = np.ones((3, robot.configuration_size))  # y of a base that drives, which moves as v and ω say
    limits[:, robot.input_coordinates] = fraction * velocity, fraction * acceleration, asked
    limits[:2][np.isinf(limits[:2])] = 1.0  # of a base that stands any
    return limits[0], limits[1], limits[2]


@dataclass(frozen=True, eq=False, repr=False)
class PlanTo(PlannedWay):
    """The hand's motion while its robot goes a planned way; `laws.GuidedProportional` follows it.

    Speeds and accelerations along the way are the largest that limits allow [Pham and Pham 2018], and no distance d
    that is kept shrinks faster than ρ η (d − kept): so a law that keeps the same constraints has nothing to brake.

    Parameters
    ----------
    plan
        From `plan`.
    speed_fraction
        The most that is used of the limits of velocities and accelerations, 0 … 1. Where constraints limit no
        acceleration, an input takes 0.5 s to its full speed.
    approach
        ρ, 0 … 1.
    again
        When a run plans again from where the robot is then, around all that its law keeps clear of, where that is
        then; never if omitted. A run without a duration then lasts until the robot is there.

    Attributes
    ----------
    duration
        s.

    Raises
    ------
    ValueRangeError
        If a share is no share, or an input has no velocity limit.
    MissingExtraError
        If TOPP-RA is not installed.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, start, goal = dqc.load_robot("panda"), [0, -0.8, 0, -2.4, 0, 1.6, 0.8], [1.5, -0.8, 0, -2.4, 0, 1.6, 0.8]
    >>> post = dqc.world.Body(capsule=(0.05, 1.0), position=(0.3, 0.2, 0.5))
    >>> keep = dqc.constraints.Constraints(world=dqc.World(bodies={"post": post}), clear_of="all", acceleration=10)
    >>> law = dqc.laws.GuidedProportional(gain=2.0, constraints=keep)
    >>> way = dqc.planning.PlanTo(dqc.planning.plan(arm, keep, start, goal))
    >>> record = dqc.simulate(arm, way, law, dqc.plants.Integrator(), start, period=0.01)
    >>> bool(abs(record.q - way.configurations(record.time)).max() < 1e-6)
    True
    """

    kind = "plan-to"
    plans_around = True

    plan: ProvedWay
    speed_fraction: float = 0.9
    approach: float = 0.9
    again: Again | None = None
    robot: Robot = field(init=False, repr=False)
    timing: WayTiming = field(init=False, repr=False)

    def __post_init__(self) -> None:
        robot, kept = self.plan.robot, self.plan.kept
        limits = limits_of_ways(robot, kept, self.speed_fraction)
        timing = constraint_timing(self.plan.way, kept, *limits, _share("approach", self.approach))
        vars(self).update(robot=robot, duration=float(timing.times[-1]), corners=NO_CORNERS, timing=timing)

    @classmethod
    def from_spec(
        cls,
        start: SpecStart,
        *,
        goal: Goal,
        clearance: Annotated[float, Meta(ge=0, description="beyond what constraints ask, m")] = 0.0,
        effort: Annotated[int, Meta(ge=0, le=10_000_000, description="edges looked at")] = EFFORT,
        seed: Annotated[int, Meta(ge=0, le=2**31, description="of the search")] = 0,
        speed_fraction: Share = 0.9,
        approach: Share = 0.9,
        again: Again | None = None,
    ) -> Reference:
        """Go to a goal around what constraints keep clear of; see `dqcontrol.planning.PlanTo`.

        ``goal`` is a pose, of which all configurations count; a ``configuration``; or ``body``, one of the world, in
        whose axes the pose is then given. What is left out of a pose is the end effector's at the start.
        """
        if again is not None and start.place != "reference":
            raise ValueRangeError(
                "again: steps of a sequence are planned once, before anything moves; leave it out"
            )
        return SetPoint(goal.pose(start.pose))

    @classmethod
    def of_robot(
        cls,
        reference: Reference,
        robot: Robot,
        start: Array,
        world: World | None = None,
        kept: PreparedConstraints | None = None,
        *,
        goal: Goal,
        clearance: float = 0.0,
        effort: int = EFFORT,
        seed: int = 0,
        speed_fraction: float = 0.9,
        approach: float = 0.9,
        again: Again | None = None,
    ) -> PlannedWay:
        """Return the way from the start configuration to the goal; see `Reference.of_robot`."""
        if kept is None:
            raise ValueRangeError("plan-to: is the reference of a law, and no further task's")
        target = goal.target(reference.at(0.0).pose, world)
        if not len(robot.drives):
            found = plan(robot, kept, start, target, seed, effort, clearance=clearance)
            timed = cls(found, speed_fraction, approach, again)
            warnings.warn(f"plan: {found}", NoteWarning, stacklevel=2)
            return timed
        from dqcontrol.planning.drive_and_plan import drive_and_plan  # which makes one of these

        if again is not None:
            raise ValueRangeError(
                f"again: the base of {robot.name} cannot go all ways that are planned; leave it out"
            )
        way = drive_and_plan(
            robot,
            kept,
            start,
            target,
            seed,
            effort,
            clearance=clearance,
            speed_fraction=speed_fraction,
            approach=approach,
        )
        warnings.warn(f"plan: {way}", NoteWarning, stacklevel=2)
        return way

    def __str__(self) -> str:
        """Return how long it takes, what is proved of it, and what planning it took, in a line."""
        return f"{self.duration:.3g} s; {self.plan}"

    def is_there(self, q: Array, within: float) -> bool:
        """Return whether all coordinates (n,) are within so much of where the way ends, rad or m."""
        return bool(np.abs(q - self.plan.configurations[-1]).max() <= within)

    def again_from(
        self, kept: PreparedConstraints, q: Array, time: float, seen: Mapping[str, Array]
    ) -> PlanTo:
        """Return a way to the same goal from where the robot is, q (n,), at a time (s); see ``way_now``."""
        old = self.plan
        seed = old.certificate.seed
        found = way_now(kept, q, old.goal, time, seen, seed, old.effort, old.clearance)
        return PlanTo(found, self.speed_fraction, self.approach, self.again)

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        return self.plan.way.at(self.timing.at(as_array("times", times))[0])[0]

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        length, speed, rate = self.timing.at(times)
        q, along, bend = self.plan.way.at(length)
        inputs = self.robot.input_coordinates
        u = (along * speed[:, None])[:, inputs]
        change = (bend * speed[:, None] ** 2 + along * rate[:, None])[:, inputs]
        return samples_of(self.robot, q, u, change)


@dataclass(frozen=True, eq=False, repr=False)
class ResumedWay(PlannedWay):
    """A way up to a time, and from then on another.

    Parameters
    ----------
    before
        The way until then; where it is omitted the robot rests where the other begins.
    time
        s.
    after
        The way from then on.
    """

    plans_around = True

    before: PlannedWay | None
    time: float
    after: PlanTo
    robot: Robot = field(init=False)

    def __post_init__(self) -> None:
        earlier = [] if self.before is None else [each for each in self.before.corners if each < self.time]
        vars(self).update(
            robot=self.after.robot,
            duration=self.time + self.after.duration,
            corners=np.array([*earlier, self.time]),
        )

    def __str__(self) -> str:
        """Return what becomes of it, in a line."""
        return f"{self.time:.3g} s of driving, then {self.after}"

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        when = as_array("times", times)
        return self._joined(when, lambda way, some: way.configurations(some))

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        when = as_array("times", times)
        return self._joined(when, lambda way, some: way.mean_inputs(some, period))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        return self._joined(times, lambda way, some: way.samples(some))

    def _joined(self, times: Array, of: Callable[[PlannedWay, Array], Array]) -> Array:
        found = of(self.after, np.maximum(times - self.time, 0.0))
        early = times < self.time
        if self.before is not None and early.any():
            found[early] = of(self.before, times[early])
        return found


def samples_of(robot: Robot, q: Array, u: Array, change: Array) -> Array:
    """Return samples (N, 21) of a robot at configurations (N, n) with inputs (N, m) and the change of these."""
    sizes = np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    ways = u / sizes  # by differences: of trees no formula of the Jacobian's rate is known
    ahead, behind = (robot.twist_jacobian(robot.integrate(q, ways, step)) for step in (_STEP, -_STEP))
    turns = (ahead - behind) * (sizes / (2.0 * _STEP))[:, :, None]
    out = np.zeros((len(q), SAMPLE_SIZE))
    out[:, POSE] = robot.fkm(q)
    out[:, TWIST] = np.einsum("kij,kj->ki", robot.twist_jacobian(q), u)
    out[:, TWIST_RATE] = np.einsum("kij,kj->ki", robot.twist_jacobian(q), change)
    out[:, TWIST_RATE] += np.einsum("kij,kj->ki", turns, u)
    return out


def _share(field_name: str, value: float) -> float:
    share = as_positive(field_name, value)
    if share > 1:
        raise ValueRangeError(f"{field_name}: must be ≤ 1, got {share:g}")
    return share
