"""The closed loop, compiled and interpreted, and what it records."""

from dqcontrol.loop.clock import Clock, Timing
from dqcontrol.loop.closed_loop import close_loop
from dqcontrol.loop.export import export_record
from dqcontrol.loop.mcap import load_metadata, load_record, save_record
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.simulate import simulate
from dqcontrol.loop.stream import RecordStream
from dqcontrol.loop.supervision import Supervision
from dqcontrol.loop.trace import Stop, Trace

__all__ = [
    "Clock",
    "Record",
    "RecordStream",
    "Signal",
    "Stop",
    "Supervision",
    "Timing",
    "Trace",
    "close_loop",
    "export_record",
    "load_metadata",
    "load_record",
    "save_record",
    "simulate",
]
