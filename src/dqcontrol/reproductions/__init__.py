"""Experiments of the source documents run again, and what these printed: their numbers and their claims."""

from dqcontrol.reproductions.catalogue import (
    SAMPLES,
    SOURCES,
    Experiment,
    catalogue_table,
    chosen_plant,
    experiments,
    names,
)
from dqcontrol.reproductions.printed import Claim, PublishedCell
from dqcontrol.reproductions.reproduce_one import is_finished, reproduce
from dqcontrol.reproductions.reproduced import Reproduced

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
    "is_finished",
    "names",
    "reproduce",
]
