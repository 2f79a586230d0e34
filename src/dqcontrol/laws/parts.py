"""Parts of compiled laws, for laws of other packages: errors, twists of end effectors, their solutions."""

from dqcontrol.laws.desired_twist import drive_table as drive_table
from dqcontrol.laws.feedback_linearization import (
    linearization_parameters as linearization_parameters,
    linearization_state as linearization_state,
    linearization_work as linearization_work,
    motion_errors as motion_errors,
    solve_rates as solve_rates,
    twist_of_inputs as twist_of_inputs,
)
from dqcontrol.laws.growth import pose_error as pose_error
from dqcontrol.laws.hand_twist import (
    solve_hand_twist as solve_hand_twist,
    twist_at_end_effector as twist_at_end_effector,
    twist_work as twist_work,
)
from dqcontrol.laws.integral import integral_work as integral_work, solve_with_integral as solve_with_integral
from dqcontrol.laws.inverses import inverse_parameters as inverse_parameters
from dqcontrol.laws.linear_quadratic import moving_target as moving_target
from dqcontrol.laws.pose_error import (
    hand_twist_of_rate as hand_twist_of_rate,
    left_error as left_error,
    left_error_twist as left_error_twist,
    short_sign as short_sign,
    solve_left_error as solve_left_error,
)
from dqcontrol.laws.pose_inverse import DAMPED_POSE as DAMPED_POSE, solve_pose_rows as solve_pose_rows
from dqcontrol.laws.pose_law import pose_parameters as pose_parameters
from dqcontrol.laws.riccati import at_times as at_times, riccati_slope as riccati_slope
