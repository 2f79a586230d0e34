"""Learning from repetition: the reference is shifted from repeat to repeat until the hand goes where it should."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)
