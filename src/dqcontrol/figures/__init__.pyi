from .base_paths import (
    base_path as base_path,
)
from .base_paths import (
    superimposed as superimposed,
)
from .compared import (
    compare_inputs as compare_inputs,
)
from .compared import (
    compare_joints as compare_joints,
)
from .compared import (
    compare_poses as compare_poses,
)
from .criteria import (
    compare_criteria as compare_criteria,
)
from .criteria import (
    criteria_side_by_side as criteria_side_by_side,
)
from .disturbances import disturbance as disturbance
from .figure_files import save_figures as save_figures
from .histograms import histogram as histogram
from .lyapunov_plot import lyapunov as lyapunov
from .paths import (
    compare_paths as compare_paths,
)
from .paths import (
    path_3d as path_3d,
)
from .plots import (
    compare_errors as compare_errors,
)
from .plots import (
    control_signals as control_signals,
)
from .plots import (
    errors as errors,
)
from .plots import (
    joint_angles as joint_angles,
)
from .plots import (
    pose_coefficients as pose_coefficients,
)
from .readings import (
    limit_margins as limit_margins,
)
from .readings import (
    readings as readings,
)
from .repeats_plot import (
    gain_figure as gain_figure,
)
from .repeats_plot import (
    repeats_figure as repeats_figure,
)
from .robot_picture import robot_picture as robot_picture
from .save import (
    comparison_figures as comparison_figures,
)
from .save import (
    run_figures as run_figures,
)
from .save import (
    save_comparison as save_comparison,
)
from .save import (
    save_plots as save_plots,
)
from .style import column_width as column_width
from .surfaces import (
    surface as surface,
)
from .surfaces import (
    surface_figure as surface_figure,
)
from .sweeps import sweep_figure as sweep_figure
from .task_range_plot import range_condition as range_condition
from .tasks import task_errors as task_errors
from .timing_plot import (
    timing_histogram as timing_histogram,
)
from .timing_plot import (
    timing_table as timing_table,
)
