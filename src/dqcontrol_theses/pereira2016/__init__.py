"""[P16]: M. S. Pereira, six laws on the right arm of a Meka A2."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
