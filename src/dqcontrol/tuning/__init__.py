"""The best that a law can do: search for its parameters over compiled runs, and learning from repetition."""

from dqcontrol.tuning.front_search import hypervolume, nondominated, search_front
from dqcontrol.tuning.learning import Convergence, LearnBlock, Learning, LearningRun, learn, learn_to
from dqcontrol.tuning.run_tuning import TunedLaw, Tuning, tune, tune_to
from dqcontrol.tuning.tune_spec import TuneBlock

__all__ = [
    "Convergence",
    "LearnBlock",
    "Learning",
    "LearningRun",
    "TuneBlock",
    "TunedLaw",
    "Tuning",
    "hypervolume",
    "learn",
    "learn_to",
    "nondominated",
    "search_front",
    "tune",
    "tune_to",
]
