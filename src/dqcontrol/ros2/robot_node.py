"""A simulated robot as a ROS 2 node: any plant of an arm, at the topics of ros2_control."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, FallenError
from dqcontrol.limits.supervisor.prepared_supervisor import GO
from dqcontrol.plants.live_plant import LivePlant, live_plant
from dqcontrol.ros2.diagnostics import Diagnostics
from dqcontrol.ros2.interfaces import COMMANDS, JOINT_STATES, NEWEST, SENT, WRENCH, publishers_of
from dqcontrol.ros2.loading import Loaded
from dqcontrol.ros2.messages import NANOSECONDS, RefusedError, numbers, stamp_of, trajectory_point
from dqcontrol.ros2.middleware import steady_timer
from dqcontrol.ros2.parameters import Number, declare, number, on_change, refuse_unknown

_NO_COMMANDS = "no commands"
_NOISE_PERIODS = 100_000  # after which the plant's drawn noise repeats
_MOST_LATE = 1.0  # s that the robot catches up; what is more is lost
_MOST_BEHIND = 10.0  # periods of motion that it can have missed: its controller has stopped by then
_CATCH_UP = 0.05  # of its usual speed, that a robot adds to make up for position commands it could not follow
_TIMEOUT, _TIMEOUT_PERIODS = 0.03, 2.5  # s, or so many periods if that is longer


class RobotNode(Node):
    """Moves a spec's plant in real time as commands say, and publishes its joint states, and its wrench if it has one.

    Whatever arrives, the position command that reaches the plant keeps the supervisor's limits. Without commands for
    ``command_timeout`` the robot brakes and holds.

    Parameters
    ----------
    loaded
        The spec.
    name
        Of the node.
    interface
        What it takes: ``velocity``, ``position`` or ``trajectory``.
    wrench_node
        Name of a node of its own that publishes the wrench; this node if omitted.

    Attributes
    ----------
    nodes
        All that are to be served.
    """

    def __init__(
        self,
        loaded: Loaded,
        *,
        name: str = "robot",
        interface: str = "velocity",
        wrench_node: str | None = None,
    ) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        spec, robot, start = loaded.setting.spec, loaded.robot, loaded.case.scene.start
        self._period, self._joints, self._interface = loaded.period, list(robot.joint_names), interface
        self._supervisor, self._from_measured = loaded.limits_alone(interface)
        self._state = self._supervisor.start(start)
        self._warm_up(loaded)
        plant = loaded.case.plant.start(robot, start, loaded.period, _NOISE_PERIODS, spec.seed)
        self._plant = live_plant(plant)
        self._asked: Array | None = None
        self._heard, self._waits, self._fault, self._ticks = 0.0, _NO_COMMANDS, "", 0
        self._is_broken = False
        self._step, self._spread, self._has_missed = 0.0, 1.0, False
        self._input, self._before = np.zeros(robot.input_size), self._plant.measured.copy()
        self._diagnostics = Diagnostics(self, self._condition)
        timeout = max(_TIMEOUT, _TIMEOUT_PERIODS * self._period)
        words = "after which the robot brakes if no command comes, s"
        declare(self, [Number("command_timeout", timeout, 0.002, max(1.0, timeout), words)])
        refuse_unknown(self, ["command_timeout"])
        on_change(self, lambda _: None, self._diagnostics.refuse)
        topic, kind = COMMANDS[interface]
        self._commands = self.create_subscription(kind, topic, self._hear, NEWEST)
        self._joint_states = self.create_publisher(JointState, JOINT_STATES, SENT)
        self.nodes: tuple[Node, ...] = (self, *([Node(wrench_node)] if wrench_node else []))
        self._wrench = wrench_publisher(self.nodes[-1], self._plant)
        self._diagnostics.tell(
            f"serves {robot.name}, {self._period * 1e3:g} ms"
        )  # the first line takes a while
        self._begun, self._origin = time.monotonic(), self.get_clock().now().nanoseconds
        steady_timer(self, loaded.period, self._tick)

    def _warm_up(self, loaded: Loaded) -> None:
        """Compile what a tick needs on another plant, gone before there is ours: one simulator may serve both."""
        start, still = loaded.case.scene.start, np.zeros(loaded.robot.input_size)
        loaded.case.plant.start(loaded.robot, start, loaded.period, 1, 0).step(still)
        self._supervisor.step(start, still, self._supervisor.start(start), 0.0, GO, still)

    def _hear(self, message: Any) -> None:
        try:
            if self._interface == "trajectory":
                asked = trajectory_point(message, self._joints)
            else:
                asked = numbers(self._interface, message.data, len(self._joints))
        except RefusedError as error:
            self._diagnostics.refuse(error)
            return
        self._asked, self._heard = asked, time.monotonic()

    def _tick(self) -> None:
        """Move the plant up to now, and say where it is."""
        if self._is_broken:
            return
        late = time.monotonic() - self._begun - self._ticks * self._period
        stood_still = late > 1.5 * self._period
        self._has_missed |= stood_still
        if late > _MOST_LATE:
            self._begun += late - self._period
            self._origin += int((late - self._period) * NANOSECONDS)
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
            self._step = float(np.abs(self._supervisor.rate(self._state)).max()) * self._period

    def _move(self) -> None:
        waits = self._why_wait()
        if waits:
            self._asked, self._has_missed = None, True
        self._before[:] = self._plant.measured
        self._supervisor.step(self._before, self._rates(), self._state, 0.0, GO, self._input)
        if self._ticks and self._ticks % _NOISE_PERIODS == 0:
            self._plant.rewind()
        self._plant.step(self._input)
        self._ticks += 1
        if waits != self._waits:
            self._waits = waits
            self._diagnostics.tell(self._state_in_words)
        fault = self._plant.fault
        if fault and fault != self._fault:
            self._fault = fault
            self._diagnostics.alarm(f"motors off: {fault}")

    def _why_wait(self) -> str:
        """Say why it does not move; empty if it does."""
        if time.monotonic() - self._heard > number(self, "command_timeout"):
            return _NO_COMMANDS
        topic = self._commands.topic_name
        if self.count_publishers(topic) > 1:
            return f"several publish on {topic}: {', '.join(sorted(publishers_of(self, topic)))}"
        return ""

    @property
    def _state_in_words(self) -> str:
        return f"holds: {self._waits}" if self._waits else "moves"

    def _rates(self) -> Array:
        """Return what the command asks of the joints, rad/s or m/s; without one, to stay where they were told to be."""
        position = self._supervisor.position(self._state)
        if self._interface == "velocity":
            return np.zeros(len(position)) if self._asked is None else self._asked
        goal = position if self._asked is None else self._asked
        ahead = goal - self._before if self._from_measured else self._paced(goal - position)
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
        stamp = self._origin + round(self._ticks * self._period * NANOSECONDS)
        measured = self._plant.measured
        velocity = (measured - self._before) / self._period
        message = JointState(name=self._joints, position=measured.tolist(), velocity=velocity.tolist())
        message.effort = np.asarray(self._plant.effort, dtype=np.float64).tolist()
        stamp_of(stamp, message.header.stamp)
        self._joint_states.publish(message)
        if self._wrench:
            self._wrench(stamp)

    def _condition(self) -> tuple[str, str, Mapping[str, object]]:
        words = ", ".join(self._supervisor.reasons(self._state))
        values = {"interface": self._interface, "limits": words or "no intervention", "periods": self._ticks}
        if self._fault:
            return "error", f"{'broken' if self._is_broken else 'motors off'}: {self._fault}", values
        return "ok", self._state_in_words, values


def wrench_publisher(node: Node, plant: LivePlant) -> Callable[[int], None] | None:
    """Return what publishes a plant's wrench at a time in ns; None if it senses none."""
    if not len(plant.wrench):
        return None
    publisher = node.create_publisher(WrenchStamped, WRENCH, SENT)

    def publish(stamp: int) -> None:
        message = WrenchStamped()
        message.header.frame_id = "tool0"
        stamp_of(stamp, message.header.stamp)
        for vector, values in (
            (message.wrench.force, plant.wrench[:3]),
            (message.wrench.torque, plant.wrench[3:]),
        ):
            vector.x, vector.y, vector.z = map(float, values)
        publisher.publish(message)

    return publish
