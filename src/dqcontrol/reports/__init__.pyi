from .provenance import origins as origins
from .report import write_report as write_report
from .rewritten import rewrite_reports as rewrite_reports
