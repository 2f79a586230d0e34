"""Experiments: specs, runs, studies, metrics and tables."""

from dqcontrol.experiments.evaluation import evaluate_log
from dqcontrol.experiments.joint_log import JointLog, read_joint_log
from dqcontrol.experiments.metric_tables import comparison_table, summary_table
from dqcontrol.experiments.metrics import Metrics, evaluate
from dqcontrol.experiments.repeat_tables import differences_table, means_table, repeatability_table
from dqcontrol.experiments.run import Run, run
from dqcontrol.experiments.spec import Spec, read_spec
from dqcontrol.experiments.study import Study, load_run, load_runs, run_study, summary
from dqcontrol.experiments.tables import Column, PlusMinus, Table

__all__ = [
    "Column",
    "JointLog",
    "Metrics",
    "PlusMinus",
    "Run",
    "Spec",
    "Study",
    "Table",
    "comparison_table",
    "differences_table",
    "evaluate",
    "evaluate_log",
    "load_run",
    "load_runs",
    "means_table",
    "read_joint_log",
    "read_spec",
    "repeatability_table",
    "run",
    "run_study",
    "summary",
    "summary_table",
]
