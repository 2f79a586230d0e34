"""Pictures of physics: clips, single pictures, light painting."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)
