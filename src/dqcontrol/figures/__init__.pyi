from .base_paths import (
    base_path as base_path,
    superimposed as superimposed,
)
from .compared import (
    compare_inputs as compare_inputs,
    compare_joints as compare_joints,
    compare_poses as compare_poses,
)
from .criteria import (
    compare_criteria as compare_criteria,
    criteria_side_by_side as criteria_side_by_side,
)
from .disturbances import disturbance as disturbance
from .figure_files import save_figures as save_figures
from .histograms import histogram as histogram
from .lyapunov_plot import lyapunov as lyapunov
from .parity_plot import parity as parity
from .paths import (
    compare_paths as compare_paths,
    path_3d as path_3d,
)
from .plots import (
    compare_errors as compare_errors,
    control_signals as control_signals,
    errors as errors,
    joint_angles as joint_angles,
    pose_coefficients as pose_coefficients,
)
from .readings import (
    limit_margins as limit_margins,
    readings as readings,
)
from .repeats_plot import (
    gain_figure as gain_figure,
    repeats_figure as repeats_figure,
)
from .robot_picture import robot_picture as robot_picture
from .save import (
    comparison_figures as comparison_figures,
    run_figures as run_figures,
    save_comparison as save_comparison,
    save_plots as save_plots,
)
from .style import (
    COLOURS as COLOURS,
    DESIRED as DESIRED,
    column_width as column_width,
    new_figure as new_figure,
)
from .surfaces import (
    surface as surface,
    surface_figure as surface_figure,
)
from .sweeps import sweep_figure as sweep_figure
from .task_range_plot import range_condition as range_condition
from .tasks import task_errors as task_errors
from .timing_plot import (
    timing_histogram as timing_histogram,
    timing_table as timing_table,
)
from .tuning_plots import search_figure as search_figure
