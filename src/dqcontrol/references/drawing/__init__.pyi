from .drawing import (
    Drawing as Drawing,
    DrawingFile as DrawingFile,
    load_drawing as load_drawing,
    parse_drawing as parse_drawing,
)
