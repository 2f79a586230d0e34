"""What a node tells about itself: refusals and changes in its log, and all of it on /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from dqcontrol.ros2.middleware import steady_timer

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
