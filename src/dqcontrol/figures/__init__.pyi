from .comparisons import (
    compare_criteria as compare_criteria,
    compare_errors as compare_errors,
    compare_inputs as compare_inputs,
    compare_joints as compare_joints,
    compare_poses as compare_poses,
    criteria_side_by_side as criteria_side_by_side,
)
from .distributions import (
    histogram as histogram,
    parity as parity,
    timing_histogram as timing_histogram,
    timing_table as timing_table,
)
from .paths import (
    compare_paths as compare_paths,
    path_3d as path_3d,
)
from .plots import (
    control_signals as control_signals,
    disturbance as disturbance,
    errors as errors,
    joint_angles as joint_angles,
    limit_margins as limit_margins,
    lyapunov as lyapunov,
    pose_coefficients as pose_coefficients,
    range_condition as range_condition,
    readings as readings,
    task_errors as task_errors,
)
from .robots import (
    base_path as base_path,
    robot_picture as robot_picture,
    superimposed as superimposed,
)
from .save import (
    comparison_figures as comparison_figures,
    run_figures as run_figures,
    save_figures as save_figures,
)
from .studies import (
    gain_figure as gain_figure,
    repeats_figure as repeats_figure,
    search_figure as search_figure,
    surface as surface,
    surface_figure as surface_figure,
    sweep_figure as sweep_figure,
)
from .style import (
    COLOURS as COLOURS,
    DESIRED as DESIRED,
    column_width as column_width,
    new_figure as new_figure,
)
