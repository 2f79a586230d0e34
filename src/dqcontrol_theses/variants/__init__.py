"""Laws, plants and options that only the theses compare, offered by entry points as any package's."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
