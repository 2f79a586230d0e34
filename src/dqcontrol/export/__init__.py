"""Controllers as libraries in C: a prepared law, its supervisor and its reference for a robot's own computer."""

from dqcontrol.export.controller_folder import ExportSummary, export_controller

__all__ = ["ExportSummary", "export_controller"]
