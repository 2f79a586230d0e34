"""The controller as a ROS 2 node: its states, services and diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from rclpy.node import Node
from std_srvs.srv import Trigger

from dqcontrol.errors import Error
from dqcontrol.loop.control import Phase
from dqcontrol.loop.interrupts import Interrupts
from dqcontrol.ros2.controller_loop import Following
from dqcontrol.ros2.diagnostics import Diagnostics
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.middleware import destroyed_on_failure, spin
from dqcontrol.ros2.recorder import Recorder

_LEVELS = {Phase.STOPPED: "error", Phase.STOPPING: "warning"}
_CATEGORIES = {
    None: "none",
    1: "1: at rest the power is to be removed",
    2: "2: holds under power",
}  # IEC 60204-1


class ControllerNode(Node):
    """Follows a spec's reference, poses or a twist with a robot behind topics; docs/ros2.md names these.

    Parameters
    ----------
    spec
        Path of a YAML file of one run; of its plant only ``command_mode`` and ``impedance`` count.
    name
        Of the node.
    source
        What it follows: ``spec``, ``pose``, ``twist``, ``servo``, the topics of MoveIt Servo, or ``haptics``, a leader
        that feels what it does.
    interface
        What it sends to joints: ``velocity``, ``position``, ``trajectory``, ``humanoid`` or ``effort``, the torques of
        the plant's ``impedance``.
    base_interface
        What it sends to a mobile base: ``twist``, ``twist-stamped`` or ``wheels``.
    autostart
        Whether it starts with the first joint states, and ends when it has followed its reference or was stopped.
    out, force
        A new folder that its motions are recorded to; with force it may hold an earlier run. None are if omitted.
    tracker
        Topic of what sees the end effector, whose poses are kept beside the recording; None if there is nothing.

    Attributes
    ----------
    following
        The configured controller; None before that.
    recorder
        What records its motions; None if nothing does.
    ended
        Whether it has nothing more to do.
    outcome
        What ended the last motion: ``duration``, ``interrupted``, or category and reason of its stop; empty before.
    """

    outcome: str
    ended: bool

    @destroyed_on_failure
    def __init__(
        self,
        spec: str | Path,
        *,
        name: str = "dqcontrol",
        source: str = "spec",
        interface: str = "velocity",
        base_interface: str = "twist",
        autostart: bool = False,
        out: Path | None = None,
        force: bool = False,
        tracker: str | None = None,
    ) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self._spec, self._source, self._autostart = spec, source, autostart
        self._interfaces = interface, base_interface
        self._out, self._force, self._tracker = out, force, tracker
        self.following: Following | None = None
        self.recorder: Recorder | None = None
        self.ended, self.outcome, self._is_retiring = False, "", False
        self._diagnostics = Diagnostics(self, self._condition)
        services: dict[str, Callable[[], None]] = {
            "configure": self.configure,
            "activate": lambda: self._configured().activate(),
            "deactivate": lambda: self._configured().control.deactivate(),
            "emergency_stop": lambda: self._configured().control.emergency_stop(),
            "reset": lambda: self._configured().control.reset(),
        }
        for service, act in services.items():
            self.create_service(Trigger, f"~/{service}", self._serving(service, act))
        if autostart:
            self.configure()
        else:
            self._diagnostics.tell("unconfigured: waits for the service ~/configure")

    @property
    def phase(self) -> Phase:
        """What it is doing."""
        return self.following.control.phase if self.following else Phase.UNCONFIGURED

    def configure(self) -> None:
        """Load the spec, declare its parameters and listen.

        Raises
        ------
        Error
            If that was done before, or something is wrong with the spec.
        """
        if self.following:
            raise Error("configure: was done before")
        loaded = load(self._spec)
        following = Following(
            self,
            loaded,
            self._source,
            self._interfaces,
            self._diagnostics,
            self._follow_up,
            self._start,
            self._tracker,
        )
        if self._out:
            following.recorder = self.recorder = Recorder(self._out, loaded, force=self._force)
        self.following = following
        self._diagnostics.tell(f"configured: {loaded.robot.name}, {loaded.period * 1e3:g} ms")

    def serve(self, interrupts: Interrupts, priority: int | None = None) -> None:
        """Work until there is no more to do; a first interrupt stops softly before it ends, a second one does not.

        Parameters
        ----------
        interrupts
            Of the process.
        priority
            Of real-time scheduling; see `middleware.spin`.
        """

        def look() -> None:
            if interrupts.count and not self._is_retiring:
                self.stop_and_exit()

        try:
            spin(self, is_over=lambda: self.ended or interrupts.count > 1, look=look, priority=priority)
        finally:
            self._hold()

    def stop_and_exit(self) -> None:
        """Stop softly, and end."""
        self._autostart, self.ended = False, self.phase not in (Phase.ACTIVE, Phase.STOPPING)
        self._is_retiring = True
        if self.phase is Phase.ACTIVE:
            self._configured().control.deactivate()
            self._follow_up(Phase.ACTIVE)

    def _hold(self) -> None:
        """Leave no robot moving, whatever ended the program."""
        if self.following:
            self.following.hold()
        is_broken_off = self.phase in (Phase.ACTIVE, Phase.STOPPING)
        if is_broken_off:
            self.outcome = "broken off while it moved"
        if self.recorder:
            self.recorder.end(self.phase, self.outcome)
        if is_broken_off:
            self._keep_last_seconds()

    def _keep_last_seconds(self) -> None:
        """Write what led to a stop, if motions are recorded."""
        if self.recorder:
            black_box, tell = self._configured().control.black_box, self.get_logger().info
            self.recorder.keep(black_box, f"halted: {self.outcome}", tell)

    def _configured(self) -> Following:
        if not self.following:
            raise Error("the controller is unconfigured; configure it first")
        return self.following

    def _serving(self, name: str, act: Callable[[], None]) -> Callable[..., Trigger.Response]:
        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            before = self.phase
            try:
                act()
                response.success, response.message = True, self.phase.value
            except Error as error:
                response.success, response.message = False, str(error)
                self._diagnostics.refuse(f"{name}: {str(error).removeprefix(f'{name}: ')}")
            if self.phase is not before:
                self._follow_up(before)
            return response

        return serve

    def _follow_up(self, before: Phase) -> None:
        """Report changes of the phase; exit if requested."""
        phase, control = self.phase, self._configured().control
        if phase is Phase.STOPPED:
            self.outcome = control.stop
            self._diagnostics.alarm(f"stopped: {control.stop}")
        else:
            if phase is Phase.INACTIVE and before is Phase.STOPPING:
                self.outcome = "interrupted" if self._is_retiring else "duration"
            following = self._configured()
            heard = f"{following.last_heard}, longest period {following.longest_period:.3f} s"
            words = [phase.value, *([control.reason] if control.reason else [])]
            self._diagnostics.tell(": ".join(words) + f"; {heard}" * (phase is Phase.STOPPING))
        self._configured().let_go()
        if self.recorder and phase in (Phase.INACTIVE, Phase.STOPPED):
            self.recorder.end(phase, self.outcome)
        if phase is Phase.STOPPED and control.is_commanding:  # else it had not moved
            self._keep_last_seconds()
        self.ended = (self._autostart or self._is_retiring) and phase in (Phase.INACTIVE, Phase.STOPPED)

    def _start(self) -> None:
        """Start if autostart is on."""
        if not self._autostart or self.outcome:
            return
        try:
            self._configured().activate()
        except Error as error:
            self._diagnostics.refuse(error)
        else:
            if self.phase is Phase.ACTIVE:  # else it has stopped at once, and said so
                self._follow_up(Phase.INACTIVE)

    def _condition(self) -> tuple[str, str, Mapping[str, object]]:
        if not self.following:
            return "ok", Phase.UNCONFIGURED.value, {}
        control = self.following.control
        values = {
            "robot": control.robot.name,
            "source": self._source,
            "interface": self._interfaces[0],
            **({"base interface": self._interfaces[1]} if self.following.loaded.parts.base else {}),
            "supervisor": control.reason or "no intervention",
            "stop category": _CATEGORIES[control.stop_category],
            "age of joint states [s]": f"{self.following.age:.4f}",
            "longest period [s]": f"{self.following.longest_period:.4f}",
        }
        level = _LEVELS.get(control.phase, "warning" if control.reason else "ok")
        return level, control.phase.value, values
