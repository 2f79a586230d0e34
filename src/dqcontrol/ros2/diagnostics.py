"""Diagnostics of a node: refusals and changes in its log, and all of it on /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from dqcontrol.ros2.middleware import steady_timer

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


_LEVELS = {"ok": DiagnosticStatus.OK, "warning": DiagnosticStatus.WARN, "error": DiagnosticStatus.ERROR}
_QUIET = 1.0  # s in which the same line is not logged again


class Diagnostics:
    """Publishes a node's state each second and whenever it changes.

    Parameters
    ----------
    node
        Whose.
    values
        Returns level (``ok``, ``warning`` or ``error``), state and further values by name.
    """

    def __init__(self, node: Node, values: Callable[[], tuple[str, str, Mapping[str, object]]]) -> None:
        self._node, self._values = node, values
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = steady_timer(node, 1.0, self.publish)
        self._refused, self._last_refused = 0, "none"
        self._logged: dict[str, float] = {}

    def refuse(self, why: object) -> None:
        """Say that a message, a service or a parameter was refused."""
        self._refused, self._last_refused = self._refused + 1, str(why)
        now = time.monotonic()
        if now - self._logged.get(self._last_refused, -_QUIET) >= _QUIET:
            self._logged = {line: at for line, at in self._logged.items() if now - at < _QUIET}
            self._logged[self._last_refused] = now
            self._node.get_logger().warning(f"refused: {why}")
            self.publish()

    def tell(self, what: str) -> None:
        """Log a change of state."""
        self._node.get_logger().info(what)
        self.publish()

    def alarm(self, what: str) -> None:
        """Log what stopped the robot."""
        self._node.get_logger().error(what)
        self.publish()

    def publish(self) -> None:
        """Publish the present state."""
        level, state, values = self._values()
        values = {**values, "refused": self._refused, "last refused": self._last_refused}
        status = DiagnosticStatus(
            level=_LEVELS[level],
            name=self._node.get_fully_qualified_name(),
            message=state,
            hardware_id="dqcontrol",
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
