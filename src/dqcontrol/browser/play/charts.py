"""The last ten seconds beside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dqcontrol.browser.play.session import SHOWN, ChartPoint
from dqcontrol.figures.style import COLOURS

_HEIGHT = 112  # px: one is seen whole in a window of 720
_WIDTH = 1.5  # px
_LEAST_ERROR, _LEAST_FORCE = 1.0, 10.0  # mm, N: less fills no chart
_STROKES = {"robot": COLOURS[0], "ghost": COLOURS[1], "further": COLOURS[2]}
_ERROR = "Error [mm]"


class Charts:
    """Error, share of the limits, clearance and force over time."""

    def __init__(self, gui: Any) -> None:
        self._error = self._chart(gui, _ERROR, ("ghost", "further", "robot"))
        self._share = self._chart(gui, "Speed, share of the limit [%]", ("robot",), 100.0)
        self._clearance = self._chart(gui, "Clearance beyond what is asked [mm]", ("robot",))
        self._force = self._chart(gui, "Force [N]", ("robot",))

    def show(self, history: Sequence[ChartPoint], labels: tuple[str, str] = ("", "")) -> None:
        """Show what happened; ``labels`` name what the law drives, and what further tasks do, where there are any."""
        title = f"{_ERROR}: {labels[0]} (blue), {labels[1]} (green)" if labels[1] else _ERROR
        if self._error.title != title:
            self._error.title = title
        rows = np.array([[*moment] for moment in history] or [[0.0] * len(ChartPoint._fields)])
        time = rows[:, 0] - rows[-1, 0]
        scales = np.array([[1e3], [100], [1e3], [1e3], [1e3], [1]])
        error, share, clearance, further, ghost, force = rows[:, 1:7].T * scales
        # What there is not lies beneath the robot's own: NaN would leave no scale.
        others = [np.where(np.isnan(other), error, other) for other in (ghost, further)]
        self._error.data, self._share.data = (time, *others, error), (time, share)
        _reach_up_to(self._error, max(float(np.nanmax([error, *others])), _LEAST_ERROR))
        for chart, values in ((self._clearance, clearance), (self._force, force)):
            chart.visible = bool(np.isfinite(values).any())
            if chart.visible:
                chart.data = (time, values)
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
    x = {"time": False}  # else seconds are shown as dates
    return {"x": x, "y": {} if top is None else {"range": (0.0, top)}}


def _reach_up_to(chart: Any, value: float) -> None:
    """Let a chart reach up to the next of 1, 2, 5, 10, …: nothing jumps, and noise does not fill it."""
    decade = 10.0 ** np.floor(np.log10(value))
    top = float(decade * next(step for step in (1, 2, 5, 10) if step * decade >= value * (1 - 1e-9)))
    if chart.scales["y"].get("range") != (0.0, top):
        chart.scales = _scales(top)
