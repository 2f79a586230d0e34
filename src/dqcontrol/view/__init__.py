"""Figures and reports of runs. matplotlib is imported when the first figure is made."""

from dqcontrol.view.disturbances import disturbance
from dqcontrol.view.paths import compare_paths, path_3d
from dqcontrol.view.plots import (
    compare_errors,
    control_signals,
    errors,
    joint_angles,
    pose_coefficients,
    save_comparison,
    save_plots,
)
from dqcontrol.view.report import write_report

__all__ = [
    "compare_errors",
    "compare_paths",
    "control_signals",
    "disturbance",
    "errors",
    "joint_angles",
    "path_3d",
    "pose_coefficients",
    "save_comparison",
    "save_plots",
    "write_report",
]
