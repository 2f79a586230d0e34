"""Plants: what moves when a law commands it, and what disturbs it."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)
