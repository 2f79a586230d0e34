from .compile import (
    OK as OK,
    Kernel as Kernel,
    inline as inline,
    kernel as kernel,
)
from .intrinsics import (
    LAW as LAW,
    call_law as call_law,
)
from .memory_layout import MemoryLayout as MemoryLayout
