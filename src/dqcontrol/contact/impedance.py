"""Impedance: springs and dampers between an end effector and its target, as joint torques."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK
from dqcontrol.contact.admittance import AXES, ForceSensor
from dqcontrol.contact.impedance_step import impedance_parameters, impedance_torque, impedance_work
from dqcontrol.contact.tool import Tool
from dqcontrol.errors import DivergedError, ValueRangeError, as_array, as_each
from dqcontrol.named_fields import NamedFields
from dqcontrol.robots.dynamics.rigid_bodies import rigid_bodies, work_size
from dqcontrol.robots.robot import DOWN

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

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
        felt = self._wrench if wrench is None else wrench
        if self._step(self._bodies, self._given, motion, felt, self._torque, self._work) != OK:
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
