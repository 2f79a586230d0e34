"""A whole motion as one goal of the action ``FollowJointTrajectory``, for arms that offer nothing else."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from rclpy.action.client import ActionClient
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from dqcontrol.arrays import Array
from dqcontrol.errors import MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.experiments.run import Run
from dqcontrol.loop.interrupts import Interrupts
from dqcontrol.ros2.interfaces import JOINT_STATES, NEWEST
from dqcontrol.ros2.messages import RefusedError, by_name
from dqcontrol.ros2.middleware import spin, steady_timer
from dqcontrol.ros2.parameters import Number, declare, joint_names_read, refuse_unknown

ACTION = "/joint_trajectory_controller/follow_joint_trajectory"
_PATIENCE = 5.0  # s: discovery takes one, and drivers of robots start slowly
_AT_START = 0.01  # rad or m that the arm may be from where the run starts, as behind drivers
_STILL = 0.05  # rad/s or m/s: below it a motion begins, or ends, at rest
_BRAKING = 1.0  # rad/s² or m/s²: gentle
_SUCCEEDED, _CANCELED = 4, 5  # of action_msgs/GoalStatus
_ERRORS = {  # of control_msgs/FollowJointTrajectory
    -1: "invalid goal",
    -2: "invalid joints",
    -3: "old header stamp",
    -4: "path tolerance violated",
    -5: "goal tolerance violated",
}


class TrajectoryGoal(Node):
    """Sends the motion of a run to an arm, once that stands where the motion begins, and hears how it ended.

    No law and no supervisor is in the loop meanwhile: the arm's own controller follows, and gives up beyond the
    parameter ``tolerance``.

    Parameters
    ----------
    run
        Of an arm; it begins at rest.
    name
        Of the node.
    action
        Name of the action.

    Attributes
    ----------
    outcome
        How the motion ended, in words; empty before.
    is_done
        Whether it ended as it should.
    length
        How many points in what time.

    Raises
    ------
    MissingExtraError
        If ``control_msgs`` is not installed.
    ShapeError
        If the robot is no arm.
    ValueRangeError
        If the run begins on the way, or cannot be sent.
    """

    def __init__(self, run: Run, *, name: str = "dqcontrol", action: str = ACTION) -> None:
        kind = _action_type()
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self._joints = joint_names_read(self, list(run.robot.joint_names))
        declare(self, [Number("tolerance", 0.1, 0.001, 3.2, "of path and end, rad or m")])
        refuse_unknown(self)
        tolerance = self.get_parameter("tolerance").value
        self._start, trajectory = run.record.q[0], trajectory_of(run, self._joints)
        self._goal: Any = kind.Goal(trajectory=trajectory)
        bound = import_module("control_msgs.msg").JointTolerance
        bounds = [bound(name=joint, position=tolerance) for joint in self._joints]
        self._goal.path_tolerance = self._goal.goal_tolerance = bounds
        points: Any = trajectory.points
        last = points[-1].time_from_start
        self.length: str = f"{len(points)} points in {last.sec + 1e-9 * last.nanosec:.2f} s"
        self._client = ActionClient(self, kind, action)
        self._action, self._handle, self._is_sent = action, None, False
        self.outcome, self.is_done = "", False
        self._states = self.create_subscription(JointState, JOINT_STATES, self._hear, NEWEST)
        self._waiting = steady_timer(self, _PATIENCE, self._give_up)

    def serve(self, interrupts: Interrupts) -> None:
        """Work until the motion has ended; an interrupt cancels it, a second one does not wait for that."""
        is_cancelling = False

        def look() -> None:
            nonlocal is_cancelling
            if not interrupts.count or is_cancelling:
                return
            if not self._is_sent:
                self.outcome = "canceled before it began"
            elif self._handle is not None:  # until it is accepted there is nothing to cancel
                self._handle.cancel_goal_async()
                is_cancelling = True

        spin(self, is_over=lambda: bool(self.outcome) or interrupts.count > 1, look=look)

    def _hear(self, message: JointState) -> None:
        """Send the goal, if the arm stands where it begins."""
        if self._is_sent or self.outcome or not self._client.server_is_ready():
            return
        try:
            joints = by_name("joint states", message.name, message.position, self._joints)
        except RefusedError as error:
            self.outcome = str(error)
            return
        away = np.abs(joints - self._start)
        i = int(np.argmax(away))
        if away[i] > _AT_START:
            self.outcome = (
                f"{self._joints[i]} is at {joints[i]:.4g}, {away[i]:.3g} rad or m from where the run starts; "
                f"at most {_AT_START:g} is allowed"
            )
            return
        self._is_sent = True
        self._waiting.cancel()
        self.destroy_subscription(self._states)
        self.get_logger().info(f"goal: {self.length}")
        self._client.send_goal_async(self._goal).add_done_callback(self._answered)

    def _answered(self, future: Any) -> None:
        self._handle = future.result()
        if not self._handle.accepted:
            self.outcome = f"{self._action} refused the goal"
            return
        self._handle.get_result_async().add_done_callback(self._ended)

    def _ended(self, future: Any) -> None:
        status, result = future.result().status, future.result().result
        self.is_done = status == _SUCCEEDED and not result.error_code
        if self.is_done:
            self.outcome = "done"
            return
        why = _ERRORS.get(result.error_code, "")
        words = "canceled" if status == _CANCELED else "given up by the arm"
        self.outcome = ": ".join(word for word in (words, why, result.error_string) if word)

    def _give_up(self) -> None:
        missing = "joint states" if self._client.server_is_ready() else f"action {self._action}"
        self.outcome = f"nobody offers {missing}"


def trajectory_of(run: Run, joints: list[str]) -> JointTrajectory:
    """Return the motion of a run: a point a sample, with positions (rad or m), velocities (per s) and time (s).

    One that ends on the way brakes evenly to one point more: q + T q̇ / 2 after T.

    Parameters
    ----------
    run
        Of an arm.
    joints
        Names in messages.

    Raises
    ------
    ShapeError
        If the robot is no arm.
    ValueRangeError
        If it begins on the way, or diverged, or has no room to brake in.
    """
    robot, time, q = run.robot, run.record.time - run.record.time[0], run.record.q
    if tuple(robot.input_names) != tuple(robot.joint_names):
        raise ShapeError(f"robot: {robot.name} is no arm alone; its base cannot be sent along")
    if len(time) < 3 or not np.isfinite(q).all():
        raise ValueRangeError("run: has no motion that could be sent")
    rates: Array = np.gradient(q, time, axis=0)
    if (fastest := float(np.abs(rates[0]).max())) > _STILL:
        raise ValueRangeError(
            f"run: starts on the way, a joint at {fastest:.2g} rad/s or m/s, and an arm stands; "
            "give its reference a ramp"
        )
    rates[0] = 0.0
    if (fastest := float(np.abs(rates[-1]).max())) > _STILL:
        braking = fastest / _BRAKING
        end = q[-1] + braking * rates[-1] / 2
        if ((end < robot.limits.lower) | (end > robot.limits.upper)).any():
            raise ValueRangeError("run: ends on the way, with no room to brake in")
        time, q = np.append(time, time[-1] + braking), np.vstack([q, end])
        rates = np.vstack([rates, np.zeros(len(end))])
    rates[-1] = 0.0
    points = [
        JointTrajectoryPoint(
            positions=position.tolist(),
            velocities=rate.tolist(),
            time_from_start=Duration(seconds=moment).to_msg(),
        )
        for moment, position, rate in zip(time.tolist(), q, rates, strict=True)
    ]
    return JointTrajectory(joint_names=joints, points=points)


def _action_type() -> Any:
    try:
        return import_module("control_msgs.action").FollowJointTrajectory
    except ImportError as error:
        raise MissingExtraError(
            f"ros2: cannot import control_msgs ({error}); it is in no wheel: source a ROS 2 installation"
        ) from None
