from .check import (
    Checks as Checks,
    LoopCheck as LoopCheck,
    check as check,
)
from .load_results import (
    load_rows as load_rows,
    load_run as load_run,
    load_runs as load_runs,
    load_study as load_study,
)
from .prepared_experiment import (
    Combination as Combination,
    PreparedExperiment as PreparedExperiment,
    PreparedRobot as PreparedRobot,
    prepare as prepare,
)
from .ranking import (
    Ranking as Ranking,
    rank as rank,
)
from .real_time import run_in_real_time as run_in_real_time
from .results_folder import (
    SPEC_FILE as SPEC_FILE,
    check_new as check_new,
    new_folder as new_folder,
    working_folder as working_folder,
)
from .run import (
    Run as Run,
    execute as execute,
    measure as measure,
    run as run,
)
from .run_comparison import (
    summary as summary,
    write_table as write_table,
)
from .spec import (
    Spec as Spec,
    read_spec as read_spec,
)
from .spec.world_file import load_world as load_world
from .study import (
    Study as Study,
    run_study as run_study,
    run_study_to as run_study_to,
    work_through as work_through,
)
from .sweep import run_sweep_to as run_sweep_to
