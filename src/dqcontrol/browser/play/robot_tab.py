"""The period of the loop, and how late and how well joints follow."""

from __future__ import annotations

from typing import Any

from dqcontrol.browser.play.contact_panel import ContactPanel
from dqcontrol.browser.play.session import PlaySession

_PLANTS = {"ideal": "integrator", "servo": "servo", "physics": "mujoco"}
_NAMES = {kind: name for name, kind in _PLANTS.items()}
_OTHER = "as the spec says"
# An admittance that a hand feels at once and that comes back: 10 N take it 5 cm away, within half a second
_GIVES_WAY = {"axes": "base", "translation": {"damping": 100.0, "stiffness": 200.0}}
_WRIST = {"filter": 0.01}  # s: its force sensor


class RobotTab:
    """Period, plant, lag, delay, sag and noise of encoders; contact."""

    def __init__(self, gui: Any, session: PlaySession) -> None:
        self._session, self._busy = session, False
        self._contact = ContactPanel(gui, session)
        self._plant = gui.add_dropdown("Joints", (*_PLANTS, _OTHER))
        self._period = gui.add_slider("Period [ms]", 1.0, 50.0, 1.0, 10.0)
        self._lag = gui.add_slider("Lag [ms]", 0.0, 300.0, 5.0, 50.0)
        self._delay = gui.add_slider("Delay [ms]", 0.0, 200.0, 5.0, 0.0)
        self._sag = gui.add_slider("Sag under gravity [%]", 0.0, 200.0, 5.0, 0.0)
        self._noise = gui.add_slider("Encoder noise [mrad]", 0.0, 2.0, 0.05, 0.0)
        self._gives_way = gui.add_checkbox("Give way (force at the wrist)", False)
        self._servo = (self._lag, self._delay, self._sag, self._noise)
        for each in (self._plant, self._period, *self._servo, self._gives_way):
            each.on_update(lambda _: self._changed())
        self.refresh()

    def refresh(self) -> None:
        """Show what the present robot has."""
        session = self._session
        self._contact.refresh()
        plant, (case,) = session.spec["plant"], session.setting.cases
        self._busy = True
        try:
            self._plant.value = _NAMES.get(str(plant.get("kind")), _OTHER)
            self._period.value = min(max(round(1e3 * session.live.period), 1.0), 50.0)
            is_servo = self._plant.value == "servo"
            self._gives_way.visible = self._plant.value == "physics" and len(session.robot.ends) == 1
            self._gives_way.value = session.spec.get("contact") is not None
            for slider, key, scale in zip(
                self._servo,
                ("time_constant", "delay", "sag", "encoder_noise"),
                (1e3, 1e3, 1e2, 1e3),
                strict=True,
            ):
                value: Any = getattr(case.plant, key, 0.0)
                slider.visible = is_servo and isinstance(value, float | int)
                if isinstance(value, float | int) and is_servo:
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
        contact = session.spec.get("contact")
        if self._gives_way.visible and self._gives_way.value != (contact is not None):
            contact = _GIVES_WAY if self._gives_way.value else None
            plant.pop("wrist", None)
            plant |= {"wrist": _WRIST} if contact else {}
        elif plant["kind"] != present.get("kind") and contact == _GIVES_WAY:
            contact = None  # other joints feel nothing
        done = session.change(
            plant=plant,
            contact=contact,
            period=1e-3 * self._period.value,
            reference=session.spec["reference"],
        )
        if not done:
            self.refresh()
