from .drawing import Drawing as Drawing
from .drawing_file import (
    DrawingFile as DrawingFile,
)
from .drawing_file import (
    load_drawing as load_drawing,
)
from .drawing_file import (
    parse_drawing as parse_drawing,
)
