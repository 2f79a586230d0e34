"""Experiments: specs, runs and studies."""

from collections.abc import Callable
from typing import Any

from dqcontrol.experiments.check import Checks, LoopCheck, check
from dqcontrol.experiments.load_results import load_rows, load_run, load_runs, load_study
from dqcontrol.experiments.ranking import Ranking, rank
from dqcontrol.experiments.real_time import run_in_real_time
from dqcontrol.experiments.run import Run, run
from dqcontrol.experiments.run_comparison import summary
from dqcontrol.experiments.run_study import run_study, run_study_to
from dqcontrol.experiments.run_sweep import run_sweep_to
from dqcontrol.experiments.spec import Spec, read_spec
from dqcontrol.experiments.study import Study
from dqcontrol.moved import names_moved_from

__all__ = [
    "Checks",
    "LoopCheck",
    "Ranking",
    "Run",
    "Spec",
    "Study",
    "check",
    "load_rows",
    "load_run",
    "load_runs",
    "load_study",
    "rank",
    "read_spec",
    "run",
    "run_in_real_time",
    "run_study",
    "run_study_to",
    "run_sweep_to",
    "summary",
]

__getattr__: Callable[[str], Any] = names_moved_from(__name__)
