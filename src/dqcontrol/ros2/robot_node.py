"""A simulated robot as a ROS 2 node: any plant, at the topics of ros2_control and of mobile bases."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, FallenError
from dqcontrol.plants.plant import ControllerSettings, Plant, RunningPlant, running_plant
from dqcontrol.robots import DifferentialDrive
from dqcontrol.robots.bases import RollerBase
from dqcontrol.robots.whole_body import Drive
from dqcontrol.ros2 import messages
from dqcontrol.ros2.diagnostics import Diagnostics
from dqcontrol.ros2.interfaces import (
    BASE_COMMANDS,
    COMMANDS,
    JOINT_STATES,
    NEWEST,
    ODOMETRY,
    SENT,
    WRENCH,
    check_wheels,
    several_publish,
)
from dqcontrol.ros2.loading import Loaded, RobotParts, silence
from dqcontrol.ros2.middleware import destroyed_on_failure, steady_timer
from dqcontrol.ros2.parameters import Number, declare, number, on_change, refuse_unknown
from dqcontrol.ros2.tracked_hand import pose_publisher
from dqcontrol.supervisor.supervisor_layout import GO

_NO_COMMANDS = "no commands"
_NOISE_PERIODS = 100_000  # after which the plant's drawn noise repeats
_MOST_LATE = 1.0  # s that the robot catches up; what is more is lost
_MOST_BEHIND = 10.0  # periods of motion that it can have missed: its controller has stopped by then
_PLANE = np.ix_([0, 1, 5], [0, 1, 5])  # x, y and heading in the covariance of a pose
_DRIFT = (
    Number("odometry_drift.way", 0.0, 0.0, 1.0, "of what odometry takes a way for, m/√m"),
    Number("odometry_drift.heading_by_way", 0.0, 0.0, 1.0, "of its heading, rad/√m"),
    Number("odometry_drift.heading_by_turn", 0.0, 0.0, 1.0, "of its heading, rad/√rad"),
)  # standard deviations
_CATCH_UP = 0.05  # of its usual speed, that a robot adds to make up for position commands it could not follow


class RobotNode(Node):
    """Moves a spec's plant in real time as commands say; publishes its joint states, and odometry and wrench if any.

    It does so once a period of the spec, or at the pace of the plant's own exchange with its joint controllers.

    Whatever arrives, the position command that reaches the plant keeps the supervisor's limits. Joints and base without
    commands for ``command_timeout`` brake and hold.

    Parameters
    ----------
    loaded
        The spec.
    name
        Of the node.
    interface
        What its joints take: ``velocity``, ``position``, ``trajectory``, ``humanoid`` or ``effort``.
    base_interface
        What its mobile base takes: ``twist``, ``twist-stamped`` or ``wheels``.
    wrench_node
        Name of a node of its own that publishes the wrench; this node if omitted.
    tracker
        Topic that says where the end effector truly is, as a tracker would; None if nothing does.

    Attributes
    ----------
    nodes
        All that are to be served.
    """

    @destroyed_on_failure
    def __init__(
        self,
        loaded: Loaded,
        *,
        name: str = "robot",
        interface: str = "velocity",
        base_interface: str = "twist",
        wrench_node: str | None = None,
        tracker: str | None = None,
    ) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        loaded = loaded.at_state_period() if interface != "effort" else loaded.by_effort()
        self._parts = parts = loaded.parts
        spec, robot, start = loaded.setting.spec, parts.driven, loaded.case.scene.start
        self._period, self._joints, self._interface = loaded.period, parts.joint_names, interface
        self._base_interface = base_interface
        self._supervisor, self._from_measured = loaded.limits_alone(interface)
        self._state = self._supervisor.start(start)
        self._warm_up(loaded)
        plant = loaded.case.plant.start(robot, start, loaded.period, _NOISE_PERIODS, spec.seed)
        self._plant = running_plant(plant)
        self._is_driven = interface == "effort"
        self._drive(None)
        self._waits, self._fault, self._ticks = _NO_COMMANDS, "", 0
        self._told: ControllerSettings | None = None  # by a command, and not yet passed on
        self._is_broken = False
        self._step, self._spread, self._has_missed = 0.0, 1.0, False
        self._input, self._before = np.zeros(robot.input_size), self._plant.measured.copy()
        self._was = self._plant.q.copy()
        self._diagnostics = Diagnostics(self, self._condition)
        timeout = silence(self._period, rolls=parts.base is not None)
        words = "after which the robot brakes if no command comes, s"
        patience = Number("command_timeout", timeout, 0.002, max(1.0, timeout), words)
        declare(self, own := [patience, *(_DRIFT if parts.base else ())])
        refuse_unknown(self)
        on_change(self, self._change, self._diagnostics.refuse)
        self._obeyed: dict[str, Obeyed] = {}
        guarded = messages.guarding(self._diagnostics.refuse)
        if self._joints:
            self._obeyed["joints"] = Obeyed(self, *COMMANDS[interface], self._joint_command, guarded)
        if parts.base:
            if base_interface == "wheels":
                check_wheels(parts)
            self._obeyed["base"] = Obeyed(self, *BASE_COMMANDS[base_interface], self._base_command, guarded)
        self._joint_states = self.create_publisher(JointState, JOINT_STATES, SENT) if self._joints else None
        self._drift = messages.OdometryDrift(
            self._plant.measured[parts.place], np.random.default_rng(spec.seed)
        )
        self._change({one.name: number(self, one.name) for one in own})
        self._odometry = (
            odometry_publisher(self, parts, loaded.case.plant, self._drift) if parts.base else None
        )
        self.nodes: tuple[Node, ...] = (self, *([Node(wrench_node)] if wrench_node else []))
        self._wrench = wrench_publisher(self.nodes[-1], self._plant)
        self._hand = pose_publisher(self, tracker, "odom" if parts.base else "base_link") if tracker else None
        # the first line takes a while
        self._diagnostics.tell(f"serves {robot.name}, {self._period * 1e3:g} ms")
        self._begun, self._origin = time.monotonic(), self.get_clock().now().nanoseconds
        steady_timer(self, loaded.period, self._tick)

    def _change(self, numbers: Mapping[str, float]) -> None:
        """Take changed numbers: the drift's alone are kept, others are asked for where they count."""
        for i, one in enumerate(_DRIFT):
            self._drift.deviations[i] = numbers.get(one.name, self._drift.deviations[i])

    def _warm_up(self, loaded: Loaded) -> None:
        """Compile what a tick needs on another plant, gone before there is ours: one simulator may serve both."""
        start, still = loaded.case.scene.start, np.zeros(loaded.parts.driven.input_size)
        loaded.case.plant.start(loaded.parts.driven, start, loaded.period, 1, 0).step(still)
        self._supervisor.step(start, still, self._supervisor.start(start), 0.0, GO, still)

    def _joint_command(self, message: Any) -> Array:
        if self._interface == "trajectory":
            return messages.trajectory_point(message, self._joints)
        if self._interface == "humanoid":
            position, self._told = messages.humanoid_command(message, self._joints)
            return position
        return messages.numbers(self._interface, message.data, len(self._joints))

    def _base_command(self, message: Any) -> Array:
        """Return the velocity of the base that a command asks for: ahead and to the left, m/s, and turning, rad/s."""
        base = self._parts.base
        if isinstance(base, DifferentialDrive) and self._base_interface == "wheels":
            right, left = base.wheel_radius * messages.numbers("wheels", message.data, 2)
            return np.array([0.5 * (right + left), 0.0, 0.5 * (right - left) / base.half_track])
        if isinstance(base, RollerBase) and self._base_interface == "wheels":
            return base.from_wheel_speeds(messages.numbers("wheels", message.data, len(base.wheels)))
        twist = message.twist if self._base_interface == "twist-stamped" else message
        return np.array(messages.planar_twist_of(twist, sideways=not isinstance(base, Drive)))

    def _tick(self) -> None:
        """Move the plant up to now, and say where it is."""
        if self._is_broken:
            return
        late = time.monotonic() - self._begun - self._ticks * self._period
        stood_still = late > 1.5 * self._period
        self._has_missed |= stood_still
        if late > _MOST_LATE:
            self._begun += late - self._period
            self._origin += int((late - self._period) * messages.NANOSECONDS)
            late = self._period
        due = round(late / self._period)
        try:
            for _ in range(due):
                self._move()
        except (DivergedError, FallenError) as error:  # it is silent from now on, so its controller stops
            self._is_broken, self._fault = True, str(error)
            self._diagnostics.alarm(f"broken: {error}")
            return
        if due > 0:
            self._publish()
        if stood_still:
            self._has_missed = True  # again: what was commanded meanwhile may be heard only now
        elif due and not self._waits:
            rate = self._supervisor.rate(self._state)[self._parts.joint_inputs]
            self._step = float(np.abs(rate).max(initial=0.0)) * self._period

    def _move(self) -> None:
        waits = self._why_wait()
        self._before[:] = self._plant.measured
        if self._interface == "effort":
            self._drive(self._obeyed["joints"].asked)
        if self._is_driven:
            self._input[:] = 0.0
        else:
            self._supervisor.step(self._before, self._rates(), self._state, 0.0, GO, self._input)
        if self._ticks and self._ticks % _NOISE_PERIODS == 0:
            self._plant.rewind()
        self._was[:] = self._plant.q
        self._plant.step(self._input)
        self._ticks += 1
        if waits != self._waits:
            self._waits = waits
            self._diagnostics.tell(self._state_in_words)
        fault = self._plant.fault
        if fault and fault != self._fault:
            self._fault = fault
            self._diagnostics.alarm(f"motors off: {fault}")

    def _drive(self, asked: Array | None) -> None:
        """Pass efforts on to the joints; without any they brake and hold where they are."""
        if asked is None and self._is_driven:
            self._plant.take_effort(None)
            limits, q = self._parts.driven.limits, self._plant.measured
            self._state = self._supervisor.start(np.clip(q, limits.lower, limits.upper))
        elif asked is not None:
            self._plant.take_effort(asked)
        self._is_driven = asked is not None

    def _why_wait(self) -> str:
        """Forget commands that do not count; say why joints and base do not move, empty if they do."""
        timeout, found = number(self, "command_timeout"), {}
        for name, obeyed in self._obeyed.items():
            if why := obeyed.why_not(timeout):
                found[name], obeyed.asked = why, None
                self._has_missed |= name == "joints"
        if len(found) == len(self._obeyed) and len(set(found.values())) == 1:
            return next(iter(found.values()))
        return "; ".join(f"{name}: {why}" for name, why in found.items())

    @property
    def _state_in_words(self) -> str:
        return f"holds: {self._waits}" if self._waits else "moves"

    def _rates(self) -> Array:
        """Return what the commands ask for, rad/s or m/s; without one, joints stay where they were told to be."""
        rates, parts = np.zeros(len(self._input)), self._parts
        if "joints" in self._obeyed:
            rates[parts.joint_inputs] = self._joint_rates(self._obeyed["joints"].asked)
        if "base" in self._obeyed and (asked := self._obeyed["base"].asked) is not None:
            rates[parts.base_inputs] = parts.base_rates(self._before, asked)
        return rates

    def _joint_rates(self, asked: Array | None) -> Array:
        position = self._supervisor.position(self._state)[self._parts.joint_inputs]
        if self._interface in ("velocity", "effort"):
            return np.zeros(len(position)) if asked is None else asked
        if asked is not None and self._told is not None:
            self._plant.set_joint_control(self._told)
            self._told = None
        goal = position if asked is None else asked
        from_measured = self._from_measured
        ahead = goal - self._before[self._parts.joints] if from_measured else self._paced(goal - position)
        return ahead / self._period

    def _paced(self, ahead: Array) -> Array:
        """Return the part of the way to a position command that one period goes.

        It is all of it, but for what came while the robot waited or its process stood still: the robot goes there about
        as fast as it went before, and catches up with commands that move on a little faster than these.
        """
        if self._has_missed:
            self._has_missed = False
            behind = float(np.abs(ahead).max()) / self._step if self._step > 0.0 else 1.0
            self._spread = min(behind, _MOST_BEHIND)
        self._spread = max(self._spread - _CATCH_UP, 1.0)
        return ahead / self._spread

    def _publish(self) -> None:
        stamp = self._origin + round(self._ticks * self._period * messages.NANOSECONDS)
        if self._odometry:
            self._odometry(stamp, self._plant.measured, (self._plant.q - self._was) / self._period)
        if self._joint_states:
            own = self._parts.joints
            measured = self._plant.measured[own]
            velocity = (measured - self._before[own]) / self._period
            message = JointState(name=self._joints, position=measured.tolist(), velocity=velocity.tolist())
            message.effort = np.asarray(self._plant.effort, dtype=np.float64).tolist()
            messages.stamp_of(stamp, message.header.stamp)
            self._joint_states.publish(message)
        if self._wrench:
            self._wrench(stamp)
        if self._hand:
            self._hand(stamp, self._parts.driven.fkm(self._plant.q))

    def _condition(self) -> tuple[str, str, Mapping[str, object]]:
        words = ", ".join(self._supervisor.reasons(self._state))
        interface = self._interface if self._joints else self._base_interface
        values = {"interface": interface, "limits": words or "no intervention", "periods": self._ticks}
        if self._fault:
            return "error", f"{'broken' if self._is_broken else 'motors off'}: {self._fault}", values
        return "ok", self._state_in_words, values


