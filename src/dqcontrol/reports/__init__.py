"""Pages of runs, studies and parameter studies."""

from dqcontrol.reports.report import write_report

__all__ = [
    "write_report",
]
