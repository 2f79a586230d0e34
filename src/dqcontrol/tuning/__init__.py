"""The best that a law can do: search for its parameters over compiled runs."""

from dqcontrol.tuning.front_search import hypervolume, nondominated, search_front
from dqcontrol.tuning.run_tuning import TunedLaw, Tuning, tune, tune_to
from dqcontrol.tuning.tune_spec import TuneBlock

__all__ = [
    "TuneBlock",
    "TunedLaw",
    "Tuning",
    "hypervolume",
    "nondominated",
    "search_front",
    "tune",
    "tune_to",
]
