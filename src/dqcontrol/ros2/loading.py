"""A spec as the parts of a controller or of a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.contact import PreparedImpedance, Tool
from dqcontrol.controller import Controller
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.experiments.prepared_experiment import Combination, PreparedExperiment, prepare, prepare_spec
from dqcontrol.experiments.spec import AnyLaw, as_spec, read_data
from dqcontrol.loop.control import FASTEST_REFERENCE
from dqcontrol.loop.replanning import refuse_replanning
from dqcontrol.loop.targets import LeaderTarget, PoseTarget, SampledTarget, Speeds, Target, TwistTarget
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import command_mode, lagging_mode
from dqcontrol.robots import Robot, WholeBody
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.robots.whole_body import Base, Drive
from dqcontrol.supervisor import PreparedSupervisor, Supervisor

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class RobotParts:
    """A robot as its topics see it: joints, and perhaps one mobile base.

    Attributes
    ----------
    robot
        As the spec has it; with drives in either form.
    """

    robot: Robot

    def __post_init__(self) -> None:
        if isinstance(self.robot, WholeBody) and len(self.robot.bases) > 1:
            raise ShapeError(
                f"robot: {self.robot.name} has {len(self.robot.bases)} mobile bases; ROS 2 tells of one"
            )

    @cached_property
    def base(self) -> Base | None:
        """The mobile base, if there is one."""
        parts = self.robot.parts if isinstance(self.robot, WholeBody) else ()
        bases = (part for part in parts if isinstance(part, Base))
        return next(bases, None)

    @cached_property
    def driven(self) -> Robot:
        """The robot with inputs that it can follow: v and ω of a drive."""
        return self.robot.in_form("constrained")

    @cached_property
    def place(self) -> Indices:
        """Coordinates x, y and φ of the base; none without one."""
        return np.flatnonzero(base_coordinates(self.robot))

    @cached_property
    def joints(self) -> Indices:
        """Coordinates of the joints."""
        return np.flatnonzero(~base_coordinates(self.robot))

    @cached_property
    def joint_inputs(self) -> Indices:
        """Inputs of `driven` that move joints, in the order of the joints."""
        return np.flatnonzero(~base_coordinates(self.robot)[self.driven.input_coordinates])

    @cached_property
    def base_inputs(self) -> Indices:
        """Inputs of `driven` that move the base: v and ω, or ẋ, ẏ and φ̇."""
        return np.flatnonzero(base_coordinates(self.robot)[self.driven.input_coordinates])

    @cached_property
    def own_joint_inputs(self) -> Indices:
        """Inputs of the robot as the spec has it that move joints."""
        return np.flatnonzero(~base_coordinates(self.robot)[self.robot.input_coordinates])

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints."""
        return [self.robot.joint_names[i] for i in self.joints]

    def followed(self, q: Array, rates: Array) -> Array:
        """Return inputs of `driven` for rates of the robot as the spec has it, at a configuration (n,)."""
        if isinstance(self.robot, WholeBody) and self.robot.form == "unconstrained":
            return self.robot.feasible_inputs(q, rates)
        return rates

    def driven_positions(self, position: Array) -> Array:
        """Return position commands of `driven` for those of the robot as the spec has it."""
        is_whole = len(position) == self.robot.configuration_size
        return position[self.driven.input_coordinates] if is_whole else position

    def base_twist(self, q: Array, inputs: Array) -> tuple[float, float, float]:
        """Return the base's velocity ahead and to the left, m/s, and its turning, rad/s, for inputs of `driven`."""
        u = inputs[self.base_inputs]
        if isinstance(self.base, Drive):
            return float(u[0]), 0.0, float(u[1])
        c, s = np.cos(q[self.place[2]]), np.sin(q[self.place[2]])
        return float(c * u[0] + s * u[1]), float(c * u[1] - s * u[0]), float(u[2])

    def base_rates(self, q: Array, twist: Array) -> Array:
        """Return the inputs of the base that have it move so; the inverse of `base_twist`, which drives may lack."""
        ahead, left, turn = twist
        if isinstance(self.base, Drive):
            return np.array([ahead, turn])
        c, s = np.cos(q[self.place[2]]), np.sin(q[self.place[2]])
        return np.array([c * ahead - s * left, s * ahead + c * left, turn])


