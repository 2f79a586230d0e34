"""The law and its gain, with what `check` expects of it."""

from __future__ import annotations

import math
from typing import Any

from dqcontrol.browser.play.session import PlaySession, law_from
from dqcontrol.browser.served_page import import_viser
from dqcontrol.errors import Error
from dqcontrol.experiments.gain_advice import law_parameters
from dqcontrol.laws.loop_rates import LoopRates

_NONE = "none"
_STEP, _LEAST = 0.1, 0.1  # 1/s
_INVERSES = {
    "filtered": {"kind": "filtered"},
    "damped": {"kind": "damped", "damping": 0.05},
    "manipulability": {"kind": "manipulability"},
}


class LawTab:
    """Kind, gain, inverse, and the law of a second robot."""

    def __init__(self, gui: Any, session: PlaySession) -> None:
        self._gui, self._session, self._busy = gui, session, False
        kinds = tuple(law_parameters(1.0, 1.0))
        present = str(session.spec["law"].get("kind"))
        self._kind = gui.add_dropdown("Law", tuple(dict.fromkeys((*kinds, present))), initial_value=present)
        self._gain = gui.add_slider("Gain k [1/s]", _LEAST, 100.0, _STEP, 5.0)
        self._expected = gui.add_markdown("")
        self._inverse = gui.add_dropdown("Inverse", tuple(_INVERSES))
        self._ghost = gui.add_dropdown("Second robot", (_NONE, *kinds), initial_value=_NONE)
        self._kind.on_update(lambda _: self._changed())
        self._gain.on_update(lambda _: self._changed())
        self._inverse.on_update(lambda _: self._inverse_changed())
        self._ghost.on_update(lambda _: self._ghost_changed())
        self.refresh()

    def refresh(self) -> None:
        """Show the law that runs, and the gains that are good and that are the limit for the present robot."""
        session = self._session
        row = session.check()
        self._busy = True
        try:
            kind = str(session.spec["law"].get("kind"))
            if kind not in self._kind.options:
                self._kind.options = (*self._kind.options, kind)
            self._kind.value = kind
            if row.loops:
                worst, period = row.worst, session.live.period
                good, limit = (each / period for each in (worst.limits.recommended, worst.limits.stable))
                self._mark(abs(worst.gain.value), good, limit)
            self._expected.content = f"{row.verdict}. {row.remark}".strip()
        finally:
            self._busy = False

    def _mark(self, gain: float, good: float, limit: float) -> None:
        """Let the slider reach beyond the limit, as far as that is near; mark both."""
        most = max(1.3 * limit if limit < 8 * good else 4 * good, 1.2 * gain, 1.0)
        most = _STEP * math.ceil(most / _STEP)
        mark = import_viser()._messages.GuiSliderMark  # what `add_slider` makes of pairs
        marks = [mark(round(good, 1), f"good {good:.3g}")] if _LEAST < good < most else []
        if limit < most:
            marks.append(mark(round(limit, 1), f"limit {limit:.3g}"))
        self._gain.max = most
        self._gain.marks = tuple(marks)
        self._gain.value = min(max(round(gain, 1), _LEAST), most)

    def _changed(self) -> None:
        if self._busy:
            return
        session, kind, k = self._session, self._kind.value, float(self._gain.value)
        present = session.spec["law"]
        try:
            if kind == present.get("kind"):
                law = law_from(present)
                rates = _gain_of(law.loop_rates(law.rows(session.robot, None, session.live.period)))
                law = law.scaled(k / rates) if rates else law
            else:
                law = law_from({"kind": kind, **law_parameters(k, k / 2)[kind]})
        except Error as error:
            session.tell(f"not done: {error}")
            return
        session.set_law(law)

    def _inverse_changed(self) -> None:
        law, chosen = self._session.spec["law"], self._inverse.value
        try:
            self._session.set_law(law_from({**law, "inverse": _INVERSES[chosen]}))
        except Error as error:
            self._session.tell(f"not done: {error}")

    def _ghost_changed(self) -> None:
        kind = self._ghost.value
        k = float(self._gain.value)
        data = None if kind == _NONE else {"kind": kind, **law_parameters(k, k / 2)[kind]}
        self._session.set_ghost(data)


def _gain_of(rates: LoopRates | None) -> float:
    """Return the largest of the gains of position and orientation, 1/s."""
    if rates is None:
        return 0.0
    return max(float(abs(each).max()) for each in (rates.position, rates.orientation) if each is not None)
