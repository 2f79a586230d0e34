"""A metric over the grid of the weights q and r of [P16] appendix D."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dqcontrol.loop import has_failed
from dqcontrol_theses.results import Row


def grid_of(rows: Sequence[Row], key: str) -> tuple[list[float], list[float], NDArray[np.float64]]:
    """Return the values of q and r and the metric for each pair, shape (len(q), len(r)); NaN where a run failed."""
    qs, rs = (
        sorted({row[f"parameter.{name}"] for row in rows}) for name in ("error_weight", "control_weight")
    )
    grid = np.full((len(qs), len(rs)), math.nan)
    for row in rows:
        if not has_failed(str(row["stopped"])):
            place = qs.index(row["parameter.error_weight"]), rs.index(row["parameter.control_weight"])
            grid[place] = row[key]
    return qs, rs, grid
