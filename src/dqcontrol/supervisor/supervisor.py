"""The supervisor: the last stage between a law and a robot, which lets out what is safe."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.contact.tool import Tool
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_each, as_positive, unknown_name
from dqcontrol.geometry import FloorMap
from dqcontrol.named_fields import NamedFields
from dqcontrol.references.ways_around import body_points
from dqcontrol.robots import WholeBody
from dqcontrol.robots.kinematics.driving import TURNING_RADIUS
from dqcontrol.robots.robot import Robot, base_coordinates
from dqcontrol.robots.tree_robot import TreeRobot
from dqcontrol.robots.whole_body import Base
from dqcontrol.supervisor import supervisor_layout as layout
from dqcontrol.supervisor.prepared_supervisor import PreparedSupervisor, tree_of
from dqcontrol.world import Footprint, World, footprint


class KeepOutZones(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What bodies of the world take of the floor, which the footprint of a mobile base keeps out of.

    Parameters
    ----------
    clear_of
        ``all`` bodies that stand still, but planes, or some by name.
    world
        Whose bodies these are; a spec gives its own.
    footprint
        Radius of a disc about the base's (x, y) that holds the base, m; that of its shapes if omitted.
    margin
        Kept beside, m, for what is not known: the base drives on at its speed while its measurement is late and its
        motors lag, so at least its speed times both delays.

    Examples
    --------
    A base that is told to drive on stops 5 cm and its radius before a column:

    >>> import numpy as np, dqcontrol as dqc
    >>> column = dqc.world.Body(cylinder=(0.2, 1.0), position=(1, 0, 0.5))
    >>> zones = KeepOutZones(world=dqc.World(bodies={"column": column}), footprint=0.3)
    >>> cart = dqc.WholeBody([dqc.DifferentialDrive(0.05, 0.15, rim_speed=0.5)])
    >>> given = dqc.supervisor.Supervisor(keep_out=zones, slow_below=0.0, hold_below=0.0)
    >>> supervisor, q = given.prepare(cart, period=0.02), np.zeros(3)
    >>> state = supervisor.start(q)
    >>> for _ in range(200):
    ...     q = cart.integrate(q, supervisor.command(q, np.array([0.5, 0.0]), state), 0.02)
    >>> float(q[0].round(2)), "keep-out zone" in supervisor.reasons(state)
    (0.45, True)
    """

    spec_key: ClassVar[str] = "supervisor.keep_out"
    clear_of: Literal["all"] | Annotated[list[str], Meta(min_length=1)] = "all"
    world: World | None = None
    footprint: Annotated[float, Meta(gt=0, description="m")] | None = None
    margin: Annotated[float, Meta(ge=0, description="m")] = 0.05

    @property
    def footprints(self) -> dict[str, Footprint]:
        """What each body takes of the floor, by name.

        Raises
        ------
        Error
            If there is no world, it has no such body, or that does not stand still.
        """
        field = "supervisor.keep_out.clear_of"
        if self.world is None:
            raise ShapeError(f"{field}: names bodies of the world, and there is none; give 'world'")
        bodies = self.world.bodies
        stand = [name for name, body in bodies.items() if body.role == "fixed" and body.plane is None]
        for name in () if self.clear_of == "all" else self.clear_of:
            if name not in bodies:
                raise unknown_name(field, name, tuple(bodies))
            if name not in stand:
                raise ValueRangeError(
                    f"{field}: '{name}' takes no place on the floor that is always the same"
                )
        chosen = stand if self.clear_of == "all" else self.clear_of
        return {name: footprint(bodies[name]) for name in chosen}

    def rows(self) -> Array:
        """Return all as ``supervisor_step.clearance`` takes it, shape (N, 6)."""
        found = [np.zeros((0, layout.ZONE_COLUMNS))]
        for each in self.footprints.values():
            x, y, radius = each.discs.T
            found.append(np.column_stack([x, y, x, y, radius, np.ones(len(x))]))
            found.append(_edges(each.floor))
        return np.vstack(found)

    def footprint_of(self, robot: Robot) -> float:
        """Return the radius of the footprint of a robot's base, m.

        Raises
        ------
        ShapeError
            If the robot does not stand on one mobile base.
        ValueRangeError
            If its base has no shapes, and no radius is given.
        """
        if not isinstance(robot, WholeBody) or not isinstance(robot.parts[0], Base) or len(robot.bases) > 1:
            raise ShapeError(
                f"supervisor.keep_out: is for robots whose first part is their only mobile base; {robot.name} is not"
            )
        if self.footprint is not None:
            return self.footprint
        body = body_points(robot, np.zeros(robot.configuration_size))
        own = ~body.carried
        if not own.any():
            raise ValueRangeError(
                f"supervisor.keep_out.footprint: the base of {robot.name} has no shapes; give the radius of a disc "
                "about its x, y that holds it, m"
            )
        return float((np.linalg.norm(body.points[own, :2], axis=1) + body.radius[own]).max())


