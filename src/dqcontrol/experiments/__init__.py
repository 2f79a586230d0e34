"""Experiments: specs, runs, studies, metrics and tables."""

from dqcontrol.experiments.metrics import Metrics, evaluate
from dqcontrol.experiments.run import Run, run
from dqcontrol.experiments.spec import Spec, read_spec
from dqcontrol.experiments.study import Study, load_run, load_runs, run_study
from dqcontrol.experiments.summary import summary
from dqcontrol.experiments.tables import Column, Table

__all__ = [
    "Column",
    "Metrics",
    "Run",
    "Spec",
    "Study",
    "Table",
    "evaluate",
    "load_run",
    "load_runs",
    "read_spec",
    "run",
    "run_study",
    "summary",
]
