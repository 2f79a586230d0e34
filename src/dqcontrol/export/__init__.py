"""Controllers as libraries in C: a prepared law, its supervisor and its reference for a robot's own computer."""

from dqcontrol.export.compiled_run import run_compiled_in_real_time
from dqcontrol.export.controller_folder import ExportSummary, export_controller

__all__ = ["ExportSummary", "export_controller", "run_compiled_in_real_time"]
