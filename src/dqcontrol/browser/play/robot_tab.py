"""The period of the loop, and how late and how well joints follow."""

from __future__ import annotations

from typing import Any

from dqcontrol.browser.play.session import PlaySession

_PLANTS = {"ideal": "integrator", "servo": "servo", "physics": "mujoco"}
_NAMES = {kind: name for name, kind in _PLANTS.items()}
_OTHER = "as the spec says"


class RobotTab:
    """Period, plant, lag, delay, sag and noise of encoders."""

    def __init__(self, gui: Any, session: PlaySession) -> None:
        self._session, self._busy = session, False
        self._plant = gui.add_dropdown("Joints", (*_PLANTS, _OTHER))
        self._period = gui.add_slider("Period [ms]", 1.0, 50.0, 1.0, 10.0)
        self._lag = gui.add_slider("Lag [ms]", 0.0, 300.0, 5.0, 50.0)
        self._delay = gui.add_slider("Delay [ms]", 0.0, 200.0, 5.0, 0.0)
        self._sag = gui.add_slider("Sag under gravity [%]", 0.0, 200.0, 5.0, 0.0)
        self._noise = gui.add_slider("Encoder noise [mrad]", 0.0, 2.0, 0.05, 0.0)
        self._servo = (self._lag, self._delay, self._sag, self._noise)
        for each in (self._plant, self._period, *self._servo):
            each.on_update(lambda _: self._changed())
        self.refresh()

    def refresh(self) -> None:
        """Show what the present robot has."""
        session = self._session
        plant, (case,) = session.spec["plant"], session.setting.cases
        self._busy = True
        try:
            self._plant.value = _NAMES.get(str(plant.get("kind")), _OTHER)
            self._period.value = min(max(round(1e3 * session.live.period), 1.0), 50.0)
            is_servo = self._plant.value == "servo"
            for slider, key, scale in zip(
                self._servo,
                ("time_constant", "delay", "sag", "encoder_noise"),
                (1e3, 1e3, 1e2, 1e3),
                strict=True,
            ):
                value = getattr(case.plant, key, 0.0)
                slider.visible = is_servo and not isinstance(value, list)
                if slider.visible:
                    slider.value = min(max(scale * float(value), slider.min), slider.max)
        finally:
            self._busy = False

    def _changed(self) -> None:
        if self._busy:
            return
        session, present = self._session, self._session.spec["plant"]
        plant = dict(present)
        if self._plant.value != _OTHER:
            kind = _PLANTS[self._plant.value]
            plant = plant if kind == present.get("kind") else {"kind": kind}
        if plant.get("kind") == "servo" == present.get("kind"):
            plant |= {
                "time_constant": 1e-3 * self._lag.value,
                "delay": 1e-3 * self._delay.value,
                "sag": 1e-2 * self._sag.value,
                "encoder_noise": 1e-3 * self._noise.value,
            }
        done = session.change(
            plant=plant, period=1e-3 * self._period.value, reference=session.spec["reference"]
        )
        if not done:
            self.refresh()
