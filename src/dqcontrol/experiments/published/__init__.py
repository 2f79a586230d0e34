"""What the source documents printed: their numbers and what they claim about them."""

from dqcontrol.experiments.published.catalogue import PLANT, SOURCE, catalogue_table, names, reproduction
from dqcontrol.experiments.published.published_numbers import (
    REPRODUCTIONS,
    Claim,
    Disagreement,
    PublishedCell,
    PublishedRun,
    claims,
    disagreements,
    published_cells,
    published_runs,
)
from dqcontrol.experiments.published.published_specs import PLANTS, published_spec
from dqcontrol.experiments.published.reproduce import SAMPLES, Reproduced, reproduce

__all__ = [
    "PLANT",
    "PLANTS",
    "REPRODUCTIONS",
    "SAMPLES",
    "SOURCE",
    "Claim",
    "Disagreement",
    "PublishedCell",
    "PublishedRun",
    "Reproduced",
    "catalogue_table",
    "claims",
    "disagreements",
    "names",
    "published_cells",
    "published_runs",
    "published_spec",
    "reproduce",
    "reproduction",
]
