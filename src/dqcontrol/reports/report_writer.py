"""Reports that experiments ask for while they save results; see `dqcontrol.experiments.result_pages.ResultPages`."""

from __future__ import annotations

import io

from dqcontrol.figures.paths import path_3d
from dqcontrol.loop.record import Record
from dqcontrol.reports.run_report import write_run_report as write_run
from dqcontrol.reports.study_reports import (
    write_learning_report as write_learning,
    write_study_report as write_study,
    write_sweep_report as write_sweep,
    write_tuning_report as write_tuning,
)

__all__ = ["path_picture", "write_learning", "write_run", "write_study", "write_sweep", "write_tuning"]


def path_picture(record: Record) -> bytes:
    """Return the path of the end effector as a PNG file."""
    picture = io.BytesIO()
    path_3d(record).savefig(picture, format="png", dpi=100)
    return picture.getvalue()
