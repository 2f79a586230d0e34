from .pereira2016_catalogue import (
    EXPERIMENTS as EXPERIMENTS,
    PLANTS as PLANTS,
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
from .published_specs import published_spec as published_spec
from .reproduce_pereira2016 import reproduce as reproduce
