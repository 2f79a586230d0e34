"""The last ten seconds beside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dqcontrol.browser.play.session import SHOWN, ChartPoint
from dqcontrol.figures.style import COLOURS

_HEIGHT = 128  # px
_WIDTH = 1.5  # px
_STROKES = {"robot": COLOURS[0], "ghost": COLOURS[1]}


class Charts:
    """Error, share of the limits, clearance and force over time."""

    def __init__(self, gui: Any) -> None:
        self._charts = [
            self._chart(gui, "Error [mm]", ("ghost", "robot"), (0.0, None)),
            self._chart(gui, "Speed, share of the limit [%]", ("robot",), (0.0, 100.0)),
            self._chart(gui, "Clearance beyond what is asked [mm]", ("robot",), (None, None)),
            self._chart(gui, "Force [N]", ("robot",), (0.0, None)),
        ]

    def show(self, history: Sequence[ChartPoint]) -> None:
        """Show what happened."""
        rows = np.array([[*moment] for moment in history] or [[0.0] * len(ChartPoint._fields)])
        time = rows[:, 0] - rows[-1, 0]
        error, share, clearance, ghost, force = rows[:, 1:6].T * np.array([[1e3], [100], [1e3], [1e3], [1]])
        ghost = np.where(np.isnan(ghost), error, ghost)  # beneath the robot's own: NaN would leave no scale
        shown = ((ghost, error), (share,), (clearance,), (force,))
        for chart, values in zip(self._charts, shown, strict=True):
            chart.data = (time, *values)
        for chart, values in zip(self._charts[2:], shown[2:], strict=True):
            chart.visible = bool(np.isfinite(values[0]).any())

    def _chart(
        self, gui: Any, title: str, names: tuple[str, ...], ends: tuple[float | None, float | None]
    ) -> Any:
        nothing = np.array([-SHOWN, 0.0])
        return gui.add_uplot(
            data=(nothing, *(np.full(2, np.nan) for _ in names)),
            series=(
                {"label": "t"},
                *({"label": name, "stroke": _STROKES[name], "width": _WIDTH} for name in names),
            ),
            title=title,
            scales={
                "x": {"time": False, "range": (-SHOWN, 0.0)},  # else seconds are shown as dates
                "y": {"range": (ends[0], ends[1])} if None not in ends else {},
            },
            axes=({"size": 30}, {"size": 44}),
            padding=(8, 16, 0, 0),
            legend={"show": False},
            height=_HEIGHT,
        )
