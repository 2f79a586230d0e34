"""Figures of runs. matplotlib is imported when the first one is made."""

from dqcontrol.figures.base_paths import base_path, superimposed
from dqcontrol.figures.compared import compare_inputs, compare_joints, compare_poses
from dqcontrol.figures.criteria import compare_criteria, criteria_side_by_side
from dqcontrol.figures.disturbances import disturbance
from dqcontrol.figures.figure_files import save_figures
from dqcontrol.figures.histograms import histogram
from dqcontrol.figures.lyapunov_plot import lyapunov
from dqcontrol.figures.paths import compare_paths, path_3d
from dqcontrol.figures.plots import compare_errors, control_signals, errors, joint_angles, pose_coefficients
from dqcontrol.figures.readings import limit_margins, readings
from dqcontrol.figures.repeats_plot import gain_figure, repeats_figure
from dqcontrol.figures.robot_picture import robot_picture
from dqcontrol.figures.save import comparison_figures, run_figures, save_comparison, save_plots
from dqcontrol.figures.style import column_width
from dqcontrol.figures.surfaces import surface, surface_figure
from dqcontrol.figures.sweeps import sweep_figure
from dqcontrol.figures.task_range_plot import range_condition
from dqcontrol.figures.tasks import task_errors
from dqcontrol.figures.timing_plot import timing_histogram, timing_table

__all__ = [
    "base_path",
    "column_width",
    "compare_criteria",
    "compare_errors",
    "compare_inputs",
    "compare_joints",
    "compare_paths",
    "compare_poses",
    "comparison_figures",
    "control_signals",
    "criteria_side_by_side",
    "disturbance",
    "errors",
    "gain_figure",
    "histogram",
    "joint_angles",
    "limit_margins",
    "lyapunov",
    "path_3d",
    "pose_coefficients",
    "range_condition",
    "readings",
    "repeats_figure",
    "robot_picture",
    "run_figures",
    "save_comparison",
    "save_figures",
    "save_plots",
    "superimposed",
    "surface",
    "surface_figure",
    "sweep_figure",
    "task_errors",
    "timing_histogram",
    "timing_table",
]
