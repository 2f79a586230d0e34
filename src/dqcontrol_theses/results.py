"""Results of a reproduction, by the names of the published tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.loop import has_failed

METRICS = {  # of the published tables: Err., θ̇, Eff., L.Vel., L.Acc. [P16 5.2]
    "error": "error.integral",
    "control": "control.integral",
    "joint_step": "joint_step.integral",
    "hand_speed": "hand_speed.integral",
    "hand_acceleration": "hand_acceleration.integral",
}

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Results:
    """The rows of one reproduction's studies.

    Attributes
    ----------
    rows
        By the experiment's name in the published tables.
    error
        The metric that stands for the published error norm.
    control_unit
        What the published control signal counts in: 1, or a period in s where the source printed T u for u.
    """

    rows: Mapping[str, Sequence[Row]]
    error: str = "error.integral"
    control_unit: float = 1.0
    _groups: dict[tuple[str, str, str], list[Row]] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        for experiment, rows in self.rows.items():
            for row in rows:
                self._groups.setdefault((experiment, row["law"], row["set"]), []).append(row)

    def sets(self, law: str, experiment: str = "") -> list[str]:
        """Return the parameter sets that a law ran with."""
        return [group[2] for group in self._groups if group[:2] == (experiment, law)]

    def group(self, law: str, parameters: str = "", experiment: str = "") -> list[Row]:
        """Return the repeats of a law with one set; the empty name stands for its only set."""
        names = self.sets(law, experiment)
        if not parameters and len(names) == 1:
            parameters = names[0]
        return self._groups.get((experiment, law, parameters), [])

    def values(
        self, law: str, parameters: str = "", metric: str = "error", experiment: str = ""
    ) -> NDArray[np.float64]:
        """Return a metric of all repeats that did not fail; published names or those of `Metrics.flat`."""
        key = self.error if metric == "error" else METRICS.get(metric, metric)
        rows = self.group(law, parameters, experiment)
        kept = [row[key] for row in rows if not has_failed(str(row["stopped"]))]
        unit = self.control_unit if metric == "control" else 1.0
        return unit * np.array([value for value in kept if value is not None], dtype=np.float64)

    def mean(self, law: str, parameters: str = "", metric: str = "error", experiment: str = "") -> float:
        """Return the mean over the repeats; NaN if there are none."""
        values = self.values(law, parameters, metric, experiment)
        return float(values.mean()) if len(values) else math.nan

    def deviation(self, law: str, parameters: str = "", metric: str = "error", experiment: str = "") -> float:
        """Return the sample standard deviation; NaN for fewer than two repeats."""
        values = self.values(law, parameters, metric, experiment)
        return float(values.std(ddof=1)) if len(values) > 1 else math.nan
