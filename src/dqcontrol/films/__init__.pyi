from .clip import (
    render_clip as render_clip,
    render_strip as render_strip,
    render_whole as render_whole,
)
from .drawn_scene import offscreen as offscreen
from .light_painting import (
    light_painting as light_painting,
    light_paintings as light_paintings,
    painting_clip as painting_clip,
)
from .physics_picture import render_run as render_run
