"""Pictures of physics: clips, single pictures, light painting."""

from dqcontrol.films.clip import render_clip, render_strip, render_whole
from dqcontrol.films.light_painting import light_painting, light_paintings, painting_clip
from dqcontrol.films.physics_picture import render_run

__all__ = [
    "light_painting",
    "light_paintings",
    "painting_clip",
    "render_clip",
    "render_run",
    "render_strip",
    "render_whole",
]
