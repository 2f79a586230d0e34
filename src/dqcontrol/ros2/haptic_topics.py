"""A leader that feels: it leads the end effector, and what that feels goes back to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from dqcontrol.arrays import Array
from dqcontrol.contact import Admittance, bears
from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.contact_check import sensed, stiffest_body
from dqcontrol.experiments.spec import AnyLaw
from dqcontrol.loop.control import Control, Phase
from dqcontrol.loop.targets import LeaderTarget
from dqcontrol.plants.servo import Servo
from dqcontrol.ros2.interfaces import SENT
from dqcontrol.ros2.loading import Loaded
from dqcontrol.ros2.messages import write_parts
from dqcontrol.ros2.parameters import Number, number

NUMBERS = (
    Number("force_scale", 1.0, 1e-3, 1e3, "newtons at the leader for one at the end effector"),
    Number("force_limit", 10.0, 0.0, 1e3, "largest force at the leader, N"),
    Number("torque_limit", 1.0, 0.0, 1e3, "largest torque at the leader, N·m"),
    Number(
        "leader_delay", 0.0, 0.0, 1.0, "of messages to and from the leader, each way, s, for what is borne"
    ),
)
POSE_TIMEOUT = 0.1  # s, unless said: a leader's poses are a stream
# Periods from a leader's pose to the force at where that takes the end effector, beside the plant's lag and delay: the
# pose waits for the controller's step, the command for the robot's, the wrench for the leader's; up to one each.
_PERIODS = 3
_RANGE = (1.0, 1e8)  # N/m that are looked at: from next to nothing to beyond steel on steel
_CLOSE = 1.01  # the limit is found to a percent


class HapticTopics:
    """The wrench for a leader.

    The spec's ``contact`` is the leader's: the mass and damping with which it gives way, and the arm's sensor.

    Parameters
    ----------
    node
        Whose topic.
    contact
        Of the spec.
    control, target
        Of the arm.
    frame
        Of the leader's poses, along whose axes the wrench is.

    Raises
    ------
    ValueRangeError
        If there is no contact.
    """

    def __init__(
        self,
        node: Node,
        contact: Admittance | None,
        control: Control,
        target: LeaderTarget,
        frame: str,
    ) -> None:
        if contact is None:
            raise ValueRangeError(
                "contact: with --follow haptics it says how the leader gives way, by mass and damping; give it"
            )
        self._node, self._control, self._target = node, control, target
        self._sensor = msgspec.structs.replace(contact, axes="base").start(control.law.period)
        self._publisher = node.create_publisher(WrenchStamped, "~/wrench", SENT)
        self._message = WrenchStamped()
        self._message.header.frame_id = frame

    def hear(self, wrench: Array, stamp: Any) -> None:
        """Let the leader feel a wrench at the sensor, shape (6,), N and N·m, with its stamp, while it leads."""
        control = self._control
        pushed = np.zeros(6)
        if control.phase is Phase.ACTIVE and self._target.is_led(control.time):
            pushed = self._sensor.contact_wrench(control.robot.fkm(control.measured), wrench)
            pushed = number(self._node, "force_scale") * pushed
        if control.is_commanding:
            self._publish(pushed, stamp)

    def let_go(self) -> None:
        """Let leader and end effector go where they are: nothing is felt any more."""
        self._target.ask(self._control.time, np.full(8, np.nan))
        self._publish(np.zeros(6), self._node.get_clock().now().to_msg())

    def _publish(self, pushed: Array, stamp: Any) -> None:
        """Publish moment and force, shape (6,)."""
        told = self._message.wrench
        for vector, values, limit in (
            (told.torque, pushed[:3], "torque_limit"),
            (told.force, pushed[3:], "force_limit"),
        ):
            share = min(1.0, number(self._node, limit) / max(float(np.linalg.norm(values)), 1e-12))
            write_parts(vector, share * values)
        self._message.header.stamp = stamp
        self._publisher.publish(self._message)


def stiffness_borne(loaded: Loaded, law: AnyLaw, numbers: Mapping[str, float]) -> float:
    """Return the stiffness, N/m, from which on what the arm touches makes a leader's loop unstable.

    Parameters
    ----------
    loaded, law
        The spec, and the law whose contact is the leader's.
    numbers
        Of parameters.
    """
    is_borne, least, most = _loop_of(loaded, law, numbers), *_RANGE
    if is_borne(most):
        return math.inf
    while most > _CLOSE * least:
        middle = math.sqrt(least * most)
        least, most = (middle, most) if is_borne(middle) else (least, middle)
    return least


def check_leader(loaded: Loaded, law: AnyLaw, numbers: Mapping[str, float]) -> None:
    """Raise a `ValueRangeError` if the stiffest springy body of the spec's world makes a leader's loop unstable."""
    stiffest = stiffest_body(loaded.setting.spec)
    if stiffest is None or (law.contact is not None and law.contact.allow_unstable):
        return
    name, stiffness = stiffest
    if not _loop_of(loaded, law, numbers)(stiffness):
        raise ValueRangeError(
            f"contact: world.{name} has {stiffness:.4g} N/m, with which leader and arm are unstable together; the "
            "leader needs more damping, or force_scale has to be smaller; the parameter allow_unstable lets it through"
        )


def _loop_of(loaded: Loaded, law: AnyLaw, numbers: Mapping[str, float]) -> Callable[[float], bool]:
    """Return what says whether leader and arm bear a stiffness, N/m: a scaled force is that of one scaled alike."""
    case = replace(loaded.case, variant=replace(loaded.case.variant, law=law), prepared=None)
    robot, start, period, scale = loaded.robot, case.scene.start, loaded.period, numbers["force_scale"]
    time, delay = case.plant.lag(robot).mean
    late = delay + _PERIODS * period + 2 * numbers["leader_delay"]
    model = Servo(time_constant=time, delay=late).linear_model(robot, start, period)
    assert model is not None
    contact, prepared, soft = sensed(case), loaded.prepared_law("haptics", law), np.zeros(len(start))
    return lambda stiffness: bears(contact, prepared, model, start, scale * stiffness, soft)
