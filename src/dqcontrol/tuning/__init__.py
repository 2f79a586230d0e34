"""The best that a law can do: search for its parameters over compiled runs, and learning from repetition."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)
