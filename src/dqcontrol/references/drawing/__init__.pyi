from .drawing import Drawing as Drawing
from .drawing_file import (
    DrawingFile as DrawingFile,
    load_drawing as load_drawing,
    parse_drawing as parse_drawing,
)
