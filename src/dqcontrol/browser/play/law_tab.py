"""The law and its gain, with what `check` expects of it."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dqcontrol.browser.play.session import PlaySession, law_from
from dqcontrol.errors import Error
from dqcontrol.experiments.gain_advice import law_parameters

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
        self._lock = threading.RLock()
        kinds = tuple(law_parameters(1.0, 1.0))
        present = str(session.spec["law"].get("kind"))
        self._kind = gui.add_dropdown("Law", tuple(dict.fromkeys((*kinds, present))), initial_value=present)
        self._box: Any = gui.add_folder("Gain")
        self._marked: object = None
        self._gain: Any = None
        self._mark(5.0, 10.0, 100.0)
        self._expected = gui.add_markdown("")
        self._inverse = gui.add_dropdown("Inverse", tuple(_INVERSES))
        self._ghost = gui.add_dropdown("Second robot", (_NONE, *kinds), initial_value=_NONE)
        self._kind.on_update(lambda _: self._changed())
        self._inverse.on_update(lambda _: self._inverse_changed())
        self._ghost.on_update(lambda _: self._ghost_changed())

    def refresh(self) -> None:
        """Show the law that runs, and the gains that are good and that are the limit for the present robot."""
        with self._quietly():
            kind = str(self._session.spec["law"].get("kind"))
            if kind not in self._kind.options:
                self._kind.options = (*self._kind.options, kind)
            self._kind.value = kind
        threading.Thread(target=self._advise, name="check", daemon=True).start()

    def _advise(self) -> None:
        """Say what `check` expects, unless another robot or law runs by then."""
        session = self._session
        setting = session.setting
        row = session.check()
        with self._quietly():
            if setting is not session.setting:
                return
            words = ""
            if row.loops:
                limits, period = row.worst.limits, setting.spec.period
                good, limit = limits.recommended / period, limits.stable / period
                self._mark(self._present_gain(), good, limit)
                ends = f"; stable up to {limit:.3g}" if math.isfinite(limit) else ""
                words = f"Good up to {good:.3g} 1/s{ends}. "
            self._expected.content = f"{words}This one: {row.verdict}. {row.remark}".strip()

    @contextmanager
    def _quietly(self) -> Iterator[None]:
        """Change what is shown without taking that for a wish."""
        with self._lock:
            self._busy = True
            try:
                yield
            finally:
                self._busy = False

    def _mark(self, gain: float, good: float, limit: float) -> None:
        """Let the slider reach beyond the limit, as far as that is near; mark both."""
        most = max(1.3 * limit if limit < 8 * good else 4 * good, 1.2 * gain, 1.0)
        most = _STEP * math.ceil(most / _STEP)
        marks = [(round(good, 1), f"good {good:.3g}")] if _LEAST < good < most else []
        if limit < most:
            marks.append((round(limit, 1), f"limit {limit:.3g}"))
        value = min(max(round(gain, 1), _LEAST), most)
        if self._marked == (most, marks):
            self._gain.value = value
            return
        self._marked = most, marks
        if self._gain is not None:
            self._gain.remove()  # marks cannot be changed
        with self._box:
            self._gain = self._gui.add_slider("k [1/s]", _LEAST, most, _STEP, value, marks=tuple(marks))
        self._gain.on_update(lambda _: self._changed())

    def _changed(self) -> None:
        if self._busy:
            return
        session, kind, k = self._session, self._kind.value, float(self._gain.value)
        present = session.spec["law"]
        try:
            if kind == present.get("kind"):
                law, gain = law_from(present), self._present_gain()
                law = law.scaled(k / gain) if gain else law
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

    def _present_gain(self) -> float:
        """Return the largest of the gains of position and orientation, 1/s; 0 of a law without."""
        live = self._session.live
        rates = live.law.loop_rates(live.law.rows(live.robot, None, live.period))
        if rates is None:
            return 0.0
        return max(
            float(np.abs(np.asarray(each, np.complex128)).max())
            for each in (rates.position, rates.orientation)
            if each is not None
        )
