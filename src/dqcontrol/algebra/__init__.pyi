from .batch import as_unit as as_unit
from .conversions import (
    as_unit_quaternion as as_unit_quaternion,
)
from .conversions import (
    axis_angle_from_rotation as axis_angle_from_rotation,
)
from .conversions import (
    matrix_from_pose as matrix_from_pose,
)
from .conversions import (
    matrix_from_rotation as matrix_from_rotation,
)
from .conversions import (
    pose as pose,
)
from .conversions import (
    pose_from_matrix as pose_from_matrix,
)
from .conversions import (
    rotation_from_axis_angle as rotation_from_axis_angle,
)
from .conversions import (
    rotation_from_matrix as rotation_from_matrix,
)
from .conversions import (
    rotation_from_rpy as rotation_from_rpy,
)
from .conversions import (
    rotation_from_zyz as rotation_from_zyz,
)
from .conversions import (
    rpy_from_rotation as rpy_from_rotation,
)
from .conversions import (
    zyz_from_rotation as zyz_from_rotation,
)
from .dual_quaternion import DualQuaternion as DualQuaternion
from .exponential import (
    exp_body as exp_body,
)
from .exponential import (
    exp_inertial as exp_inertial,
)
from .exponential import (
    exp_screw as exp_screw,
)
from .exponential import (
    log_body as log_body,
)
from .exponential import (
    log_inertial as log_inertial,
)
from .exponential import (
    log_screw as log_screw,
)
from .exponential import (
    power as power,
)
from .exponential import (
    sclerp as sclerp,
)
from .functions import (
    C4 as C4,
)
from .functions import (
    C8 as C8,
)
from .functions import (
    adjoint as adjoint,
)
from .functions import (
    adjoint_matrix as adjoint_matrix,
)
from .functions import (
    adjoint_twist as adjoint_twist,
)
from .functions import (
    body_translation as body_translation,
)
from .functions import (
    conjugate as conjugate,
)
from .functions import (
    cross as cross,
)
from .functions import (
    cross_twist as cross_twist,
)
from .functions import (
    dot as dot,
)
from .functions import (
    hamilton_minus as hamilton_minus,
)
from .functions import (
    hamilton_plus as hamilton_plus,
)
from .functions import (
    inverse as inverse,
)
from .functions import (
    multiply as multiply,
)
from .functions import (
    norm as norm,
)
from .functions import (
    renormalise as renormalise,
)
from .functions import (
    rotation as rotation,
)
from .functions import (
    short as short,
)
from .functions import (
    translation as translation,
)
from .functions import (
    unvec as unvec,
)
from .functions import (
    vec3 as vec3,
)
from .functions import (
    vec4 as vec4,
)
from .functions import (
    vec6 as vec6,
)
from .functions import (
    vec8 as vec8,
)
from .interchange import (
    dqrobotics_from_pose as dqrobotics_from_pose,
)
from .interchange import (
    mujoco_from_pose as mujoco_from_pose,
)
from .interchange import (
    pose_from_dqrobotics as pose_from_dqrobotics,
)
from .interchange import (
    pose_from_mujoco as pose_from_mujoco,
)
from .interchange import (
    pose_from_se3 as pose_from_se3,
)
from .interchange import (
    rotation_from_scipy as rotation_from_scipy,
)
from .interchange import (
    scipy_from_rotation as scipy_from_rotation,
)
from .interchange import (
    se3_from_pose as se3_from_pose,
)