def _edges(floor: FloorMap) -> Array:
    """Return the edges of all polygons as rows of zones."""
    found = []
    for corners in floor.polygons:
        rows = np.zeros((len(corners), layout.ZONE_COLUMNS))
        rows[:, :2], rows[:, 2:4] = corners, np.roll(corners, -1, axis=0)
        rows[-1, -1] = 1.0
        found.append(rows)
    return np.vstack(found) if found else np.zeros((0, layout.ZONE_COLUMNS))


_LONGEST_WINDOW = 10_000  # samples
_STALE_PERIODS = 1.5  # half a period of jitter is allowed
_LONGEST_STEP = 0.05  # s between two steps, if that is more than what is stale
# at least, before joints that do not change count as frozen: commands take a while to arrive
_FROZEN_PERIODS = 5
_LONGEST_RAMP = 60.0  # s
_GRAVITY = 9.81  # m/s², along −z of the inertial frame
_NEVER = 1e9  # as a bound of what is not to be watched

PerInput = Annotated[float, Meta(gt=0)] | list[Annotated[float, Meta(gt=0)]]


class LinkPoint(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A point fixed to the link that a joint moves, m, in the frame of that joint: its centre if omitted."""

    joint: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


class WorkspaceBox(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the end effector may be: a box along the inertial axes, m; and other points that are to stay in it."""

    spec_key: ClassVar[str] = "supervisor.workspace"
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    points: list[LinkPoint] = msgspec.field(default_factory=list)


class Supervisor(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bounds on what leaves for the robot, whatever the law says, and when to stop.

    The end effector is the end of a chain; of a tree, and of two arms, it is each frame of what the law drives: both
    are to be in the box and below the speed. The singular values are those of what the law drives.

    The supervisor keeps a position command p and moves it; all bounds are on p and its rates, not on the law's u (where
    u is counted from the measured joints, it also holds the arm against gravity: 14 rad/s on average in [P16]). Each
    period p moves by T v with |v| ≤ velocity (the whole command scaled, so that the end effector keeps its direction),
    |v − v_before| ≤ T acceleration, and such that braking at that acceleration ends within the position limits and in
    the box. Jerk is bounded by the mean of the last rates, which keeps the other bounds. Where limits that change, or a
    start outside them, cannot be kept at once, p brakes and comes back within its acceleration, and that is said.

    It stops, at the acceleration limit, on two bad samples in a row (measurement too old, not finite or out of reach
    of the last one, command not finite; the first of them brakes already), and at once on a gap in time, on joints or a
    end effector measured outside, too fast or frozen, on too large efforts and forces, on a tracking error |q − p|
    beyond its bound and on request; it then stays so until it is reset, and brings p back to the measured joints before
    it follows the law again. This is software in a loop that is not hard real time: it stands beside the robot's own
    safety, not in its place.

    Parameters
    ----------
    velocity
        Of inputs, rad/s or m/s: one number, or one an input; the robot's own limits if omitted.
    acceleration
        rad/s² or m/s²: one number, or one an input.
    jerk
        rad/s³ or m/s³; not bounded if omitted. It delays commands by about acceleration/jerk.
    position_margin
        Kept from the robot's position limits, rad or m.
    tracking_error
        |q − p| that stops, rad or m, joints only: one number, or one an input.
    stale_after
        Age of a measurement at which it no longer counts, and time between two steps that stops, s; for steps 1.5
        periods at least. If omitted 1.5 periods, and for steps 50 ms if that is more.
    slow_below, hold_below
        Smallest singular value of the end effector's Jacobian [ω ; ṗ] (rad and m) below which motions towards a
        singularity are slowed, and below which they are held until it exceeds the mean of both. Motions away are free.
        0: off.
    workspace
        Box that the end effector, and other points of links, stay in; anywhere if omitted.
    ramp
        Time in which speed comes up after a start and goes down at a soft stop, s.
    hand_speed
        Of the commanded end effector, m/s; not bounded if omitted. While joints brake, up to a tenth more.
    hand_acceleration
        Of the commanded end effector while it follows the law, m/s²; not bounded if omitted. Stops brake as hard as
        joints may.
    measured_tolerance
        How far measured joints may be beyond the robot's limits, and the measured end effector outside the box, rad or
        m.
    overspeed
        Measured speed of a joint, smoothed over 20 ms, that stops: in velocity limits, and 0.1 rad/s or m/s more.
    jump
        Way of a measured joint beyond what that speed allows, at which a sample is bad, rad or m.
    base_jump
        Way of a measured mobile base beyond what its speed allows, at which a sample is bad: of x and y, m, and of its
        heading, rad. Corrections of a localisation are to be below it.
    frozen_after
        Time that a measured joint may stay the same number while it is told to move by more than 0.02 rad or m, s; five
        periods at least.
    effort
        Measured effort that stops, N·m or N: one number, or one an input; not bounded if omitted.
    contact_force, contact_torque
        Of the wrench measured at the end effector, less the weight of the payload, that stop, N and N·m; not bounded if
        omitted. The wrench is what payload and environment exert on the end effector, along the axes of the end
        effector's frame and about its origin.
    payload
        Whose weight and bias are in the measured wrench, its centre in the end effector's frame; none if omitted. Its
        inertia is not taken off.
    contact_effort
        Change of a measured effort against its mean over 0.2 s that stops, N·m or N; not bounded if omitted.
    keep_out
        Zones on the floor that a mobile base is never commanded into: it brakes before them, and may leave them; none
        if omitted.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> supervisor = dqc.supervisor.Supervisor(acceleration=5.0, ramp=0.0).prepare(arm, period=0.01)
    >>> state = supervisor.start(q)
    >>> supervisor.command(q, np.full(7, 100.0), state).round(3).tolist()[0]  # after one period: 5 rad/s² · 0.01 s
    0.05
    >>> supervisor.reasons(state)
    ('velocity limit', 'acceleration limit')
    """

    spec_key: ClassVar[str] = "supervisor"
    velocity: Annotated[PerInput | None, Meta(description="rad/s or m/s")] = None
    acceleration: Annotated[PerInput, Meta(description="rad/s² or m/s²")] = 10.0
    jerk: Annotated[PerInput | None, Meta(description="rad/s³ or m/s³")] = None
    position_margin: Annotated[float, Meta(ge=0, description="rad or m")] = 0.0
    tracking_error: Annotated[PerInput, Meta(description="rad or m")] = 0.3
    stale_after: Annotated[float, Meta(gt=0, description="s")] | None = None
    slow_below: Annotated[float, Meta(ge=0, description="singular value")] = 0.04
    hold_below: Annotated[float, Meta(ge=0, description="singular value")] = 0.02
    workspace: WorkspaceBox | None = None
    ramp: Annotated[float, Meta(ge=0, le=_LONGEST_RAMP, description="s")] = 0.5
    hand_speed: Annotated[float, Meta(gt=0, description="m/s")] | None = None
    hand_acceleration: Annotated[float, Meta(gt=0, description="m/s²")] | None = None
    measured_tolerance: Annotated[float, Meta(ge=0, description="rad or m")] = 0.05
    overspeed: Annotated[float, Meta(gt=0, description="velocity limits")] = 1.5
    jump: Annotated[float, Meta(ge=0, description="rad or m")] = 0.05
    base_jump: Annotated[float, Meta(ge=0, description="m and rad")] = 0.2
    frozen_after: Annotated[float, Meta(gt=0, description="s")] = 0.1
    effort: Annotated[PerInput | None, Meta(description="N·m or N")] = None
    contact_force: Annotated[float, Meta(gt=0, description="N")] | None = None
    contact_torque: Annotated[float, Meta(gt=0, description="N·m")] | None = None
    payload: Tool | None = None
    contact_effort: Annotated[float, Meta(gt=0, description="N·m or N")] | None = None
    keep_out: KeepOutZones | None = None

    def limits_alone(self) -> Supervisor:
        """Return what keeps position, velocity and acceleration limits and watches nothing, as a robot itself does."""
        unwatched = ("tracking_error", "stale_after", "measured_tolerance", "overspeed", "frozen_after")
        return msgspec.structs.replace(
            self,
            ramp=0.0,
            slow_below=0.0,
            hold_below=0.0,
            **dict.fromkeys(("jerk", "workspace", "hand_speed", "hand_acceleration", "payload", "keep_out")),
            **dict.fromkeys(("effort", "contact_force", "contact_torque", "contact_effort")),
            **dict.fromkeys((*unwatched, "jump", "base_jump"), _NEVER),
        )

    def prepare(
        self, robot: Robot, period: float, command_mode: Literal["integrated", "measured"] = "integrated"
    ) -> PreparedSupervisor:
        """Check the parameters for a robot and a period.

        Parameters
        ----------
        robot
            The robot to guard.
        period
            Control period, s.
        command_mode
            What a plant moves by T u: its last target (``integrated``), or its measured joints (``measured``).

        Raises
        ------
        ShapeError, UnknownNameError, ValueRangeError
            If a parameter is not allowed, or the robot has no velocity limits and none are given.
        """
        if isinstance(robot, TreeRobot) and len(robot.task.frames) > 1:
            for field in ("contact_force", "contact_torque"):
                if getattr(self, field) is not None:
                    raise ValueRangeError(
                        f"supervisor.{field}: is of one end effector, and {robot.task.label} of {robot.name} has two; "
                        "bound 'effort' or 'contact_effort', or drive one end effector"
                    )
        period, m = as_positive("period", period), robot.input_size
        velocity = robot.limits.velocity if self.velocity is None else _each("velocity", self.velocity, m)
        if not np.isfinite(velocity).all():
            raise ValueRangeError(
                f"supervisor.velocity: {robot.name} has no limits of its own; give them here"
            )
        acceleration = _in_curves(robot, _each("acceleration", self.acceleration, m))
        margin, coordinates = self.position_margin, robot.input_coordinates
        lower, upper = robot.limits.lower[coordinates] + margin, robot.limits.upper[coordinates] - margin
        if (lower > upper).any():
            raise ValueRangeError(
                f"supervisor.position_margin: {margin:g} leaves "
                f"{robot.input_names[int((lower > upper).argmax())]} no room"
            )
        head = np.zeros(layout.HEAD)
        head[layout.DT], head[layout.WINDOW] = period, self._window(acceleration, period)
        head[layout.FROM_MEASURED] = command_mode == "measured"
        self._fill_head(head, margin)
        points, zones = self._workspace(robot, head), self._zones(robot, head)
        tree, (rows, columns) = tree_of(robot), robot.table.shape
        head[layout.SIZES :] = layout.Sizes(
            coordinates=robot.configuration_size,
            inputs=m,
            drives=len(robot.drives),
            rollers=len(robot.rollers),
            points=len(points),
            zones=len(zones),
            table_rows=rows,
            table_columns=columns,
            tree=len(tree),
            frames=len(tree) - 1 if len(tree) else robot.configuration_size + 1,
            hands=len(tree) - len(robot.joint_table) if isinstance(robot, TreeRobot) else 1,
        )
        bounds = layout.bounds_layout.pack(
            head=head,
            acceleration=acceleration,
            lower=lower,
            upper=upper,
            tracking=_each("tracking_error", self.tracking_error, m),
            effort=np.full(m, np.inf) if self.effort is None else _each("effort", self.effort, m),
            coordinate=coordinates,
            is_joint=~base_coordinates(robot)[coordinates],
            velocity=velocity,
            drives=robot.drives,
            rollers=robot.rollers,
            points=points,
            zones=zones,
        )
        return PreparedSupervisor(robot, bounds, tree)

    def _fill_head(self, head: Array, margin: float) -> None:
        period, ramp = head[layout.DT], self.ramp
        head[layout.STALE] = _STALE_PERIODS * period if self.stale_after is None else self.stale_after
        longest = _LONGEST_STEP if self.stale_after is None else self.stale_after
        head[layout.LONGEST_STEP] = max(longest, _STALE_PERIODS * period)
        head[layout.SLOW] = self.slow_below
        head[layout.HOLD] = self.hold_below
        if self.slow_below < self.hold_below:
            raise ValueRangeError(
                f"supervisor.slow_below: must be ≥ hold_below {self.hold_below:g}, got {self.slow_below:g}"
            )
        head[layout.RAMP] = min(period / ramp, 1.0) if ramp else 1.0
        head[layout.HAND_TOLERANCE] = self.measured_tolerance
        head[layout.JOINT_TOLERANCE] = head[layout.HAND_TOLERANCE] + margin
        head[layout.OVERSPEED] = self.overspeed
        head[layout.JUMP] = self.jump
        head[layout.LONGEST_BASE_JUMP] = self.base_jump
        head[layout.FROZEN_AFTER] = max(self.frozen_after, _FROZEN_PERIODS * period)
        head[layout.HAND_SPEED_LIMIT] = _or_infinite(self.hand_speed)
        head[layout.HAND_ACCELERATION_LIMIT] = _or_infinite(self.hand_acceleration)
        head[layout.CONTACT_FORCE] = _or_infinite(self.contact_force)
        head[layout.CONTACT_TORQUE] = _or_infinite(self.contact_torque)
        head[layout.CONTACT_EFFORT] = _or_infinite(self.contact_effort)
        if self.payload is not None:
            head[layout.PAYLOAD_WEIGHT] = _GRAVITY * self.payload.mass
            head[layout.PAYLOAD_CENTER : layout.PAYLOAD_CENTER + 3] = self.payload.center
            bias = *self.payload.force_bias, *self.payload.torque_bias
            head[layout.SENSOR_BIAS : layout.SENSOR_BIAS + 6] = bias

    def _window(self, acceleration: Array, period: float) -> int:
        """Return how many periods the rates are smoothed over, to keep the jerk."""
        if self.jerk is None:
            return 1
        with np.errstate(over="ignore", divide="ignore"):
            needed = (2 * (acceleration / _each("jerk", self.jerk, len(acceleration))) / period).max() - 1e-9
        if not needed <= _LONGEST_WINDOW:
            raise ValueRangeError(
                f"supervisor.jerk: smooths over {np.ceil(needed):.7g} periods; at most {_LONGEST_WINDOW}: "
                "allow more jerk"
            )
        return max(1, math.ceil(needed))

    def _workspace(self, robot: Robot, head: Array) -> Array:
        """Note the box; return its points as rows (index of the joint, offset)."""
        if self.workspace is None:
            return np.zeros((0, 4))
        head[layout.BOXED] = 1.0
        head[layout.BOX : layout.BOX + 6] = _box(self.workspace)
        rows = []
        for k, point in enumerate(self.workspace.points):
            field = f"supervisor.workspace.points[{k}]"
            names = robot.joints.names if isinstance(robot, TreeRobot) else robot.joint_names
            if point.joint not in names:
                raise unknown_name(f"{field}.joint", point.joint, names)
            offset = as_array(f"{field}.offset", point.offset, (3,))
            rows.append([names.index(point.joint), *offset])
        return np.array(rows, dtype=np.float64).reshape(-1, 4)

    def _zones(self, robot: Robot, head: Array) -> Array:
        """Note the footprint; return the zones as rows."""
        zones = self.keep_out
        if zones is None:
            return np.zeros((0, layout.ZONE_COLUMNS))
        head[layout.FOOTPRINT], head[layout.KEEP_OUT_MARGIN] = zones.footprint_of(robot), zones.margin
        return zones.rows()


def _or_infinite(bound: float | None) -> float:
    return math.inf if bound is None else bound


def _each(field: str, value: float | list[float], m: int) -> Array:
    return as_each(f"supervisor.{field}", value, m)


def _box(workspace: WorkspaceBox) -> Array:
    """Return lower and upper corner, (6,)."""
    lower = as_array("supervisor.workspace.lower", workspace.lower, (3,))
    upper = as_array("supervisor.workspace.upper", workspace.upper, (3,))
    if (lower >= upper).any():
        raise ValueRangeError(f"supervisor.workspace: lower {lower} must be below upper {upper}")
    return np.concatenate([lower, upper])


def _in_curves(robot: Robot, acceleration: Array) -> Array:
    """Return accelerations of which v's is small enough for ω to follow it in the sharpest curve of a base that steers.

    There ω is v over the turning radius: who brakes to reverse would turn with an acceleration beyond its limit.
    """
    kept = np.array(acceleration)
    if robot.input_size < robot.configuration_size:
        for k, drive in enumerate(robot.drives):
            i = int(drive[0]) - k
            if drive[TURNING_RADIUS]:
                kept[i] = min(kept[i], drive[TURNING_RADIUS] * kept[i + 1])
    return kept
