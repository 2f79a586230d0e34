"""Numba: kernels, what they share, and the folder that keeps their machine code."""

from importlib import import_module
from threading import Thread

import lazy_loader

# Numba's import calls many functions. Where they begin deep in the imports of a program, at the end of a piece of
# the interpreter's stack, CPython asks the system for memory at each call and gives it back: twice the time. A thread
# has a stack of its own. If the import fails, the next one says why.
_first = Thread(target=import_module, args=("numba",))
_first.start()
_first.join()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
