"""Control laws: frozen parameters, each with one compiled function."""

from dqcontrol.laws.feedforward import ProportionalFeedforward
from dqcontrol.laws.gains import Schedule
from dqcontrol.laws.inverses import DampedInverse, FilteredInverse
from dqcontrol.laws.law import Law, PreparedLaw
from dqcontrol.laws.proportional import Proportional

__all__ = [
    "DampedInverse",
    "FilteredInverse",
    "Law",
    "PreparedLaw",
    "Proportional",
    "ProportionalFeedforward",
    "Schedule",
]
