"""Which way to use Numba: by its internals, or, with ``DQCONTROL_NUMBA=plain`` in the environment, without them."""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

IS_PLAIN: bool = os.environ.get("DQCONTROL_NUMBA") == "plain"

# By name, so that internals which a new release of Numba lacks are not imported where they are not used.
numba_used: Any = import_module(f"dqcontrol.compiled.numba_{'public' if IS_PLAIN else 'internals'}")
