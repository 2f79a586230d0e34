"""Robots: chains, their Jacobians, and where they come from."""

from collections.abc import Callable
from typing import Any

from dqcontrol.moved import names_moved_from
from dqcontrol.robots.bases import Chassis, DifferentialDrive, HolonomicBase
from dqcontrol.robots.description import Description, JointRow, describe
from dqcontrol.robots.inverse_kinematics import Solution
from dqcontrol.robots.joined_chains import chain_as_tree
from dqcontrol.robots.limits import Inertia, Limits, symmetric_limits
from dqcontrol.robots.link_shapes import LinkShape, LinkShapes
from dqcontrol.robots.load import load_mobile, load_robot, load_tree, robot_names
from dqcontrol.robots.nearest_pose import NearestPose, nearest_pose
from dqcontrol.robots.postures import ReachingPosture, postures
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.robot_file import RobotFile, load_robot_file
from dqcontrol.robots.roller_bases import MecanumBase, OmniBase
from dqcontrol.robots.serial_arm import Kinematics, SerialArm
from dqcontrol.robots.steered_bases import CarLikeBase, SteeredTricycle
from dqcontrol.robots.tree_file import TreeFile
from dqcontrol.robots.tree_robot import NamedFrame, PoseTask, TreeJoints, TreeRobot
from dqcontrol.robots.two_arms import TwoArms
from dqcontrol.robots.two_arms_file import TwoArmsFile
from dqcontrol.robots.urdf import load_urdf
from dqcontrol.robots.whole_body import WholeBody
from dqcontrol.robots.whole_body_file import WholeBodyFile

__all__ = [
    "CarLikeBase",
    "Chassis",
    "Description",
    "DifferentialDrive",
    "HolonomicBase",
    "Inertia",
    "JointRow",
    "Kinematics",
    "Limits",
    "LinkShape",
    "LinkShapes",
    "MecanumBase",
    "NamedFrame",
    "NearestPose",
    "OmniBase",
    "PoseTask",
    "ReachingPosture",
    "Robot",
    "RobotFile",
    "SerialArm",
    "Solution",
    "SteeredTricycle",
    "TreeFile",
    "TreeJoints",
    "TreeRobot",
    "TwoArms",
    "TwoArmsFile",
    "WholeBody",
    "WholeBodyFile",
    "chain_as_tree",
    "describe",
    "load_mobile",
    "load_robot",
    "load_robot_file",
    "load_tree",
    "load_urdf",
    "nearest_pose",
    "postures",
    "robot_names",
    "symmetric_limits",
]

__getattr__: Callable[[str], Any] = names_moved_from(__name__)