class Obeyed:
    """A topic of commands that a robot obeys.

    Attributes
    ----------
    asked
        What the last one asks for; None if there is none that counts.
    """

    def __init__(
        self, node: Node, topic: str, kind: Any, read: Callable[[Any], Array], guarded: messages.Guard
    ) -> None:
        self._node, self._read, self._heard = node, read, -np.inf
        self.asked: Array | None = None
        self.topic: str = node.create_subscription(kind, topic, guarded(self._hear), NEWEST).topic_name

    def why_not(self, timeout: float) -> str:
        """Say why nothing that was asked counts, with commands counting for some time, s; empty if it does."""
        if time.monotonic() - self._heard > timeout:
            return _NO_COMMANDS
        return several_publish(self._node, self.topic)

    def _hear(self, message: Any) -> None:
        self.asked, self._heard = self._read(message), time.monotonic()


def odometry_publisher(
    node: Node, parts: RobotParts, plant: Plant, drift: messages.OdometryDrift
) -> Callable[[int, Array, Array], None]:
    """Return what publishes where a base is, as odometry and as transform.

    It takes a time in ns, and measured configuration and true rates, (n,) each. With a drift, odometry and covariance
    are those of wheels.
    """
    publisher = node.create_publisher(Odometry, ODOMETRY, SENT)
    say_transform = messages.transform_publisher(node)
    position, angle = plant.base_errors()
    of_plant, covariance = np.diag([position**2, position**2, angle**2]), np.zeros((6, 6))
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "odom"

    def publish(stamp: int, measured: Array, rates: Array) -> None:
        drift.follow(measured[parts.place])
        covariance[_PLANE] = of_plant + drift.covariance
        message.pose.covariance = covariance.ravel()
        x, y, heading = drift.pose.tolist()
        messages.stamp_of(stamp, message.header.stamp)
        place, turn, twist = message.pose.pose.position, message.pose.pose.orientation, message.twist.twist
        place.x, place.y, turn.w, turn.z = x, y, math.cos(0.5 * heading), math.sin(0.5 * heading)
        c, s = math.cos(measured[parts.place[2]]), math.sin(measured[parts.place[2]])
        vx, vy, twist.angular.z = rates[parts.place].tolist()
        twist.linear.x, twist.linear.y = c * vx + s * vy, c * vy - s * vx
        publisher.publish(message)
        say_transform(message)

    return publish


def wrench_publisher(node: Node, plant: RunningPlant) -> Callable[[int], None] | None:
    """Return what publishes a plant's wrench at a time in ns; None if it senses none."""
    if not len(plant.wrench):
        return None
    publisher = node.create_publisher(WrenchStamped, WRENCH, SENT)

    def publish(stamp: int) -> None:
        message = WrenchStamped()
        message.header.frame_id = "tool0"
        messages.stamp_of(stamp, message.header.stamp)
        messages.write_parts(message.wrench.force, plant.wrench[:3])
        messages.write_parts(message.wrench.torque, plant.wrench[3:])
        publisher.publish(message)

    return publish
