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
from .ranking import (
    Ranking as Ranking,
    rank as rank,
)
from .real_time import run_in_real_time as run_in_real_time
from .run import (
    Run as Run,
    run as run,
)
from .run_comparison import summary as summary
from .run_study import (
    run_study as run_study,
    run_study_to as run_study_to,
)
from .run_sweep import run_sweep_to as run_sweep_to
from .spec import (
    Spec as Spec,
    read_spec as read_spec,
)
from .study import Study as Study
