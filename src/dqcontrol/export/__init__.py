"""Controllers as libraries in C: a prepared law, its supervisor and its reference for a robot's own computer."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
