"""A robot under a person's hand in a browser: `PlaySession` moves and records it, `PlayPage` shows it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
