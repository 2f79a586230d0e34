"""Impedance: springs and dampers between an end effector and its target, as joint torques.

z = (φ, y) is what the end effector is off, along the axes of the target or of the base: the logarithm of its turn, and
the way. T = ∂z/∂q̇, δ = q̇ − q̇*, and

    τ = g + C(q, q̇) q̇* − Tᵀ(K z + D T δ) + (M − TᵀΛT) a,   a = −ω²(q − q*) − 2ω δ,   Λ = (T M⁻¹ Tᵀ)⁻¹.

K z is the gradient of ½ zᵀKz also where stiffnesses differ (as in `admittance_step`), C is that of Christoffel's
symbols, so that ½ δᵀMδ + ½ zᵀKz of a target at rest grows by nothing but what the environment does. Damping by double
diagonalisation (A. Albu-Schäffer et al., *Cartesian impedance control of redundant robots*, ICRA 2003): with
√K T M⁻¹ Tᵀ √K = U Ω² Uᵀ and X = Uᵀ√K T each mode has a frequency Ω and D T = √K U (2ζ/Ω) X, whatever the inertia
is; nothing is inverted but what a singular configuration leaves.

With masses M_d of its own, and a measured wrench w, z̈ = M_d⁻¹(w − 2ζ√(K M_d) ż − K z) along each axis.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol.algebra.dual_quaternion_kernels import (
    half_angle,
    inverse_left_jacobian,
    left_jacobian,
    position,
    quaternion_product,
    set_pose,
)
from dqcontrol.algebra.symmetric import cholesky, cholesky_solve, diagonalise
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import NOT_FINITE, OK, READ, READ2, SINGULAR, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix, as_row
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.contact.admittance import AXES, ForceSensor
from dqcontrol.contact.admittance_step import contact_wrench, cross, turned, turning, unloaded
from dqcontrol.contact.contact_layout import BASE
from dqcontrol.contact.tool import Tool
from dqcontrol.errors import DivergedError, ValueRangeError, as_array, as_each
from dqcontrol.named_fields import NamedFields
from dqcontrol.robots.kinematics.kinematics_kernels import compose_fixed
from dqcontrol.robots.kinematics.rigid_bodies import (
    MOVED,
    RATES,
    fill_joint_forces,
    fill_mass_matrix,
    place_bodies,
    rigid_bodies,
    work_size,
)
from dqcontrol.robots.robot import DOWN

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

_STUCK = 1e-9  # of the largest Ω²: a direction so heavy is one in which the arm cannot move

# bodies, parameters, rows q, q̇, q*, q̇*, wrench, torque, work
IMPEDANCE = STATUS(READ2, READ, READ2, READ, WRITE, WRITE)


class ImpedanceParameters(NamedTuple):
    """What the torque is prepared with; axes in the order φx φy φz x y z.

    Attributes
    ----------
    axes
        `REFERENCE` or `BASE`.
    carrier, end
        Row of the body that carries the end effector, and how: r (4), p (3).
    stiffness, mass
        K and M_d of each axis; no masses of its own where the first is 0.
    damping_ratio
        ζ.
    posture
        ω, rad/s.
    sensor, bias, tool_mass, tool_center, gravity
        As of `ContactParameters`.
    compensated
        Share of gravity that is in the torque.
    armature
        Inertia of the rotors, of each joint, kg m² or kg.
    """

    axes: float
    carrier: float
    end: Annotated[Array, 7]
    stiffness: Annotated[Array, 6]
    mass: Annotated[Array, 6]
    damping_ratio: float
    posture: float
    sensor: Annotated[Array, 7]
    bias: Annotated[Array, 6]
    tool_mass: float
    tool_center: Annotated[Array, 3]
    gravity: Annotated[Array, 3]
    compensated: float
    armature: Annotated[Array, ...]


class ImpedanceWork(NamedTuple):
    """What it finds, and scratch.

    Attributes
    ----------
    squares
        Ω² of each mode, (rad/s)².
    deflection
        z.
    hand, desired
        Poses of the end effector, as it is and as it is to be.
    """

    squares: Annotated[Array, 6]
    deflection: Annotated[Array, 6]
    hand: Annotated[Array, 8]
    desired: Annotated[Array, 8]
    wrench: Annotated[Array, 6]
    nothing: Annotated[Array, 6]
    speed: Annotated[Array, 6]
    asked: Annotated[Array, 6]
    along: Annotated[Array, 6]
    fall: Annotated[Array, 3]
    mass: Annotated[Array, "n", "n"]
    factor: Annotated[Array, "n", "n"]
    rows: Annotated[Array, 6, "n"]
    modes: Annotated[Array, 6, "n"]
    gram: Annotated[Array, 6, 6]
    vectors: Annotated[Array, 6, 6]
    rates: Annotated[Array, "n"]
    forces: Annotated[Array, "n"]
    column: Annotated[Array, "n"]
    bodies: Annotated[Array, ...]


impedance_parameters: MemoryLayout[ImpedanceParameters] = MemoryLayout(ImpedanceParameters)
impedance_work: MemoryLayout[ImpedanceWork] = MemoryLayout(ImpedanceWork, "n")


@inline
def _write_end(moved, given, out):
    """Write the pose of the end effector."""
    at = moved[int(given.carrier)]
    w, x, y, z, px, py, pz = compose_fixed(at[0], at[1], at[2], at[3], at[4], at[5], at[6], given.end)
    set_pose((w, x, y, z), (px, py, pz), out)


@inline
def _to_axes(given, desired, a, b, c):
    """Return a vector of the base frame along the axes of the springs."""
    if given.axes == BASE:
        return a, b, c
    return turned(desired[0], -desired[1], -desired[2], -desired[3], a, b, c)


@inline
def _write_deflection(given, room):
    """Write z of the poses."""
    r, d, z = room.hand, room.desired, room.deflection
    px, py, pz = position(r)
    x, y, w = position(d)
    if given.axes == BASE:
        quaternion_product((r[0], r[1], r[2], r[3]), (d[0], -d[1], -d[2], -d[3]), room.along)
    else:
        quaternion_product((d[0], -d[1], -d[2], -d[3]), (r[0], r[1], r[2], r[3]), room.along)
    if room.along[0] < 0.0:
        for i in range(4):
            room.along[i] = -room.along[i]
    half_angle(room.along, z)
    for i in range(3):
        z[i] *= 2.0
    z[3], z[4], z[5] = _to_axes(given, d, px - x, py - y, pz - w)


@inline
def _write_rows(bodies, moved, given, room):
    """Write T, whose columns are what joints move z by."""
    rows, place, z = room.rows, position(room.hand), room.deflection
    for i in range(6):
        for j in range(rows.shape[1]):
            rows[i, j] = 0.0
    turn = room.along[0:3]
    i = int(given.carrier)
    while i >= 0:
        at, j, scale = moved[i], int(bodies[i, 8]), bodies[i, 9]
        cx, cy, cz = cross(at[7], at[8], at[9], place[0], place[1], place[2])
        a, b, c = _to_axes(given, room.desired, at[7], at[8], at[9])
        inverse_left_jacobian(z, (a, b, c), turn)
        a, b, c = _to_axes(given, room.desired, at[10] + cx, at[11] + cy, at[12] + cz)
        for k in range(3):
            rows[k, j] += scale * turn[k]
        rows[3, j] += scale * a
        rows[4, j] += scale * b
        rows[5, j] += scale * c
        i = int(bodies[i, 11])


@inline
def _find_modes(given, room):
    """Write Ω², U, and X in place of √K T; return whether the mass matrix allows it."""
    rows, modes, gram, n = room.rows, room.modes, room.gram, room.mass.shape[0]
    for i in range(n):
        for j in range(n):
            room.factor[i, j] = room.mass[i, j]
    if not cholesky(room.factor, n):
        return False
    for i in range(6):
        for j in range(n):
            room.column[j] = rows[i, j]
        cholesky_solve(room.factor, n, room.column)
        for k in range(i, 6):
            total = 0.0
            for j in range(n):
                total += rows[k, j] * room.column[j]
            gram[k, i] = total * math.sqrt(given.stiffness[i] * given.stiffness[k])
    diagonalise(gram, 6, room.vectors)
    for i in range(6):
        room.squares[i] = gram[i, i]
        for j in range(n):
            total = 0.0
            for k in range(6):
                total += room.vectors[k, i] * math.sqrt(given.stiffness[k]) * rows[k, j]
            modes[i, j] = total
    return True


@inline
def _write_shaped(own, given, room):
    """Write z̈ as the masses of its own take it, less what bodies that move on at their rates would do."""
    place, z, speed, asked = position(room.hand), room.deflection, room.speed, room.asked
    for i in range(6):
        stiffness, mass = given.stiffness[i], given.mass[i]
        damping = 2.0 * given.damping_ratio * math.sqrt(stiffness * mass)
        asked[i] = (room.wrench[i] - damping * speed[i] - stiffness * z[i]) / mass
    _, _, _, dx, dy, dz = turning(z, speed, asked)
    wx, wy, wz = own[0], own[1], own[2]
    cx, cy, cz = cross(wx, wy, wz, place[0], place[1], place[2])
    ex, ey, ez = cross(wx, wy, wz, own[3] + cx, own[4] + cy, own[5] + cz)
    cx, cy, cz = cross(own[6], own[7], own[8], place[0], place[1], place[2])
    fall = room.fall
    hx, hy, hz = own[9] + fall[0] + cx + ex, own[10] + fall[1] + cy + ey, own[11] + fall[2] + cz + ez
    hx, hy, hz = _to_axes(given, room.desired, hx, hy, hz)
    ax, ay, az = _to_axes(given, room.desired, own[6], own[7], own[8])
    inverse_left_jacobian(z, (dx - ax, dy - ay, dz - az), asked)
    asked[3], asked[4], asked[5] = asked[3] - hx, asked[4] - hy, asked[5] - hz


@kernel(IMPEDANCE)
def impedance_torque(bodies, parameters, motion, wrench, torque, work):
    """Write the torque of all joints, N·m or N."""
    n, count = torque.shape[0], bodies.shape[0]
    given, room = impedance_parameters(parameters), impedance_work(work, n)
    q, rates, target, leads = motion[0], motion[1], motion[2], motion[3]
    at = (count + 3) // 4 * 12  # where functions of bodies keep poses, and twists with their rates
    moved = as_matrix(as_row(room.bodies, at, MOVED * count), count, MOVED)
    moving = as_row(room.bodies, at + MOVED * count + RATES * int(given.carrier), RATES)
    place_bodies(bodies, target, moved, room.bodies)
    _write_end(moved, given, room.desired)
    status = fill_mass_matrix(bodies, q, room.mass, room.bodies)
    if status != OK:
        return status
    for i in range(n):
        room.mass[i, i] += given.armature[i]
    _write_end(moved, given, room.hand)
    _write_deflection(given, room)
    _write_rows(bodies, moved, given, room)
    if not _find_modes(given, room):
        return SINGULAR
    for i in range(3):
        room.fall[i] = given.compensated * given.gravity[i]
    shaped = given.mass[0] > 0.0
    for i in range(n):
        torque[i] = 0.0
    for part in range(1 if shaped else 3):
        # C(q, q̇) q̇* = ¼ [C(q, q̇ + q̇*)(q̇ + q̇*) − C(q, q̇ − q̇*)(q̇ − q̇*)]; the third are those at rest
        own, lead, weight = 1.0, 0.0, 1.0
        if not shaped and part < 2:
            lead = 1.0 - 2.0 * part
            weight = 0.25 * lead
        elif not shaped:
            own = 0.0
        for i in range(n):
            room.rates[i] = own * rates[i] + lead * leads[i]
        fill_joint_forces(bodies, q, room.rates, room.fall[0:0], room.fall, room.forces, room.bodies)
        for i in range(n):
            torque[i] += weight * room.forces[i]
    z, speed, asked, along, posture = room.deflection, room.speed, room.asked, room.along, given.posture
    for i in range(6):
        speed[i] = 0.0
        for j in range(n):
            speed[i] += room.rows[i, j] * (rates[j] - leads[j])
    for j in range(n):
        room.column[j] = posture * (posture * (target[j] - q[j]) + 2.0 * (leads[j] - rates[j]))
    if shaped:
        unloaded(room.hand, given, wrench, room.wrench)
        contact_wrench(room.hand, room.desired, given, room.nothing, room.wrench)
        back, moment = (-z[0], -z[1], -z[2]), (room.wrench[0], room.wrench[1], room.wrench[2])
        left_jacobian(back, moment, room.wrench)
        _write_shaped(moving, given, room)
    largest = 0.0
    for i in range(6):
        largest = max(largest, room.squares[i])
    for i in range(6):
        square, total = room.squares[i], 0.0
        moves = square > _STUCK * largest
        for k in range(6):
            total += room.vectors[k, i] * math.sqrt(given.stiffness[k]) * (asked[k] if shaped else z[k])
        if shaped:
            total = -total / square if moves else 0.0
        for j in range(n):
            if not moves:
                break
            if not shaped:
                more = 2.0 * given.damping_ratio / math.sqrt(square) * (rates[j] - leads[j])
                total += room.modes[i, j] * more
            total += room.modes[i, j] * room.column[j] / square
        along[i] = total
    check = 0.0
    for j in range(n):
        for k in range(n):
            torque[j] += room.mass[j, k] * room.column[k]
        for i in range(6):
            torque[j] -= room.modes[i, j] * along[i]
            if shaped:
                torque[j] -= room.rows[i, j] * room.wrench[i]
        check += 0.0 * torque[j]
    return OK if check == 0.0 else NOT_FINITE


_Positive = Annotated[float, Meta(gt=0)]
_Each = Annotated[list[_Positive], Meta(min_length=3, max_length=3)]


class Impedance(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Springs and dampers between an end effector and its target, of a torque-driven arm.

    What the environment exerts displaces the end effector by w/K along each axis, whatever the posture, and it comes
    to rest with one damping ratio: the damping follows the arm's inertia (double diagonalisation). Joints that are
    left over keep the target's posture without a force at the end effector.

    Parameters
    ----------
    stiffness, turn_stiffness
        K along and about three axes, N/m and N·m/rad: one number, or one an axis.
    axes
        Of the target (``reference``) or of the ``base``.
    damping_ratio
        ζ.
    posture
        Natural frequency with which the joints that are left over follow the target, critically damped, Hz; 0: they
        drift.
    mass, turn_inertia
        What the end effector is to feel like, kg and kg m²: one number, or one an axis; both, or its own if omitted.
        That takes a force sensor, and as much trust in the arm's model.
    sensor
        Of the force, for ``mass``; see `ForceSensor`.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, -1.6, 0, 0.9, 0])
    >>> soft = dqc.contact.Impedance(stiffness=800.0, turn_stiffness=20.0).prepare(arm)
    >>> torque = soft.torque(q, np.zeros(7), q)  # at rest on its target it bears the arm's weight
    >>> bool(np.allclose(torque, arm.gravity_forces(q)))
    True
    """

    spec_key: ClassVar[str] = "plant.impedance"
    stiffness: Annotated[_Positive | _Each, Meta(description="N/m")]
    turn_stiffness: Annotated[_Positive | _Each, Meta(description="N·m/rad")]
    axes: Literal["reference", "base"] = "reference"
    damping_ratio: Annotated[float, Meta(gt=0, le=10, description="ζ")] = 1.0
    posture: Annotated[float, Meta(ge=0, le=100, description="Hz")] = 1.0
    mass: Annotated[_Positive | _Each | None, Meta(description="kg")] = None
    turn_inertia: Annotated[_Positive | _Each | None, Meta(description="kg m²")] = None
    sensor: ForceSensor = ForceSensor()

    def __post_init__(self) -> None:
        if (self.mass is None) != (self.turn_inertia is None):
            raise ValueRangeError("plant.impedance: 'mass' goes with 'turn_inertia'; give both, or none")

    @property
    def feels(self) -> bool:
        """Whether it needs a measured wrench."""
        return self.mass is not None

    def prepare(
        self,
        robot: Robot,
        gravity: ArrayLike = DOWN,
        compensated: float = 1.0,
        armature: float | list[float] | Array = 0.0,
    ) -> PreparedImpedance:
        """Return it at work for a robot.

        Parameters
        ----------
        robot
            With inertias and one end effector.
        gravity
            m/s², base frame.
        compensated
            Share of gravity in the torque, 0 to 1; 0 where the arm's own controller bears its weight.
        armature
            Inertia of the rotors, kg m² or kg: one number, or one a joint.

        Raises
        ------
        ValueRangeError
            If the robot has no inertias or several end effectors.
        """
        return PreparedImpedance(self, robot, as_array("gravity", gravity, (3,)), compensated, armature)


