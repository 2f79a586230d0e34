"""Force as a task: what a measured wrench makes of the desired motion, before any law."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
