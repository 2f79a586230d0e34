"""The last ten seconds beside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dqcontrol.browser.play.session import SHOWN, ChartPoint
from dqcontrol.figures.style import COLOURS

_HEIGHT = 128  # px
_WIDTH = 1.5  # px
_LEAST_ERROR, _LEAST_FORCE = 1.0, 10.0  # mm, N: less fills no chart
_STROKES = {"robot": COLOURS[0], "ghost": COLOURS[1]}


class Charts:
    """Error, share of the limits, clearance and force over time."""

    def __init__(self, gui: Any) -> None:
        self._error = self._chart(gui, "Error [mm]", ("ghost", "robot"))
        self._share = self._chart(gui, "Speed, share of the limit [%]", ("robot",), 100.0)
        self._clearance = self._chart(gui, "Clearance beyond what is asked [mm]", ("robot",))
        self._force = self._chart(gui, "Force [N]", ("robot",))

    def show(self, history: Sequence[ChartPoint]) -> None:
        """Show what happened."""
        rows = np.array([[*moment] for moment in history] or [[0.0] * len(ChartPoint._fields)])
        time = rows[:, 0] - rows[-1, 0]
        error, share, clearance, ghost, force = rows[:, 1:6].T * np.array([[1e3], [100], [1e3], [1e3], [1]])
        ghost = np.where(np.isnan(ghost), error, ghost)  # beneath the robot's own: NaN would leave no scale
        self._error.data, self._share.data = (time, ghost, error), (time, share)
        _reach_up_to(self._error, max(float(np.nanmax([error, ghost])), _LEAST_ERROR))
        for chart, values in ((self._clearance, clearance), (self._force, force)):
            chart.data = (time, values)
            chart.visible = bool(np.isfinite(values).any())
        if self._force.visible:
            _reach_up_to(self._force, max(float(np.nanmax(force)), _LEAST_FORCE))

    def _chart(self, gui: Any, title: str, names: tuple[str, ...], top: float | None = None) -> Any:
        nothing = np.array([-SHOWN, 0.0])
        return gui.add_uplot(
            data=(nothing, *(np.full(2, np.nan) for _ in names)),
            series=(
                {"label": "t"},
                *({"label": name, "stroke": _STROKES[name], "width": _WIDTH} for name in names),
            ),
            title=title,
            scales=_scales(top),
            axes=({"size": 30}, {"size": 44}),
            padding=(8, 16, 0, 0),
            legend={"show": False},
            height=_HEIGHT,
        )


def _scales(top: float | None) -> dict[str, Any]:
    """Return those of a chart from 0 up to something, or as its values ask for."""
    x = {"time": False, "range": (-SHOWN, 0.0)}  # else seconds are shown as dates
    return {"x": x, "y": {} if top is None else {"range": (0.0, top)}}


def _reach_up_to(chart: Any, value: float) -> None:
    """Let a chart reach up to the next of 1, 2, 5, 10, …: nothing jumps, and noise does not fill it."""
    decade = 10.0 ** np.floor(np.log10(value))
    top = float(decade * next(step for step in (1, 2, 5, 10) if step * decade >= value * (1 - 1e-9)))
    if chart.scales["y"].get("range") != (0.0, top):
        chart.scales = _scales(top)
