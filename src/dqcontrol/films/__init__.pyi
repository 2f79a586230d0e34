from .clip import (
    render_clip as render_clip,
)
from .clip import (
    render_strip as render_strip,
)
from .clip import (
    render_whole as render_whole,
)
from .light_painting import (
    light_painting as light_painting,
)
from .light_painting import (
    light_paintings as light_paintings,
)
from .light_painting import (
    painting_clip as painting_clip,
)
from .physics_picture import render_run as render_run
