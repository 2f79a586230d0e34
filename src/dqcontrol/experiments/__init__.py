"""Experiments: specs, runs, studies, metrics and tables."""

from dqcontrol.experiments.attenuation import (
    Attenuation,
    Gammas,
    PremiseError,
    attenuation,
    attenuation_table,
)
from dqcontrol.experiments.attenuation_cases import verify_attenuation
from dqcontrol.experiments.check import Checks, LoopCheck, check
from dqcontrol.experiments.comparison import summary
from dqcontrol.experiments.conduct import run_study, run_study_to
from dqcontrol.experiments.conduct_sweep import run_sweep_to
from dqcontrol.experiments.evaluation import evaluate_log
from dqcontrol.experiments.joint_log import JointLog, read_joint_log
from dqcontrol.experiments.lyapunov import Certificate, certificate
from dqcontrol.experiments.metric_tables import comparison_table, summary_table
from dqcontrol.experiments.metrics import Metrics, evaluate
from dqcontrol.experiments.ranking import Ranking, rank
from dqcontrol.experiments.real_time import run_in_real_time
from dqcontrol.experiments.repeat_tables import (
    confidence_table,
    differences_table,
    means_table,
    repeatability_table,
)
from dqcontrol.experiments.run import Run, run
from dqcontrol.experiments.saved import load_rows, load_run, load_runs, load_study
from dqcontrol.experiments.spec import Spec, read_spec
from dqcontrol.experiments.study import Study
from dqcontrol.experiments.tables import Column, PlusMinus, Table
from dqcontrol.experiments.task_range import TaskRange, task_range

__all__ = [
    "Attenuation",
    "Certificate",
    "Checks",
    "Column",
    "Gammas",
    "JointLog",
    "LoopCheck",
    "Metrics",
    "PlusMinus",
    "PremiseError",
    "Ranking",
    "Run",
    "Spec",
    "Study",
    "Table",
    "TaskRange",
    "attenuation",
    "attenuation_table",
    "certificate",
    "check",
    "comparison_table",
    "confidence_table",
    "differences_table",
    "evaluate",
    "evaluate_log",
    "load_rows",
    "load_run",
    "load_runs",
    "load_study",
    "means_table",
    "rank",
    "read_joint_log",
    "read_spec",
    "repeatability_table",
    "run",
    "run_in_real_time",
    "run_study",
    "run_study_to",
    "run_sweep_to",
    "summary",
    "summary_table",
    "task_range",
    "verify_attenuation",
]
