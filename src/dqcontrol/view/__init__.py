"""Figures and reports of runs. matplotlib is imported when the first figure is made."""

from dqcontrol.view.base_paths import base_path, superimposed
from dqcontrol.view.compared import compare_inputs, compare_joints, compare_poses
from dqcontrol.view.criteria import compare_criteria
from dqcontrol.view.disturbances import disturbance
from dqcontrol.view.figure_files import save_figures
from dqcontrol.view.histograms import histogram
from dqcontrol.view.lyapunov import lyapunov
from dqcontrol.view.paths import compare_paths, path_3d
from dqcontrol.view.plots import (
    compare_errors,
    control_signals,
    errors,
    joint_angles,
    pose_coefficients,
)
from dqcontrol.view.readings import limit_margins, readings
from dqcontrol.view.repeats import gain_figure, repeats_figure
from dqcontrol.view.report import write_report
from dqcontrol.view.save import comparison_figures, run_figures, save_comparison, save_plots
from dqcontrol.view.style import column_width
from dqcontrol.view.surfaces import surface, surface_figure
from dqcontrol.view.sweeps import sweep_figure
from dqcontrol.view.task_range import range_condition
from dqcontrol.view.timing import timing_histogram, timing_table

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
    "run_figures",
    "save_comparison",
    "save_figures",
    "save_plots",
    "superimposed",
    "surface",
    "surface_figure",
    "sweep_figure",
    "timing_histogram",
    "timing_table",
    "write_report",
]
