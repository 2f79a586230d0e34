"""The base of all robots, arm or whole body: its chain, its limits, and its motion under its inputs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.robots.files.description import chain_reach, describe
from dqcontrol.robots.inverse.inverse_kinematics import InverseKinematics
from dqcontrol.robots.kinematics import driving
from dqcontrol.robots.kinematics.gravity import WORK, gravity_forces, gravity_torques
from dqcontrol.robots.kinematics.rigid_bodies import (
    bias_force,
    bias_forces,
    mass_matrices,
    mass_matrix,
    rigid_bodies,
    work_size,
)
from dqcontrol.robots.limits import Inertia
from dqcontrol.robots.link_shapes import LinkShapes

CommandMode: TypeAlias = Literal["integrated", "measured"]


class Lag(NamedTuple):
    """How late joints follow targets that commands move.

    Attributes
    ----------
    times
        Time constant of each coordinate, s; empty: none.
    delays
        From command to joint, of each coordinate, s.
    """

    times: tuple[float, ...] = ()
    delays: tuple[float, ...] = ()

    @property
    def late(self) -> float:
        """The longest of time constant and delay together, s."""
        return max(map(add, self.times, self.delays), default=0.0)

    @property
    def mean(self) -> tuple[float, float]:
        """The means of time constants and delays, s."""
        n = max(len(self.times), 1)
        return sum(self.times) / n, sum(self.delays) / n


AT_ONCE = Lag()

if TYPE_CHECKING:
    from dqcontrol.robots.whole_body import Drive

DOWN: Array = np.array([0.0, 0.0, -9.81])  # m/s²
DOWN.flags.writeable = False

_NO_ROLLERS: Array = np.zeros((0, driving.ROLLER_COLUMNS))
_NO_ROLLERS.flags.writeable = False

Form: TypeAlias = Literal["constrained", "unconstrained"]


class NamedFrame(NamedTuple):
    """A frame that is fixed to a joint (−1: to the base): the pose (7,) in the frame of the joint after its screw."""

    joint: int
    pose: Array


class PlacedLinks(NamedTuple):
    """The links of a URDF or MJCF file, and where each is on the robot that was made of it."""

    path: Path
    frames: Mapping[str, NamedFrame]


class Robot(InverseKinematics):
    """A robot with a configuration q of n coordinates and m inputs u; `SerialArm` and `WholeBody` are robots.

    Attributes
    ----------
    name
        Shown in tables.
    configuration_size, input_size
        n and m: equal for arms, m < n with drives, which cannot move sideways.
    joint_names, joint_types
        One name, and ``"revolute"`` (rad) or ``"prismatic"`` (m), a coordinate.
    input_names, input_types
        The same for the inputs, whose units are rad/s or m/s.
    input_coordinates
        Index of the coordinate that each input moves, shape (m,); of x for the forward speed of a drive.
    limits
        ``lower`` and ``upper`` have one entry a coordinate, ``velocity`` and ``effort`` one an input.
    inertia
        None if a body's is not known.
    chain
        Table of fixed poses and screws, shape (n + 1, 8).
    origin
        Name or file, base and tip link that `load_robot` made it of; None of one made in Python.
    shapes
        Of its links, and which of them are kept apart; None if unknown.
    placed_links
        Where the links of its file are, by which it finds their shapes; None of one without.
    bases
        Index of the first coordinate of each mobile base, and its kind.
    driven_bases
        Those that cannot move sideways, in the order of ``drives``.
    rollers
        Table of its wheels with rollers that have a rim speed, shape (k, 5), see ``robots.kinematics.driving``.
    follows
        Names of coordinates that physics cannot give a servo: of joints that follow others.
    drives
        One row [index of x, displacement, wheel radius, half track, least turning radius, lever of the fastest rim] a
        base that cannot move sideways, m, shape (k, 6).
    """

    input_names: tuple[str, ...]
    input_types: tuple[str, ...]
    input_coordinates: NDArray[np.intp]
    inertia: Inertia | None
    drives: Array
    bases: tuple[tuple[int, str], ...] = ()
    driven_bases: tuple[Drive, ...] = ()
    rollers: Array = _NO_ROLLERS
    follows: tuple[str, ...] = ()
    origin: tuple[str, str | None, str | None] | None = None
    shapes: LinkShapes | None = None
    placed_links: PlacedLinks | None = None

    @property
    def columns_outwards(self) -> list[int]:
        """Columns of the twist Jacobian in the order in which joints carry each other: each is moved by those before.

        Empty where columns are no single screws, as of what lies between two end effectors, or of joints that move
        together.
        """
        return list(range(self.input_size))

    def in_form(self, form: Form) -> Robot:
        """Return the same robot with constrained or unconstrained inputs; see `WholeBody`."""
        return self

    def acceleration_limits(self, field: str, joints: ArrayLike | None = None) -> NDArray[np.float64]:
        """Return the largest acceleration of each input, shape (m,), rad/s² or m/s²; infinite where there is no limit.

        Parameters
        ----------
        field
            Name of what is given, for messages.
        joints
            Limit of each joint, or of each input, shape (m,). Limits of bases in the robot's file hold too.

        Raises
        ------
        ShapeError, ValueRangeError
            If the size is wrong, or a limit not positive.
        """
        m, known = self.input_size, self._base_accelerations()
        if joints is None:
            return known
        given = as_array(field, joints)
        if given.shape not in ((), (m,)):
            raise ShapeError(f"{field}: expected {m} numbers, one an input, got {given.size}")
        if (given <= 0).any():
            raise ValueRangeError(f"{field}: must be > 0, got {given.min():g}")
        carried = np.isin(self.input_coordinates, [first + i for first, _ in self.bases for i in range(3)])
        if given.shape == ():
            return np.where(carried, known, given)
        return np.minimum(known, given)

    def _base_accelerations(self) -> NDArray[np.float64]:
        return np.full(self.input_size, np.inf)

    @property
    def parents(self) -> NDArray[np.intp]:
        """For each row of ``chain`` and `frames` the row that carries it, −1 for the base."""
        return np.arange(-1, len(self.chain) - 1)

    @cached_property
    def row_coordinates(self) -> NDArray[np.intp]:
        """Index of the coordinate that moves each joint, in the order of the rows of ``chain``."""
        return np.arange(self.configuration_size)

    @cached_property
    def row_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the rows of ``chain``."""
        return self.joint_names

    @cached_property
    def joint_factors(self) -> Array:
        """What the coordinate of each joint is multiplied by for its screw, in the order of ``chain``."""
        return np.ones(self.configuration_size)

    @cached_property
    def joint_offsets(self) -> Array:
        """What is added to the coordinate of each joint for its screw, rad or m, in the order of ``chain``."""
        return np.zeros(self.configuration_size)

    @cached_property
    def inertia_chain(self) -> Array:
        """The table of all joints by which ``gravity`` knows where the bodies are: the chain, or all of a tree."""
        return self.chain

    @property
    def ends(self) -> tuple[int, ...]:
        """Rows of ``chain`` and `frames` that are end effectors."""
        return (len(self.chain) - 1,)

    @property
    def reach(self) -> float:
        """Length of the stretched arm, m, from its first axis (that of the part after the last base) to the tool."""
        return chain_reach(self)

    def from_start(self, q: Array) -> Robot:
        """Return the robot as it is for a run from a configuration, shape (n,): trees keep a sign from there on."""
        return self

    def integrate(self, q: ArrayLike, u: ArrayLike, period: float) -> Array:
        """Return where constant inputs move the robot in a time.

        Joints and holonomic bases move by u T. A differential drive moves on its arc: with h = ωT/2 and
        c = v T sin(h)/h, x by c cos(φ + h), y by c sin(φ + h) and φ by ωT. So do cars and tricycles; where their
        steering limit does not let them turn that sharply, ω is the largest that it does.

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.
        u
            Inputs, shape (…, m), rad/s or m/s; leading axes as those of q, or broadcast.
        period
            T, s; negative goes back.

        Returns
        -------
        Array
            Shape (…, n).

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong, or a value not finite.

        Examples
        --------
        >>> import numpy as np, dqcontrol as dqc
        >>> base = dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.04, half_track=0.13)])
        >>> base.integrate([0, 0, 0], [1.0, np.pi / 2], 1.0).round(3).tolist()  # a quarter of a circle to the left
        [0.637, 0.637, 1.571]
        """
        period = float(as_array("period", period, ()))
        batch_shape, starts, inputs = paired_rows(self._rows("q", q), "u", self._inputs("u", u))
        out = np.empty_like(starts)
        if driving.integrate(self.drives, starts, inputs, period, out):
            raise ValueRangeError(f"u: moves {self.name} to NaN or infinity in {period:g} s")
        return out.reshape(*batch_shape, self.configuration_size)

    def gravity_forces(self, q: ArrayLike, gravity: ArrayLike = DOWN) -> Array:
        """Return the joint torques that hold the robot still, τ_g = ∂U/∂q.

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.
        gravity
            Acceleration of free fall in the base frame, shape (3,), m/s².

        Returns
        -------
        Array
            Shape (…, n), N·m or N.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong, a value is not finite, or the robot has no inertia.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> dqc.load_robot("iiwa7").gravity_forces([0, 1.57, 0, 0, 0, 0, 0]).shape
        (7,)
        """
        chain, bodies, size, n = self._weighed_bodies
        try:
            found = np.empty(n)
            if gravity_forces.compiled(chain, bodies, q, _fall(gravity), found, np.empty(size)) == 0:
                return found
        except TypeError:
            pass
        rows, shape = self._as_rows(q)
        out = np.empty_like(rows)
        self._checked(gravity_torques(chain, bodies, rows, _fall(gravity), out, np.empty(size)), q)
        return out.reshape(shape)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return the mass matrix M of the equations of motion M(q) q̈ + C(q, q̇) q̇ + g(q) = τ.

        Rates are those of the configuration: of a mobile base ẋ, ẏ and φ̇, as if each were a joint's.

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.

        Returns
        -------
        Array
            Shape (…, n, n), symmetric, kg m², kg m and kg. Formula: ``robots.kinematics.rigid_bodies``.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong, a value is not finite, or the robot has no inertia.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> dqc.load_robot("iiwa7").mass_matrix([0, 1.57, 0, 0, 0, 0, 0]).shape
        (7, 7)
        """
        bodies, size, n = self._rigid_bodies
        try:  # one configuration, as loops ask for it: what follows takes longer than the kernel
            found = np.empty((n, n))
            if mass_matrix.compiled(bodies, q, found, np.empty(size)) == 0:
                return found
        except TypeError:
            pass
        rows, shape = self._as_rows(q)
        out = np.empty((*shape, n))
        self._checked(mass_matrices.compiled(bodies, rows, out.reshape(-1), np.empty(size)), q)
        return out

    def bias_forces(self, q: ArrayLike, rates: ArrayLike, gravity: ArrayLike = DOWN) -> Array:
        """Return the joint forces that a motion without acceleration needs, C(q, q̇) q̇ + g(q).

        Parameters
        ----------
        q, rates
            Configurations and their rates q̇, shape (…, n), rad or m, rad/s or m/s; leading axes alike, or broadcast.
        gravity
            Acceleration of free fall in the base frame, shape (3,), m/s².

        Returns
        -------
        Array
            Shape (…, n), N·m or N.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong, a value is not finite, or the robot has no inertia.

        Examples
        --------
        >>> import numpy as np, dqcontrol as dqc
        >>> arm, q = dqc.load_robot("iiwa7"), np.full(7, 0.3)
        >>> bool(np.allclose(arm.bias_forces(q, np.zeros(7)), arm.gravity_forces(q)))
        True
        """
        bodies, size, n = self._rigid_bodies
        try:
            found = np.empty(n)
            if bias_force.compiled(bodies, q, rates, _fall(gravity), found, np.empty(size)) == 0:
                return found
        except TypeError:
            pass
        rows, shape = self._as_rows(q)
        speeds, other = self._as_rows(rates, "rates")
        if shape != other:
            shape, rows, speeds = paired_rows(self._rows("q", q), "rates", self._rows("rates", rates))
            shape = *shape, self.configuration_size
        out = np.empty(shape)
        given = bodies, rows, speeds, _fall(gravity), out.reshape(-1), np.empty(size)
        self._checked(bias_forces.compiled(*given), q, rates)
        return out

    @cached_property
    def _rigid_bodies(self) -> tuple[Array, int, int]:
        """The table of ``robots.kinematics.rigid_bodies``, the scratch that it takes, and n."""
        inertia = self._known_inertia("dynamics")
        return rigid_bodies(self), work_size(len(inertia.mass)), self.configuration_size

    @cached_property
    def _weighed_bodies(self) -> tuple[Array, Array, int, int]:
        """What gravity torques are found from, the scratch that it takes, and n."""
        table = self._known_inertia("gravity torque").table
        return self.inertia_chain, table, WORK * len(table), self.configuration_size

    def _known_inertia(self, what: str) -> Inertia:
        if self.inertia is None:
            plural = "are" if what.endswith("s") else "is"
            raise ValueRangeError(f"inertia: {self.name} has none, so its {what} {plural} unknown")
        return self.inertia

    def _as_rows(self, q: ArrayLike, field: str = "q") -> tuple[Array, tuple[int, ...]]:
        """Return configurations or rates as rows, and the shape that they had."""
        n = self.configuration_size
        if type(q) is np.ndarray and q.shape == (n,) and q.dtype == np.float64 and q.flags.c_contiguous:
            return q.reshape(1, n), (n,)  # the fast path: numbers that are not finite the kernel finds
        values = self._rows(field, q)
        return np.ascontiguousarray(values.reshape(-1, n)), values.shape

    def _checked(self, status: int, q: ArrayLike, rates: ArrayLike = 0.0) -> None:
        if status:
            as_array("rates", rates)  # says what is wrong
            self._raise(status, q)

    def _repr_markdown_(self) -> str:
        """Return what notebooks show: a table of the coordinates with their limits."""
        about = describe(self)
        mass = "" if about.mass is None else f", moving mass {about.mass:.3g} kg"
        lines = ["| joint | type | lower | upper | velocity |", "|:--|:--|--:|--:|--:|"]
        for joint in about.joints:
            unit = "°" if joint.type == "revolute" else " m"
            ends = [f"{end:.4g}{unit}" if math.isfinite(end) else "–" for end in (joint.lower, joint.upper)]
            speed = "–" if joint.velocity is None else f"{joint.velocity:.4g}{unit}/s"
            lines.append(f"| {joint.name} | {joint.type} | {' | '.join(ends)} | {speed} |")
        return "\n".join([f"**{about.name}**: reach {about.reach:.3g} m{mass}", "", *lines])


def _fall(gravity: ArrayLike) -> Array:
    if gravity is DOWN:
        return DOWN
    fall = as_array("gravity", gravity, (3,))
    if fall.ndim != 1:
        raise ShapeError(f"gravity: expected shape (3,), got {fall.shape}")
    return np.ascontiguousarray(fall)


def paired_rows(q: Array, field: str, other: Array) -> tuple[tuple[int, ...], Array, Array]:
    """Return the common leading axes of configurations and of what goes with them, and both as rows."""
    try:
        batch_shape = np.broadcast_shapes(q.shape[:-1], other.shape[:-1])
    except ValueError:
        raise ShapeError(
            f"{field}: leading axes {other.shape[:-1]} do not fit those of q, {q.shape[:-1]}"
        ) from None
    first, second = (
        np.ascontiguousarray(
            np.broadcast_to(each, (*batch_shape, each.shape[-1])).reshape(-1, each.shape[-1])
        )
        for each in (q, other)
    )
    return batch_shape, first, second


def base_coordinates(robot: Robot) -> NDArray[np.bool_]:
    """Return which coordinates are x, y and φ of mobile bases, shape (n,)."""
    found = np.zeros(robot.configuration_size, dtype=bool)
    for first, _ in robot.bases:
        found[first : first + 3] = True
    return found


def distinct_names(names: Mapping[str, Sequence[str]]) -> list[str]:
    """Return all names; those that occur twice after the label of their part."""
    counts = Counter(name for each in names.values() for name in each)
    return [
        name if counts[name] == 1 else f"{label}/{name}" for label, each in names.items() for name in each
    ]
