"""[P16]: M. S. Pereira, six laws on the right arm of a Meka A2."""

from dqcontrol.reproductions.pereira2016.pereira2016_catalogue import EXPERIMENTS, PLANTS
from dqcontrol.reproductions.pereira2016.published_numbers import (
    REPRODUCTIONS,
    Disagreement,
    PublishedRun,
    claims,
    disagreements,
    published_cells,
    published_runs,
)
from dqcontrol.reproductions.pereira2016.published_specs import published_spec
from dqcontrol.reproductions.pereira2016.reproduce_pereira2016 import reproduce

__all__ = [
    "EXPERIMENTS",
    "PLANTS",
    "REPRODUCTIONS",
    "Disagreement",
    "PublishedRun",
    "claims",
    "disagreements",
    "published_cells",
    "published_runs",
    "published_spec",
    "reproduce",
]
