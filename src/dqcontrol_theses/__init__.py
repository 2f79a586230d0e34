"""Experiments of the source documents run again, and what these printed: their numbers and their claims."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
