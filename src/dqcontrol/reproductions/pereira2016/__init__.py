"""[P16]: M. S. Pereira, six laws on the right arm of a Meka A2."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)
