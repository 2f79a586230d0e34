"""Topics and services of MoveIt Servo on a controller: twists, joint velocities and poses, each when it comes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.node import Node
from std_msgs.msg import Int8
from std_srvs.srv import SetBool

from dqcontrol.errors import ValueRangeError
from dqcontrol.loop.control import Phase
from dqcontrol.loop.targets import JogTarget, PoseTarget, TwistTarget
from dqcontrol.ros2.messages import Guard, RefusedError, numbers, optional
from dqcontrol.ros2.middleware import steady_timer
from dqcontrol.ros2.parameters import number, read_once

if TYPE_CHECKING:
    from dqcontrol.ros2.controller_node import Following

_STATUS_PERIOD = 0.05  # s
_JOINT_SCALE = 0.5  # rad/s at full deflection, MoveIt Servo's own default
_UNITS = "speed_units", "unitless"
# Codes of moveit_msgs/ServoStatus.
_INVALID, _NO_WARNING = -1, 0
_CODES = {"held near a singularity": 2, "slowed near a singularity": 1, "position limit": 6}
_KINDS: tuple[Literal["joints", "twist", "pose"], ...] = "joints", "twist", "pose"  # of ServoCommandType


class ServoTopics:
    """What MoveIt Servo hears and says, for a controller that follows ``servo``.

    The kind of command is that of the newest message; where ``moveit_msgs`` is installed, `~/switch_command_type`
    chooses one, and the other topics are then not listened to. Joint velocities need ``control_msgs``.

    Parameters
    ----------
    node
        Whose topics.
    following
        The controller.
    guarded
        Wraps what hears a message, and may refuse it.
    """

    def __init__(self, node: Node, following: Following, guarded: Guard) -> None:
        self._node, self._following = node, following
        self.is_paused: bool = False
        self._chosen: str = ""
        units = read_once(node, "command_in_type", _UNITS[0], "speed_units (m/s, rad/s) or unitless (−1 … 1)")
        if units not in _UNITS:
            raise ValueRangeError(
                f"parameter command_in_type: must be one of {', '.join(_UNITS)}, got {units!r}"
            )
        self._is_unitless = units == _UNITS[1]
        node.create_subscription(TwistStamped, "~/delta_twist_cmds", guarded(self.hear_twist), 1)
        node.create_subscription(PoseStamped, "~/pose_target_cmds", guarded(self.hear_pose), 1)
        if control := optional("control_msgs.msg"):
            node.create_subscription(control.JointJog, "~/delta_joint_cmds", guarded(self.hear_jog), 1)
        else:
            node.get_logger().warning("~/delta_joint_cmds: not offered, control_msgs is not installed")
        node.create_service(SetBool, "~/pause_servo", self._pause)
        moveit, services = optional("moveit_msgs.msg"), optional("moveit_msgs.srv")
        if services:
            node.create_service(services.ServoCommandType, "~/switch_command_type", self._switch)
        self._status_type: Any = moveit.ServoStatus if moveit else Int8
        self._status = node.create_publisher(self._status_type, "~/status", 1)
        steady_timer(node, _STATUS_PERIOD, self._tell)

    def hear_twist(self, message: TwistStamped) -> None:
        """Move the end effector on with a twist."""
        if self._is_for("twist"):
            target = self._following.aimed(TwistTarget, lambda speeds: TwistTarget(speeds, self._timeout))
            if self._is_unitless:
                speeds, twist = target.speeds, message.twist
                for axis in "xyz":
                    setattr(twist.linear, axis, speeds.linear * getattr(twist.linear, axis))
                    setattr(twist.angular, axis, speeds.angular * getattr(twist.angular, axis))
            self._following.hear_twist(message)

    def hear_pose(self, message: PoseStamped) -> None:
        """Take the end effector to a pose."""
        if self._is_for("pose"):
            patience = number(self._node, "pose_timeout") or np.inf
            self._following.aimed(PoseTarget, lambda speeds: PoseTarget(speeds, patience))
            self._following.hear_pose(message)

    def hear_jog(self, message: Any) -> None:
        """Move the joints that a ``control_msgs/JointJog`` names; the others stand."""
        if not self._is_for("joints"):
            return
        control, names = self._following.control, list(self._following.joint_names)
        told = list(message.joint_names)
        if unknown := [name for name in told if name not in names]:
            raise RefusedError(f"joint jog: no joint '{unknown[0]}' (allowed: {', '.join(names)})")
        if len(set(told)) < len(told):
            raise RefusedError("joint jog: a joint is named twice")
        speeds = numbers("joint jog", message.velocities, len(told))
        rates = np.zeros(control.robot.input_size)
        first = len(rates) - len(names)  # after those of a base
        for name, speed in zip(told, speeds, strict=True):
            rates[first + names.index(name)] = _JOINT_SCALE * speed if self._is_unitless else speed
        target = self._following.aimed(JogTarget, lambda _: JogTarget(len(rates), self._timeout))
        target.ask(control.time, rates)

    @property
    def _timeout(self) -> float:
        return number(self._node, "twist_timeout")

    def _is_for(self, kind: str) -> bool:
        return not self.is_paused and self._chosen in ("", kind)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Let the end effector come to rest where it is, and hear nothing until told otherwise."""
        self.is_paused = request.data
        if self.is_paused:
            target = self._following.aimed(TwistTarget, lambda speeds: TwistTarget(speeds, self._timeout))
            target.ask(self._following.control.time, np.zeros(3), np.zeros(3), of_hand=False)
        response.success, response.message = True, "paused" if self.is_paused else "hears commands"
        return response

    def _switch(self, request: Any, response: Any) -> Any:
        response.success = 0 <= request.command_type < len(_KINDS)
        if response.success:
            self._chosen = _KINDS[request.command_type]
        return response

    def _tell(self) -> None:
        control = self._following.control
        codes = [code for reason, code in _CODES.items() if reason in control.reason]
        code = (codes or [_NO_WARNING])[0] if control.phase is Phase.ACTIVE else _INVALID
        if self._status_type is Int8:
            self._status.publish(Int8(data=code))
        else:
            self._status.publish(self._status_type(code=code, message=control.reason or control.phase.value))