class PreparedImpedance:
    """An impedance for one robot; made by `Impedance.prepare`."""

    def __init__(
        self,
        impedance: Impedance,
        robot: Robot,
        gravity: Array,
        compensated: float,
        armature: float | list[float] | Array,
    ) -> None:
        if robot.inertia is None:
            raise ValueRangeError(f"impedance: {robot.name} has no inertias; its damping follows them")
        if len(robot.ends) != 1:
            raise ValueRangeError(
                f"impedance: is that of one end effector, and {robot.name} has {len(robot.ends)}"
            )
        end, n, sensor = robot.ends[0], robot.configuration_size, impedance.sensor
        tool, shaped = sensor.tool or Tool(), [*_three(impedance.turn_inertia), *_three(impedance.mass)]
        self.impedance, self._bodies = impedance, rigid_bodies(robot)
        self._given = impedance_parameters.pack(
            axes=AXES[impedance.axes],
            carrier=robot.parents[end],
            end=robot.chain[end, :7],
            stiffness=[*_three(impedance.turn_stiffness), *_three(impedance.stiffness)],
            mass=shaped,
            damping_ratio=impedance.damping_ratio,
            posture=2 * np.pi * impedance.posture,
            sensor=[*sensor.pose[:4], *sensor.position],
            bias=[*tool.force_bias, *tool.torque_bias],
            tool_mass=tool.mass,
            tool_center=tool.center,
            gravity=gravity,
            compensated=compensated,
            armature=as_each("armature", armature, n),
        )
        self._work = np.zeros(impedance_work.size(n) + work_size(len(self._bodies)))
        self._found = impedance_work(self._work, n)
        self._motion, self._torque, self._wrench = np.zeros((4, n)), np.zeros(n), np.full(6, np.nan)
        self._step = impedance_torque.compiled

    def torque(
        self,
        q: Array,
        rates: Array,
        target: Array,
        target_rates: Array | float = 0.0,
        wrench: Array | None = None,
    ) -> Array:
        """Return the joint torques, shape (n,), N·m or N, in an array that the next call overwrites.

        Parameters
        ----------
        q, rates
            Where the joints are and how fast, shape (n,), rad or m, rad/s or m/s.
        target, target_rates
            Where they were to be, which says pose and posture, and how fast that moves.
        wrench
            Force and torque at the sensor, its axes, shape (6,), N and N·m; only with ``mass``.

        Raises
        ------
        DivergedError
            If the result is not finite, as with a sensor that says nothing.
        """
        motion = self._motion
        motion[0], motion[1], motion[2], motion[3] = q, rates, target, target_rates
        wrench = self._wrench if wrench is None else wrench
        if self._step(self._bodies, self._given, motion, wrench, self._torque, self._work) != OK:
            missing = " 'mass' needs a measured wrench" if self.impedance.feels else ""
            raise DivergedError(f"impedance: the torque is not finite, q = {motion[0]};{missing}")
        return self._torque

    @property
    def deflection(self) -> Array:
        """How far the end effector was off at the last call: turn and way, shape (6,), rad and m."""
        return self._found.deflection.copy()

    @property
    def frequencies(self) -> Array:
        """Natural frequencies of its modes at the last call, shape (6,), rad/s; 0 where the arm cannot move."""
        return np.sqrt(np.maximum(self._found.squares, 0.0))

    def check_period(self, q: Array, period: float, *, is_late: bool = False) -> None:
        """Refuse springs that would swing by the time between torques alone, at rest in a configuration.

        The torque is held, and semi-implicit steps of a mode are stable while Ωh < 2 (√(1 + ζ²) − ζ).

        Parameters
        ----------
        q
            Configuration, shape (n,), rad or m.
        period
            h, between two torques, s.
        is_late
            Whether each acts a period later, and rates are differences of angles, as where messages carry both.

        Raises
        ------
        ValueRangeError
            If they would; it says how stiff they may be.
        """
        self.torque(q, np.zeros_like(q), q, 0.0, np.zeros(6))
        ratio, fastest = self.impedance.damping_ratio, float(self.frequencies.max())
        if self.impedance.feels:
            given = impedance_parameters(self._given)
            fastest = float(np.sqrt(given.stiffness / given.mass).max())
        most = (_most_late(ratio) if is_late else 2 * (np.hypot(1.0, ratio) - ratio)) / period
        if fastest >= most:
            raise ValueRangeError(
                f"plant.impedance: is too stiff for a torque every {1e3 * period:g} ms: its fastest mode swings at "
                f"{fastest:.4g} rad/s, less than {most:.4g} are stable; take {(most / fastest) ** 2:.2g} of the "
                "stiffnesses, a smaller damping ratio or shorter steps"
            )


def _most_late(ratio: float) -> float:
    """Return the Ωh up to which a mode is stable whose torque acts a period late, by differences of its way."""

    def is_stable(step: float) -> bool:
        by_rate, by_way = 2 * ratio * step, step * step
        rows = [  # of way and rate, the way before, and the torque that acts in the coming period
            [1, 1, 0, 0.5],
            [0, 1, 0, 1],
            [1, 0, 0, 0],
            [-by_rate - by_way, 0, by_rate, 0],
        ]
        return float(np.abs(np.linalg.eigvals(np.array(rows))).max()) < 1.0

    stable, unstable = 0.0, 2.0
    for _ in range(40):
        middle = 0.5 * (stable + unstable)
        stable, unstable = (middle, unstable) if is_stable(middle) else (stable, middle)
    return stable


def _three(value: float | list[float] | None) -> list[float]:
    return [value or 0.0] * 3 if not isinstance(value, list) else value
