"""What every robot has, arm or whole body: its chain, its limits, and how its inputs move it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.robots.files.description import chain_reach, describe
from dqcontrol.robots.inverse.inverse_kinematics import InverseKinematics
from dqcontrol.robots.kinematics import driving
from dqcontrol.robots.kinematics.gravity import WORK, gravity_torques
from dqcontrol.robots.limits import Inertia
from dqcontrol.robots.link_shapes import LinkShapes

if TYPE_CHECKING:
    from dqcontrol.robots.whole_body import Drive

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
    drives
        One row [index of x, displacement, wheel radius, half track, least turning radius, lever of the fastest rim] a
        base that cannot move sideways, m, shape (k, 6).
    """

    input_names: tuple[str, ...]
    input_types: tuple[str, ...]
    input_coordinates: NDArray[np.intp]
    inertia: Inertia | None
    drives: Array
    origin: tuple[str, str | None, str | None] | None = None
    shapes: LinkShapes | None = None
    placed_links: PlacedLinks | None = None

    @property
    def bases(self) -> tuple[tuple[int, str], ...]:
        """Index of the first coordinate of each mobile base, and its kind."""
        return ()

    @property
    def driven_bases(self) -> tuple[Drive, ...]:
        """The bases that cannot move sideways, in the order of ``drives``."""
        return ()

    @property
    def columns_outwards(self) -> list[int]:
        """Columns of the twist Jacobian in the order in which joints carry each other: each is moved by those before.

        Empty where columns are no single screws, as of what lies between two hands, or of joints that move together.
        """
        return list(range(self.input_size))

    def in_form(self, form: Form) -> Robot:
        """Return the same robot with constrained or unconstrained inputs; see `WholeBody`."""
        return self

    @property
    def rollers(self) -> Array:
        """Table of its wheels with rollers that have a rim speed, shape (k, 5), see ``robots.kinematics.driving``."""
        return np.zeros((0, driving.ROLLER_COLUMNS))

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

    @property
    def row_coordinates(self) -> NDArray[np.intp]:
        """Index of the coordinate that moves each joint, in the order of the rows of ``chain``."""
        return np.arange(self.configuration_size)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the rows of ``chain``."""
        return self.joint_names

    @property
    def joint_factors(self) -> Array:
        """What the coordinate of each joint is multiplied by for its screw, in the order of ``chain``."""
        return np.ones(self.configuration_size)

    @property
    def joint_offsets(self) -> Array:
        """What is added to the coordinate of each joint for its screw, rad or m, in the order of ``chain``."""
        return np.zeros(self.configuration_size)

    @property
    def inertia_chain(self) -> Array:
        """The table of all joints by which ``gravity`` knows where the bodies are: the chain, or all of a tree."""
        return self.chain

    @property
    def ends(self) -> tuple[int, ...]:
        """Rows of ``chain`` and `frames` that are hands."""
        return (len(self.chain) - 1,)

    @property
    def follows(self) -> tuple[str, ...]:
        """Names of coordinates that physics cannot give a servo: of joints that follow others."""
        return ()

    @property
    def reach(self) -> float:
        """Length of the stretched arm, m, from its first axis (that of the part after the last base) to the tool."""
        return chain_reach(self)

    def from_start(self, q: Array) -> Robot:
        """Return the robot as it is for a run from a configuration, shape (n,): trees keep a sign from there on."""
        return self

    def integrate(self, q: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return where constant inputs move the robot in a time.

        Joints and holonomic bases move by u dt. A differential drive moves on its arc: with h = ω dt/2 and
        c = v dt sin(h)/h, x by c cos(φ + h), y by c sin(φ + h) and φ by ω dt. So do cars and tricycles; where their
        steering limit does not let them turn that sharply, ω is the largest that it does.

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.
        u
            Inputs, shape (…, m), rad/s or m/s; leading axes as those of q, or broadcast.
        dt
            s; negative goes back.

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
        period = float(as_array("dt", dt, ()))
        batch_shape, starts, inputs = paired_rows(self._rows("q", q), "u", self._inputs("u", u))
        out = np.empty_like(starts)
        if driving.integrate(self.drives, starts, inputs, period, out):
            raise ValueRangeError(f"u: moves {self.name} to NaN or infinity in {period:g} s")
        return out.reshape(*batch_shape, self.configuration_size)

    def gravity_torque(self, q: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)) -> Array:
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
            If a size is wrong, a value is not finite, or the arm has no inertia.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> dqc.load_robot("iiwa7").gravity_torque([0, 1.57, 0, 0, 0, 0, 0]).shape
        (7,)
        """
        if self.inertia is None:
            raise ValueRangeError(f"inertia: {self.name} has none, so its gravity torque is unknown")
        n = self.configuration_size
        values, fall = as_array("q", q, (n,)), as_array("gravity", gravity, (3,))
        if fall.ndim != 1:
            raise ShapeError(f"gravity: expected shape (3,), got {fall.shape}")
        rows = np.ascontiguousarray(values.reshape(-1, n))
        out, bodies = np.empty_like(rows), self.inertia.table
        gravity_torques(
            self.inertia_chain, bodies, rows, np.ascontiguousarray(fall), out, np.empty(WORK * len(bodies))
        )
        return out.reshape(values.shape)

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


def paired_rows(q: Array, field: str, other: Array) -> tuple[tuple[int, ...], Array, Array]:
    """Return the common leading axes of configurations and of what goes with them, and both as rows."""
    try:
        batch_shape = np.broadcast_shapes(q.shape[:-1], other.shape[:-1])
    except ValueError:
        raise ShapeError(
            f"{field}: leading axes {other.shape[:-1]} do not fit those of q, {q.shape[:-1]}"
        ) from None
    first, second = (
        np.ascontiguousarray(np.broadcast_to(values, (*batch_shape, values.shape[-1]))).reshape(
            -1, values.shape[-1]
        )
        for values in (q, other)
    )
    return batch_shape, first, second


def base_coordinates(robot: Robot) -> NDArray[np.bool_]:
    """Return which coordinates are x, y and φ of mobile bases, shape (n,)."""
    found = np.zeros(robot.configuration_size, dtype=bool)
    for first, _ in robot.bases:
        found[first : first + 3] = True
    return found
