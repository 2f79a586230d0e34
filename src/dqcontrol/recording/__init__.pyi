from .export import export_record as export_record
from .mcap import (
    load_metadata as load_metadata,
    load_record as load_record,
    save_black_box as save_black_box,
    save_record as save_record,
)
from .stream import RecordStream as RecordStream
