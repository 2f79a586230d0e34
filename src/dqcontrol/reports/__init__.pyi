from .about import origins as origins
from .redrawn import rewrite_reports as rewrite_reports
from .report import write_report as write_report
