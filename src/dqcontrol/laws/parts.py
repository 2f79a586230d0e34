"""Parts of compiled laws, for laws of other packages: errors, twists of end effectors, their solutions."""

from dqcontrol.laws.desired_twist import drive_table
from dqcontrol.laws.feedback_linearization import (
    linearization_parameters,
    linearization_state,
    linearization_work,
    motion_errors,
    solve_rates,
    twist_of_inputs,
)
from dqcontrol.laws.growth import pose_error
from dqcontrol.laws.hand_twist import solve_hand_twist, twist_at_end_effector, twist_work
from dqcontrol.laws.integral import integral_work, solve_with_integral
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.laws.linear_quadratic import moving_target
from dqcontrol.laws.pose_error import (
    hand_twist_of_rate,
    left_error,
    left_error_twist,
    short_sign,
    solve_left_error,
)
from dqcontrol.laws.pose_inverse import DAMPED_POSE, solve_pose_rows
from dqcontrol.laws.pose_law import pose_parameters
from dqcontrol.laws.riccati import at_times, riccati_slope

__all__ = [
    "DAMPED_POSE",
    "at_times",
    "drive_table",
    "hand_twist_of_rate",
    "integral_work",
    "inverse_parameters",
    "left_error",
    "left_error_twist",
    "linearization_parameters",
    "linearization_state",
    "linearization_work",
    "motion_errors",
    "moving_target",
    "pose_error",
    "pose_parameters",
    "riccati_slope",
    "short_sign",
    "solve_hand_twist",
    "solve_left_error",
    "solve_pose_rows",
    "solve_rates",
    "solve_with_integral",
    "twist_at_end_effector",
    "twist_of_inputs",
    "twist_work",
]
