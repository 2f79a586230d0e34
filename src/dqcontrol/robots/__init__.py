"""Robots: chains, their Jacobians, and where they come from."""

from dqcontrol.robots.inverse_kinematics import Solution
from dqcontrol.robots.limits import Inertia, Limits, symmetric_limits
from dqcontrol.robots.load import Description, JointRow, describe, load_robot, robot_names
from dqcontrol.robots.robot_file import RobotFile, load_robot_file
from dqcontrol.robots.serial_arm import Kinematics, SerialArm
from dqcontrol.robots.urdf import load_urdf

__all__ = [
    "Description",
    "Inertia",
    "JointRow",
    "Kinematics",
    "Limits",
    "RobotFile",
    "SerialArm",
    "Solution",
    "describe",
    "load_robot",
    "load_robot_file",
    "load_urdf",
    "robot_names",
    "symmetric_limits",
]
