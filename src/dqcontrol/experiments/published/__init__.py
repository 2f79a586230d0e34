"""What the source documents printed: their numbers and what they claim about them."""

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

__all__ = [
    "REPRODUCTIONS",
    "Claim",
    "Disagreement",
    "PublishedCell",
    "PublishedRun",
    "claims",
    "disagreements",
    "published_cells",
    "published_runs",
]
