from .bases import (
    CarLikeBase as CarLikeBase,
    Chassis as Chassis,
    DifferentialDrive as DifferentialDrive,
    HolonomicBase as HolonomicBase,
    MecanumBase as MecanumBase,
    OmniBase as OmniBase,
    SteeredTricycle as SteeredTricycle,
)
from .chain_robot import Kinematics as Kinematics
from .files import robot_names as robot_names
from .files.description import (
    Description as Description,
    JointRow as JointRow,
    describe as describe,
)
from .files.load import load_robot as load_robot
from .files.robot_file import (
    RobotFile as RobotFile,
    load_robot_file as load_robot_file,
)
from .files.tree_file import TreeFile as TreeFile, TwoArmsFile as TwoArmsFile
from .files.urdf import load_urdf as load_urdf
from .files.whole_body_file import WholeBodyFile as WholeBodyFile
from .inverse.inverse_kinematics import Solution as Solution
from .inverse.robot_kinematics import (
    NearestPose as NearestPose,
    ReachingPosture as ReachingPosture,
    RobotKinematics as RobotKinematics,
    most_dexterous as most_dexterous,
    nearest_pose as nearest_pose,
    postures as postures,
)
from .limits import (
    Inertia as Inertia,
    Limits as Limits,
    symmetric_limits as symmetric_limits,
)
from .link_shapes import (
    LinkShape as LinkShape,
    LinkShapes as LinkShapes,
)
from .robot import Robot as Robot
from .serial_arm import SerialArm as SerialArm
from .tree_robot import (
    NamedFrame as NamedFrame,
    PoseTask as PoseTask,
    TreeJoints as TreeJoints,
    TreeRobot as TreeRobot,
    chain_as_tree as chain_as_tree,
)
from .two_arms import TwoArms as TwoArms
from .whole_body import WholeBody as WholeBody
