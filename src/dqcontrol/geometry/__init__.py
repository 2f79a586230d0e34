"""Shapes in space: their signed distances, with points, normals and Jacobians; and capsules around points."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
