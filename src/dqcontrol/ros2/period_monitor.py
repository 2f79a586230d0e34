"""When the next step may be taken, and how old what was heard is."""

from __future__ import annotations

_MOST = 1.5  # steps that may be saved up: a message half a period late or early costs none
SILENCE = 1.4  # periods without a message after which steps are taken without one
_DRIFT = 1e-3  # by which two clocks may differ in speed: without it, one that is slow would seem ever later


class PeriodMonitor:
    """Allows one step a period on average, whatever the messages do: those that come in a burst are left out.

    Parameters
    ----------
    period
        s.

    Examples
    --------
    >>> monitor = PeriodMonitor(0.01)
    >>> monitor.start(now=5.0, stamp=100.0)
    >>> monitor.hear(now=5.02, stamp=100.01), monitor.hear(now=5.021, stamp=100.02)  # the first comes 10 ms late
    (True, False)
    >>> round(monitor.age(now=5.025), 3)
    0.005
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self._saved = self._counted = self._heard = self._offset = self._stamp = 0.0

    def start(self, now: float, stamp: float) -> None:
        """Begin with a first message that was heard now, s, and stamped by its sender's clock, s."""
        self._saved, self._counted, self._heard = _MOST - 1.0, now, now
        self._stamp, self._offset = stamp, now - stamp

    def hear(self, now: float, stamp: float) -> bool:
        """Note a message; return whether a step may be taken."""
        drifted = self._offset + _DRIFT * (now - self._heard)
        self._heard, self._stamp = now, stamp
        self._offset = min(drifted, now - stamp)
        return self._take(now)

    def is_overdue(self, now: float) -> bool:
        """Return whether a step is to be taken without a message."""
        return now - self._heard >= SILENCE * self.period and self._take(now)

    def age(self, now: float) -> float:
        """Return the age of the last message, s, as if the fastest one so far had taken no time."""
        return now - self._stamp - self._offset

    def _take(self, now: float) -> bool:
        self._saved = min(self._saved + (now - self._counted) / ((1.0 - _DRIFT) * self.period), _MOST)
        self._counted = now
        if self._saved < 1.0:
            return False
        self._saved -= 1.0
        return True
