"""Robots: chains, their Jacobians, and where they come from."""

from dqcontrol.moved import names_moved_from
from dqcontrol.robots.bases import Chassis, DifferentialDrive, HolonomicBase
from dqcontrol.robots.description import Description, JointRow, describe
from dqcontrol.robots.inverse_kinematics import Solution
from dqcontrol.robots.joined_chains import chain_as_tree
from dqcontrol.robots.limits import Inertia, Limits, symmetric_limits
from dqcontrol.robots.link_shapes import LinkShape, LinkShapes
from dqcontrol.robots.load import load_robot, load_tree, robot_names
from dqcontrol.robots.postures import ReachingPosture, postures
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.robot_file import RobotFile, load_robot_file
from dqcontrol.robots.serial_arm import Kinematics, SerialArm
from dqcontrol.robots.tree_file import TreeFile
from dqcontrol.robots.tree_robot import NamedFrame, PoseTask, TreeJoints, TreeRobot
from dqcontrol.robots.two_arms import TwoArms
from dqcontrol.robots.two_arms_file import TwoArmsFile
from dqcontrol.robots.urdf import load_urdf
from dqcontrol.robots.whole_body import WholeBody
from dqcontrol.robots.whole_body_file import WholeBodyFile

__all__ = [
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
    "NamedFrame",
    "PoseTask",
    "ReachingPosture",
    "Robot",
    "RobotFile",
    "SerialArm",
    "Solution",
    "TreeFile",
    "TreeJoints",
    "TreeRobot",
    "TwoArms",
    "TwoArmsFile",
    "WholeBody",
    "WholeBodyFile",
    "chain_as_tree",
    "describe",
    "load_robot",
    "load_robot_file",
    "load_tree",
    "load_urdf",
    "postures",
    "robot_names",
    "symmetric_limits",
]

__getattr__ = names_moved_from(__name__)
