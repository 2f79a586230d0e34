from .compiled_run import run_compiled_in_real_time as run_compiled_in_real_time
from .controller_folder import (
    ExportSummary as ExportSummary,
    export_controller as export_controller,
)