_SILENT, _SILENT_PERIODS = 0.03, 2.5  # s, or so many periods if that is longer
_ROLLING, _ROLLING_PERIODS = 0.08, 1.6  # what rolls is to stand within 0.1 s, if its period allows that


def silence(period: float, *, rolls: bool = False) -> float:
    """Return after how long without a message the other side is taken for dead, where nobody says: s, as the period.

    A mobile base rolls on meanwhile: with slow periods it waits for one message that is late, not for two.
    """
    longest = _SILENT_PERIODS * period
    if rolls:
        longest = min(longest, max(_ROLLING, _ROLLING_PERIODS * period))
    return max(_SILENT, longest)


@dataclass
class Loaded:
    """A spec of one run, and what may be changed of it while it runs.

    Attributes
    ----------
    setting, case
        The spec, and its one combination.
    law, supervisor
        Their parameters as they are now.
    speeds
        Limits of what poses and twists ask for.
    """

    setting: PreparedExperiment
    case: Combination
    law: AnyLaw
    supervisor: Supervisor
    speeds: Speeds

    @property
    def robot(self) -> Robot:
        """Of the spec: an arm, a mobile base, or both."""
        return self.case.scene.robot

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.setting.spec.period

    @property
    def state_period(self) -> float:
        """How often the robot tells its states, s: each control period, if its plant has no exchange of its own."""
        return self.case.plant.state_period(self.period)

    def at_state_period(self) -> Loaded:
        """Return the same with the period of the robot's states for its control period, as the robot's node has it."""
        spec = msgspec.structs.replace(self.setting.spec, period=self.state_period)
        return replace(self, setting=replace(self.setting, spec=spec))

    @cached_property
    def parts(self) -> RobotParts:
        """The robot as its topics see it."""
        return RobotParts(self.robot)

    @property
    def stale_after(self) -> float:
        """Age from which what was measured no longer counts, s."""
        return self.supervisor.stale_after or silence(self.period)

    @property
    def rolling_time(self) -> float:
        """How long a mobile base rolls on without a message, s: for `stale_after`, if somebody says that."""
        return self.supervisor.stale_after or silence(self.period, rolls=True)

    @property
    def longest_advance(self) -> float:
        """How far the reference's time advances in a step at most, s: a base rolls on until a late message comes."""
        usual = FASTEST_REFERENCE * self.period
        return max(usual, self.rolling_time) if self.parts.base else usual

    @property
    def payload(self) -> Tool:
        """What the end effector carries, as the supervisor has it."""
        return self.supervisor.payload or Tool()

    @cached_property
    def linear_model(self) -> LinearModel | None:
        """The plant where the spec starts, for small motions; None if that is unknown."""
        return self.case.plant.linear_model(self.robot, self.case.scene.start, self.period)

    def target(self, source: str) -> Target:
        """Return what gives the desired motion: the ``spec``, a ``pose``, a leader's with ``haptics``, or a ``twist``.

        With ``servo`` it begins as with ``twist``.
        """
        if source == "spec":
            return SampledTarget(self.case.scene.samples, self.period)
        kinds = {"pose": PoseTarget, "haptics": LeaderTarget}
        return kinds.get(source, TwistTarget)(self.speeds)

    def prepared_law(self, source: str, law: AnyLaw | None = None) -> Controller:
        """Return the law, or another one in its place, ready to run; without contact where that is a leader's."""
        reference = self.case.scene.reference if source == "spec" else None
        mode, lag = lagging_mode(self.case.plant), self.case.plant.lag(self.robot)
        law = law or self.law
        if source == "haptics":
            law = msgspec.structs.replace(law, contact=None)
        made = law.prepare(self.robot, reference, self.period, self.case.limits, mode, lag=lag)
        refuse_replanning(made, reference, "which no node does")
        return made

    def prepared_supervisor(self, interface: str) -> PreparedSupervisor:
        """Return the supervisor ready to run, for a robot that takes velocities or positions."""
        supervisor = msgspec.structs.replace(self.supervisor, stale_after=self.stale_after)
        return supervisor.prepare(self.robot, self.period, self._mode(interface))

    def limits_alone(self, interface: str) -> tuple[PreparedSupervisor, bool]:
        """Return a supervisor that only keeps velocity, acceleration and position limits, as a robot itself does.

        Its inputs are those that the robot can follow: v and ω of drives. The second is whether they are counted from
        the measured joints.
        """
        mode = self._mode(interface)
        alone = self.supervisor.limits_alone().prepare(self.parts.driven, self.period, mode)
        return alone, mode == "measured"

    def impedance(self, interface: str) -> PreparedImpedance | None:
        """Return what gives the efforts that a controller sends; None where it sends something else.

        Raises
        ------
        ValueRangeError
            If the spec's plant has no impedance, one that needs the wrench, or one too stiff for torques a period late.
        """
        if interface != "effort":
            return None
        plant, kind = self.case.plant, type(self.case.plant).__struct_config__.tag
        impedance = plant.prepared_impedance(self.robot)
        if impedance is None:
            raise ValueRangeError(
                f"interface: 'effort' sends the torques of plant.impedance, and plant '{kind}' has none; "
                "give it one, or take another interface"
            )
        if impedance.impedance.feels:
            raise ValueRangeError(
                "plant.impedance.mass: takes a wrench as fresh as the torque, which messages do not bring; leave it out"
            )
        if self.state_period != self.period:
            raise ValueRangeError(
                f"interface: 'effort' needs joint states each period, {self.period:g} s, and the plant's "
                f"exchange_period is {self.state_period:g} s; leave it out"
            )
        impedance.check_period(self.case.scene.start, self.period, is_late=True)
        return impedance

    def by_effort(self) -> Loaded:
        """Return the same with joints that take efforts.

        Raises
        ------
        ValueRangeError
            If the plant's joints take none.
        """
        plant = self.case.plant.by_effort()
        if plant is None:
            kind = type(self.case.plant).__struct_config__.tag
            raise ValueRangeError(
                f"interface: 'effort' needs joints that take torques, and those of plant '{kind}' take none; take "
                "'mujoco', 'compliant' with mode TORQUE or TORQUE_GC, or another interface"
            )
        return replace(self, case=replace(self.case, plant=plant))

    def _mode(self, interface: str) -> Literal["integrated", "measured"]:
        return command_mode(self.case.plant) if interface != "velocity" else "integrated"


def load(source: str | Path) -> Loaded:
    """Load a spec that describes one run of an arm, of a mobile base, or of arms on one.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit, or it describes several runs or several bases.
    """
    return _loaded(source, prepare(source))


def load_simulated(source: str | Path) -> Loaded:
    """Do the same for a simulated robot: what a spec says of learning and tuning is not its concern."""
    where, data, folder = read_data(source)
    data = {key: value for key, value in data.items() if key not in ("learn", "tune")}
    return _loaded(source, prepare_spec(as_spec(where, data, folder), folder, {}))


def _loaded(source: str | Path, setting: PreparedExperiment) -> Loaded:
    case = setting.only_case(source, "a robot does one at a time")
    supervisor = setting.spec.supervisor_of(case.plant) or Supervisor()
    # has numbers to change
    supervisor = msgspec.structs.replace(supervisor, payload=supervisor.payload or Tool())
    loaded = Loaded(setting, case, case.variant.law, supervisor, Speeds())
    _ = loaded.parts  # which refuses several bases
    return loaded
