"""Constraints: what a robot must not cross, around any law; their rows and quadratic programs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
