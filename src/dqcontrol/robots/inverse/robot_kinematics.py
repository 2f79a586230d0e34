"""LeRobot's interface to kinematics, calm where a target is out of reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.robots.files.load import load_robot
from dqcontrol.robots.inverse.nearest_pose import descended
from dqcontrol.robots.serial_arm import SerialArm

_FRAME = 1 / 30  # s: of LeRobot's loops
_STEPS = 10  # of a descent in a call: a step within reach ends below 1e-3 mm after three frames (tests)


class RobotKinematics:
    """Forward and inverse kinematics as ``lerobot.model.RobotKinematics`` has them: degrees and 4 × 4 matrices.

    The inverse descends from the present configuration to the nearest within the joint limits, of
    w_p² |Δp|² + w_o² θ² [Levenberg 1944; Marquardt 1963], and goes no further in a call than the joints' velocity
    limits allow in a frame of 1/30 s. So joints neither jump nor swing to and fro where a target is out of reach, as
    they do by one Newton step a frame.

    Parameters
    ----------
    urdf_path
        As for `load_robot`: any robot of one chain.
    target_frame_name
        Link at its end; that of `load_robot` if omitted.
    joint_names
        The robot's joints in the order of the angles; the chain's if omitted.

    Raises
    ------
    ShapeError
        If ``joint_names`` are not those of the chain.

    Examples
    --------
    >>> import numpy as np
    >>> arm = RobotKinematics("panda")
    >>> q = np.array([0.0, -45.0, 0.0, -130.0, 0.0, 90.0, 45.0])
    >>> goal = arm.forward_kinematics(q + 2.0)
    >>> found = arm.inverse_kinematics(q, goal, orientation_weight=1.0)
    >>> bool(np.abs(arm.forward_kinematics(found) - goal).max() < 1e-6)
    True
    """

    def __init__(
        self,
        urdf_path: str,
        target_frame_name: str | None = None,
        joint_names: Sequence[str] | None = None,
    ) -> None:
        robot = load_robot(urdf_path, tip_link=target_frame_name)
        if not isinstance(robot, SerialArm):
            raise ShapeError(f"urdf_path: '{urdf_path}' is no arm of one chain")
        self.robot: SerialArm = robot
        self.joint_names: list[str] = list(joint_names or robot.joint_names)
        if sorted(self.joint_names) != sorted(robot.joint_names):
            raise ShapeError(
                f"joint_names: expected those of the chain, {', '.join(robot.joint_names)}; "
                f"got {', '.join(self.joint_names)}"
            )
        if any(kind != "revolute" for kind in robot.joint_types):
            raise ShapeError(f"urdf_path: {robot.name} has sliding joints, and angles here are in degrees")
        self._order = [self.joint_names.index(name) for name in robot.joint_names]
        self._most = robot.limits.velocity * _FRAME

    def forward_kinematics(self, joint_pos_deg: ArrayLike) -> Array:
        """Return the pose (4, 4) of the end effector in the base frame for angles in degrees; others do not count."""
        return algebra.matrix_from_pose(self.robot.fkm(self._radians(joint_pos_deg)))

    def inverse_kinematics(
        self,
        current_joint_pos: ArrayLike,
        desired_ee_pose: ArrayLike,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> Array:
        """Return the angles (degrees) for the next frame; what follows the joints (a gripper) stays as it is.

        Parameters
        ----------
        current_joint_pos
            Degrees.
        desired_ee_pose
            Shape (4, 4), base frame, m.
        position_weight, orientation_weight
            Of 1 m and 1 rad; an orientation weight of 0 leaves the orientation free.
        """
        if not position_weight > 0 or not orientation_weight >= 0:
            raise ValueRangeError(
                "position_weight, orientation_weight: must be > 0 and ≥ 0, "
                f"got {position_weight:g} and {orientation_weight:g}"
            )
        target = algebra.pose_from_matrix(as_array("desired_ee_pose", desired_ee_pose, (4, 4)))
        out = as_array("current_joint_pos", current_joint_pos, (None,)).copy()
        here = self._radians(out)
        step = descended(self.robot, target, here, orientation_weight / position_weight, _STEPS) - here
        step *= min(1.0, float(1.0 / np.max(np.abs(step) / self._most, initial=1.0)))
        out[self._order] = np.rad2deg(here + step)
        return out

    def _radians(self, degrees: ArrayLike) -> Array:
        values, count = as_array("joint_pos", degrees, (None,)), len(self.joint_names)
        if len(values) < count:
            raise ShapeError(f"joint_pos: expected {count} angles or more, got {len(values)}")
        return np.deg2rad(values[self._order])
