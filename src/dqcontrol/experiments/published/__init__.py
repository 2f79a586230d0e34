"""Experiments of the source documents run again, and what these printed: their numbers and their claims."""

from dqcontrol.experiments.published.catalogue import (
    SAMPLES,
    SOURCES,
    Experiment,
    catalogue_table,
    chosen_plant,
    experiments,
    names,
)
from dqcontrol.experiments.published.printed import Claim, PublishedCell
from dqcontrol.experiments.published.reproduce import reproduce
from dqcontrol.experiments.published.reproduced import Reproduced

__all__ = [
    "SAMPLES",
    "SOURCES",
    "Claim",
    "Experiment",
    "PublishedCell",
    "Reproduced",
    "catalogue_table",
    "chosen_plant",
    "experiments",
    "names",
    "reproduce",
]
