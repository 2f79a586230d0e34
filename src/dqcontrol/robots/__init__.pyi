from .bases import (
    Chassis as Chassis,
)
from .bases import (
    DifferentialDrive as DifferentialDrive,
)
from .bases import (
    HolonomicBase as HolonomicBase,
)
from .description import (
    Description as Description,
)
from .description import (
    JointRow as JointRow,
)
from .description import (
    describe as describe,
)
from .inverse_kinematics import Solution as Solution
from .joined_chains import chain_as_tree as chain_as_tree
from .limits import (
    Inertia as Inertia,
)
from .limits import (
    Limits as Limits,
)
from .limits import (
    symmetric_limits as symmetric_limits,
)
from .link_shapes import (
    LinkShape as LinkShape,
)
from .link_shapes import (
    LinkShapes as LinkShapes,
)
from .load import (
    load_mobile as load_mobile,
)
from .load import (
    load_robot as load_robot,
)
from .load import (
    load_tree as load_tree,
)
from .load import (
    robot_names as robot_names,
)
from .nearest_pose import (
    NearestPose as NearestPose,
)
from .nearest_pose import (
    nearest_pose as nearest_pose,
)
from .postures import (
    ReachingPosture as ReachingPosture,
)
from .postures import (
    postures as postures,
)
from .robot import Robot as Robot
from .robot_file import (
    RobotFile as RobotFile,
)
from .robot_file import (
    load_robot_file as load_robot_file,
)
from .roller_bases import (
    MecanumBase as MecanumBase,
)
from .roller_bases import (
    OmniBase as OmniBase,
)
from .serial_arm import (
    Kinematics as Kinematics,
)
from .serial_arm import (
    SerialArm as SerialArm,
)
from .steered_bases import (
    CarLikeBase as CarLikeBase,
)
from .steered_bases import (
    SteeredTricycle as SteeredTricycle,
)
from .tree_file import TreeFile as TreeFile
from .tree_robot import (
    NamedFrame as NamedFrame,
)
from .tree_robot import (
    PoseTask as PoseTask,
)
from .tree_robot import (
    TreeJoints as TreeJoints,
)
from .tree_robot import (
    TreeRobot as TreeRobot,
)
from .two_arms import TwoArms as TwoArms
from .two_arms_file import TwoArmsFile as TwoArmsFile
from .urdf import load_urdf as load_urdf
from .whole_body import WholeBody as WholeBody
from .whole_body_file import WholeBodyFile as WholeBodyFile
