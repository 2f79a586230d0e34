"""The choice between Numba's internals and, with ``DQCONTROL_NUMBA=plain`` in the environment, its public part."""

from __future__ import annotations

import os
from typing import Any

IS_PLAIN: bool = os.environ.get("DQCONTROL_NUMBA") == "plain"

# Internals that a new release of Numba lacks are not imported where they are not used.
if IS_PLAIN:
    from dqcontrol.compiled import numba_public as _used
else:
    from dqcontrol.compiled import numba_internals as _used

numba_used: Any = _used
