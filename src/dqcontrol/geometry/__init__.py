"""Shapes in space: their signed distances, with points, normals and Jacobians; and capsules around points."""

from dqcontrol.moved import offered

__getattr__, __dir__, __all__ = offered(__name__, __file__)
