from .pereira2016_catalogue import (
    EXPERIMENTS as EXPERIMENTS,
    PLANTS as PLANTS,
    published_spec as published_spec,
)
from .published_numbers import (
    REPRODUCTIONS as REPRODUCTIONS,
    Disagreement as Disagreement,
    PublishedRun as PublishedRun,
    claims as claims,
    disagreements as disagreements,
    published_cells as published_cells,
    published_runs as published_runs,
)
from .reproduce_pereira2016 import reproduce as reproduce
