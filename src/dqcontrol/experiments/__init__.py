"""Experiments: specs, runs, studies, metrics and tables."""

from dqcontrol.experiments.evaluation import evaluate_log
from dqcontrol.experiments.joint_log import JointLog, read_joint_log
from dqcontrol.experiments.metric_tables import comparison_table, repeats_table, summary_table
from dqcontrol.experiments.metrics import Metrics, evaluate
from dqcontrol.experiments.run import Run, run
from dqcontrol.experiments.spec import Spec, read_spec
from dqcontrol.experiments.study import Study, load_run, load_runs, run_study, summary
from dqcontrol.experiments.tables import Column, Table

__all__ = [
    "Column",
    "JointLog",
    "Metrics",
    "Run",
    "Spec",
    "Study",
    "Table",
    "comparison_table",
    "evaluate",
    "evaluate_log",
    "load_run",
    "load_runs",
    "read_joint_log",
    "read_spec",
    "repeats_table",
    "run",
    "run_study",
    "summary",
    "summary_table",
]
