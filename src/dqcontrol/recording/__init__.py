"""Runs as files: MCAP recordings, written whole or while the robot moves, and exports for other programs."""

from dqcontrol.recording.black_box_folder import save_black_box
from dqcontrol.recording.export import export_record
from dqcontrol.recording.mcap import load_metadata, load_record, save_record
from dqcontrol.recording.stream import RecordStream

__all__ = [
    "RecordStream",
    "export_record",
    "load_metadata",
    "load_record",
    "save_black_box",
    "save_record",
]
