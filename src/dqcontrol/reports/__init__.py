"""Pages of runs, studies and parameter studies."""

from dqcontrol.reports.report import write_report
from dqcontrol.reports.rewritten import rewrite_reports

__all__ = [
    "rewrite_reports",
    "write_report",
]
