from .bases import (
    Chassis as Chassis,
    DifferentialDrive as DifferentialDrive,
    HolonomicBase as HolonomicBase,
)
from .files.description import (
    Description as Description,
    JointRow as JointRow,
    describe as describe,
)
from .files.load import (
    load_mobile as load_mobile,
    load_robot as load_robot,
    load_tree as load_tree,
    robot_names as robot_names,
)
from .files.robot_file import (
    RobotFile as RobotFile,
    load_robot_file as load_robot_file,
)
from .files.tree_file import TreeFile as TreeFile
from .files.two_arms_file import TwoArmsFile as TwoArmsFile
from .files.urdf import load_urdf as load_urdf
from .files.whole_body_file import WholeBodyFile as WholeBodyFile
from .inverse.dexterity import most_dexterous as most_dexterous
from .inverse.inverse_kinematics import Solution as Solution
from .inverse.nearest_pose import (
    NearestPose as NearestPose,
    nearest_pose as nearest_pose,
)
from .inverse.postures import (
    ReachingPosture as ReachingPosture,
    postures as postures,
)
from .inverse.robot_kinematics import RobotKinematics as RobotKinematics
from .kinematics.joined_chains import chain_as_tree as chain_as_tree
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
from .roller_bases import (
    MecanumBase as MecanumBase,
    OmniBase as OmniBase,
)
from .serial_arm import (
    Kinematics as Kinematics,
    SerialArm as SerialArm,
)
from .steered_bases import (
    CarLikeBase as CarLikeBase,
    SteeredTricycle as SteeredTricycle,
)
from .tree_robot import (
    NamedFrame as NamedFrame,
    PoseTask as PoseTask,
    TreeJoints as TreeJoints,
    TreeRobot as TreeRobot,
)
from .two_arms import TwoArms as TwoArms
from .whole_body import WholeBody as WholeBody
