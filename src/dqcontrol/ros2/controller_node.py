"""The controller as a ROS 2 node: its states, services, diagnostics, and what it hears and sends meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from dqcontrol.arrays import Array
from dqcontrol.errors import Error
from dqcontrol.loop.control import Control, Phase, warm_up
from dqcontrol.loop.interrupts import Interrupts
from dqcontrol.loop.targets import LeaderTarget, PoseTarget, Speeds, Target, TwistTarget
from dqcontrol.references.sample import POSE
from dqcontrol.ros2 import interfaces, parameters
from dqcontrol.ros2.diagnostics import SILENCE, Diagnostics, PeriodMonitor
from dqcontrol.ros2.haptic_topics import POSE_TIMEOUT, HapticTopics, stiffness_borne
from dqcontrol.ros2.loading import Indices, Loaded, load
from dqcontrol.ros2.localisation import Localisation
from dqcontrol.ros2.messages import NANOSECONDS, Stamps, by_name, guarding, nanoseconds, pose_of, twist_of
from dqcontrol.ros2.middleware import destroyed_on_failure, spin, steady_timer
from dqcontrol.ros2.recorder import Recorder
from dqcontrol.ros2.servo_topics import ServoTopics
from dqcontrol.ros2.tracked_hand import TrackedHand
from dqcontrol.ros2.tuning import OVERRIDE, numbers_of, retune
from dqcontrol.ros2.world_topics import WorldTopics, WrenchInput

AnyTarget = TypeVar("AnyTarget", bound=Target)

_STEADY = 0.5  # s: while nodes find each other, messages come with gaps
_HEARTBEAT = 0.05  # s
_LEVELS = {Phase.STOPPED: "error", Phase.STOPPING: "warning"}
# IEC 60204-1
_CATEGORIES = {None: "none", 1: "1: at rest the power is to be removed", 2: "2: holds under power"}


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
    source, interfaces
        What it follows, and what it sends to joints and base.
    diagnostics
        What it says of itself.
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
        self.source: str = source
        self.interfaces: tuple[str, str] = (interface, base_interface)
        self._spec, self._autostart = spec, autostart
        self._out, self._force, self._tracker = out, force, tracker
        self.following: Following | None = None
        self.recorder: Recorder | None = None
        self.ended, self.outcome, self._is_retiring = False, "", False
        self.diagnostics: Diagnostics = Diagnostics(self, self._condition)
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
            self.diagnostics.tell("unconfigured: waits for the service ~/configure")

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
        following = Following(self, loaded, self._tracker)
        if self._out:
            following.recorder = self.recorder = Recorder(self._out, loaded, force=self._force)
        self.following = following
        self.diagnostics.tell(f"configured: {loaded.robot.name}, {loaded.period * 1e3:g} ms")

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
            self.follow_up(Phase.ACTIVE)

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
                self.diagnostics.refuse(f"{name}: {str(error).removeprefix(f'{name}: ')}")
            if self.phase is not before:
                self.follow_up(before)
            return response

        return serve

    def follow_up(self, before: Phase) -> None:
        """Report changes of the phase; exit if requested."""
        phase, control = self.phase, self._configured().control
        if phase is Phase.STOPPED:
            self.outcome = control.stop
            self.diagnostics.alarm(f"stopped: {control.stop}")
        else:
            if phase is Phase.INACTIVE and before is Phase.STOPPING:
                self.outcome = "interrupted" if self._is_retiring else "duration"
            following = self._configured()
            heard = f"{following.last_heard}, longest period {following.longest_period:.3f} s"
            words = [phase.value, *([control.reason] if control.reason else [])]
            self.diagnostics.tell(": ".join(words) + f"; {heard}" * (phase is Phase.STOPPING))
        self._configured().let_go()
        if self.recorder and phase in (Phase.INACTIVE, Phase.STOPPED):
            self.recorder.end(phase, self.outcome)
        if phase is Phase.STOPPED and control.is_commanding:  # else it had not moved
            self._keep_last_seconds()
        self.ended = (self._autostart or self._is_retiring) and phase in (Phase.INACTIVE, Phase.STOPPED)

    def start(self) -> None:
        """Start if autostart is on: called while inactive, once joint states have come steadily for half a second."""
        if not self._autostart or self.outcome:
            return
        try:
            self._configured().activate()
        except Error as error:
            self.diagnostics.refuse(error)
        else:
            if self.phase is Phase.ACTIVE:  # else it has stopped at once, and said so
                self.follow_up(Phase.INACTIVE)

    def _condition(self) -> tuple[str, str, Mapping[str, object]]:
        if not self.following:
            return "ok", Phase.UNCONFIGURED.value, {}
        control = self.following.control
        values = {
            "robot": control.robot.name,
            "source": self.source,
            "interface": self.interfaces[0],
            **({"base interface": self.interfaces[1]} if self.following.loaded.parts.base else {}),
            "supervisor": control.reason or "no intervention",
            "stop category": _CATEGORIES[control.stop_category],
            "age of joint states [s]": f"{self.following.age:.4f}",
            "longest period [s]": f"{self.following.longest_period:.4f}",
        }
        level = _LEVELS.get(control.phase, "warning" if control.reason else "ok")
        return level, control.phase.value, values


class Following:
    """A loaded spec that follows what its source says, with a robot behind topics.

    It takes a step for each joint states. A robot that tells them at a pace of its own, as its plant says, is another
    matter: then steps come by this computer's clock, once a control period, from the last joint states.

    Parameters
    ----------
    node
        Whose topics and parameters.
    loaded
        The spec.
    tracker
        Topic of what sees the end effector; None if its poses are not to be kept.

    Attributes
    ----------
    joint_names
        Of the joints, in messages, in the order of the robot's joints.
    control
        Law, supervisor and phase.
    longest_period
        Between two steps since the start, s.
    recorder
        What records its motions, if they are to be kept.
    tracked
        What keeps the poses of a tracker, if there is one.
    """

    loaded: Loaded
    target: Target
    tracked: TrackedHand | None
    _localisation: Localisation | None

    def __init__(self, node: ControllerNode, loaded: Loaded, tracker: str | None) -> None:
        source, (self._interface, base_interface) = node.source, node.interfaces
        diagnostics, guarded = node.diagnostics, guarding(node.diagnostics.refuse)
        self.recorder: Recorder | None = None
        self._node, self.loaded, self.target = node, loaded, loaded.target(source)
        law, supervisor = loaded.prepared_law(source), loaded.prepared_supervisor(self._interface)
        warm_up(law, supervisor, loaded.case.scene.start, loaded.case.scene.samples[0])
        self._impedance = loaded.impedance(self._interface)
        self._velocities = np.zeros(len(loaded.parts.joints))
        self.control: Control = Control(
            law, self.target, supervisor, loaded.longest_advance, leads_targets=self._impedance is not None
        )
        self._periods, self._stamps = PeriodMonitor(loaded.state_period), Stamps("joint states")
        self._latest: tuple[float, float] | None = None  # heard, stamp
        self._origin = self._passed = 0.0  # s, by stamps
        self._activated = self._stepped = self._steady_since = 0.0  # s, by our clock
        self._slept, self._due = False, np.inf
        self.longest_period: float = 0.0
        self._enabled = -np.inf
        self._parts, self._measured = loaded.parts, loaded.case.scene.start.copy()
        self.joint_names: list[str] = parameters.joint_names_read(node, self._parts.joint_names)
        frames = {"base": "odom" if self._parts.base else "base_link", "tool": "tool0"}
        self._base, self._tool = (
            parameters.read_once(node, f"{name}_frame", default, f"frame of the {name} in poses and twists")
            for name, default in frames.items()
        )
        footprint = odometry_frame = ""
        if self._parts.base:
            words = "base_link", "frame of the mobile base, in its commands"
            footprint = parameters.read_once(node, "footprint_frame", *words)
            words = self._base, "frame of odometry; if poses are in another one, the transform is heard"
            odometry_frame = parameters.read_once(node, "odometry_frame", *words)
        if source == "servo":
            self._servo = ServoTopics(node, self, guarded)
        self.tracked = TrackedHand(node, tracker, self._base, guarded) if tracker else None
        self._wrench_input = WrenchInput(node, self._parts, self.joint_names, self._tool, guarded)
        if (world := loaded.setting.spec.surroundings) is not None:
            self._world = WorldTopics(node, self.control, world, self._base, guarded)
        self._haptics: HapticTopics | None = None
        if isinstance(self.target, LeaderTarget):
            self._haptics = HapticTopics(node, loaded.law.contact, self.control, self.target, self._base)
            self._wrench_input.pass_on = self._haptics.hear
        self._wrench_input.listen(supervisor, self.control.law)
        own = numbers_of(loaded, source)
        parameters.declare(node, own)
        self._numbers = [one.name for one in own]
        parameters.declare_switch(
            node, OVERRIDE, "whether gains may be such that a loop is expected to be unstable"
        )
        parameters.refuse_unknown(node)
        self._retune(said := parameters.numbers_said(node, self._numbers))
        if self._haptics:
            borne = stiffness_borne(loaded, loaded.law, said)
            diagnostics.tell(f"leader and arm bear {borne:.3g} N/m")
        parameters.on_change(node, self._retune, diagnostics.refuse)
        ports, self._localisation = [], None
        if self.joint_names:
            ports.append(interfaces.joint_port(loaded, self._interface, self.joint_names, self._effort))
        if self._parts.base:
            ports.append(interfaces.base_port(self._parts, base_interface, node, footprint))
            self._localisation = Localisation(node, self, self._base, odometry_frame, guarded)
        self._commands = interfaces.Commands(node, ports)
        if self.joint_names:
            node.create_subscription(
                JointState, interfaces.JOINT_STATES, guarded(self._hear_joints), interfaces.NEWEST
            )
        # of what a step is taken for
        self._topic = node.resolve_topic_name(
            interfaces.JOINT_STATES if self.joint_names else interfaces.ODOMETRY
        )
        if isinstance(self.target, PoseTarget):
            node.create_subscription(PoseStamped, "~/pose", guarded(self.hear_pose), 1)
        if source == "twist":
            node.create_subscription(TwistStamped, "~/twist", guarded(self.hear_twist), 1)
        node.create_subscription(Bool, "~/enable", self._hear_enable, interfaces.NEWEST)
        self._heartbeat = node.create_publisher(Bool, "~/heartbeat", interfaces.SENT)
        steady_timer(node, _HEARTBEAT, self._beat)
        self._has_own_pace = loaded.state_period != loaded.period
        if self._has_own_pace:
            steady_timer(node, loaded.period, self._step_by_clock)
        self._alarm = steady_timer(node, self._patience, self._watch)  # each message puts it off

    def activate(self) -> None:
        """Start to follow.

        Raises
        ------
        Error
            If there are no joint states or no odometry, or the robot is not where the spec starts.
        """
        now = time.monotonic()
        if self._latest is None or self.age > self.loaded.stale_after:
            raise Error(f"activate: no {'joint states' if self.joint_names else 'odometry'} on {self._topic}")
        if self._localisation and (missing := self._localisation.silence):
            raise Error(f"activate: {missing}")
        if why_not := self._why_not():
            raise Error(f"activate: {why_not}")
        (heard, stamp), measured = self._latest, self._measured.copy()
        if self._wrench_input.age > self.loaded.stale_after:
            raise Error(
                f"activate: no wrench on {self._wrench_input.topic}, which the supervisor bounds or contact needs"
            )
        if self.tracked:
            self.tracked.check(stamp)
        if self._node.source == "spec":
            self._check_start(measured)
        try:
            self._commands.claim()
            if self.recorder and self.control.phase is Phase.INACTIVE:
                self.recorder.start()
            self.control.activate(measured)
        finally:
            self.let_go()
        if self.tracked:
            self.tracked.begin(stamp)
        self._periods.start(heard, stamp)
        self._origin, self._passed, self._stepped, self.longest_period = stamp, 0.0, now, 0.0
        self._activated = now
        self._step(0.0, measured, now)

    def aimed(self, kind: type[AnyTarget], make: Callable[[Speeds], AnyTarget]) -> AnyTarget:
        """Return the target if it is of a kind, else a new one, which begins where the desired pose is now."""
        if isinstance(self.target, kind):
            return self.target
        target = make(self.loaded.speeds)
        if self.control.phase is not Phase.INACTIVE:
            target.start(self.control.desired[POSE].copy(), self.control.time)
        self.target = self.control.target = target
        return target

    def let_go(self) -> None:
        """Leave the robot to others if it is not to be held; called whenever what is done has changed."""
        if not self.control.is_commanding:
            self._commands.release()

    def hold(self) -> None:
        """Tell the robot to stay where it was told to be, if it is still told: the last thing that a program does.

        An effort that stays does not do that, but silence: the robot then holds by its own means.
        """
        if self.control.is_commanding and self._impedance is None:
            self._send(np.zeros_like(self.control.rate))
        self._commands.release()

    @property
    def age(self) -> float:
        """Time since the last joint states, or odometry of a base alone, s."""
        return time.monotonic() - self._latest[0] if self._latest else np.inf

    @property
    def last_heard(self) -> str:
        """How long ago what was heard last, in words."""
        words = [f"last joint states {self.age:.3f} s ago"] if self.joint_names else []
        if self._localisation:
            words.append(f"last odometry {self._localisation.age:.3f} s ago")
        return ", ".join(words)

    @property
    def _brakes_early(self) -> bool:
        """Whether a step without a message brakes: that of a mobile base, which would roll on, if nobody lets it."""
        return self._parts.base is not None and self.loaded.supervisor.stale_after is None

    @property
    def _patience(self) -> float:
        """Time without a message after which a step is taken without one, s.

        If that step brakes, the supervisor stops if the next one is without, too; else as soon as the age is too much.
        """
        return self.loaded.rolling_time if self._brakes_early else SILENCE * self.loaded.period

    def _check_start(self, measured: Array) -> None:
        away = np.abs(measured - self.loaded.case.scene.start)
        i, allowed = int(away.argmax()), parameters.number(self._node, "start_tolerance")
        if away[i] > allowed:
            raise Error(
                f"activate: {self.loaded.robot.joint_names[i]} is at {measured[i]:.4g}, {away[i]:.3g} rad or m away "
                f"from where the spec starts; start_tolerance is {allowed:g}"
            )

    def _effort(self, measured: Array, position: Array, rate: Array) -> Array:
        """Return the torques of the impedance, N·m or N, shape (n,)."""
        assert self._impedance is not None
        return self._impedance.torque(measured, self._velocities, position, rate)

    def _send(self, rate: Array) -> None:
        """Send the position command, and a rate in the form of the spec's robot."""
        measured, parts = self.control.measured, self._parts
        position = parts.driven_positions(self.control.position)
        self._commands.send(position, parts.followed(measured, rate), measured)

    def _hear_joints(self, message: JointState) -> None:
        what, names, wanted = "joint states", message.name, self.joint_names
        joints = by_name(what, names, message.position, wanted)
        if self._impedance is not None:
            self._velocities = by_name(what, names, message.velocity, wanted, "velocities")
        self._wrench_input.hear_efforts(message)
        self._hear(time.monotonic(), nanoseconds(message.header.stamp), self._parts.joints, joints)

    def hear_odometry(self, now: float, at: int) -> None:
        """Take where the base is, heard now, s, and stamped at some ns."""
        assert self._localisation is not None
        place = self._localisation.pose
        if self.joint_names:
            self._measured[self._parts.place] = place
        else:
            self._hear(now, at, self._parts.place, place)

    def _hear(self, now: float, at: int, coordinates: Indices, values: Array) -> None:
        """Take a step for joint states, or odometry of a base alone, heard now and stamped at some ns."""
        if not self.control.is_commanding and self.age > self.loaded.stale_after:
            self._stamps.forget()  # the robot may have begun anew, with another clock
        stamp = self._stamps.check(at) / NANOSECONDS
        if self.age > self.loaded.stale_after:
            self._steady_since = now
        self._measured[coordinates] = values
        measured = self._measured.copy()
        self._latest, late = (now, stamp), self._has_slept(now)
        self._watch_in(self._patience)
        if not self.control.is_commanding:
            if self.control.phase is Phase.INACTIVE and now - self._steady_since > _STEADY:
                self._node.start()
        elif self._periods.hear(now, stamp) and not late and not self._has_own_pace:
            self._step(stamp - self._origin, measured, now)

    def hear_pose(self, message: PoseStamped) -> None:
        """Take the end effector to a pose, if poses are followed."""
        if not isinstance(self.target, PoseTarget):
            return
        try:
            self.target.ask(self.control.time, pose_of(message, self._base))
        except Error:  # it is none: the end effector stays where it is
            self.target.ask(self.control.time, np.full(8, np.nan))
            raise

    def hear_twist(self, message: TwistStamped) -> None:
        """Move the end effector on with a twist, if twists are followed."""
        if not isinstance(self.target, TwistTarget):
            return
        try:
            linear, angular, frame = twist_of(message, (self._base, self._tool))
        except Error:
            self.target.ask(self.control.time, np.zeros(3), np.zeros(3), of_hand=False)
            raise
        else:
            self.target.ask(self.control.time, linear, angular, of_hand=frame == self._tool)

    def _step_by_clock(self) -> None:
        """Take a step from the last joint states; the supervisor stops when these have become too old."""
        if self.control.is_commanding:
            now = time.monotonic()
            self._step(now - self._activated, self._measured.copy(), now)

    def _watch(self) -> None:
        """Go on without joint states: the supervisor stops when they stay away."""
        now, period = time.monotonic(), self.loaded.period
        late = self._has_slept(now)
        self._watch_in(0.5 * period if late else period)
        if self._has_own_pace:
            return
        if not late and self.control.is_commanding and self._periods.is_overdue(now):
            self._step(self._passed + period, None, now)

    def _has_slept(self, now: float) -> bool:
        """Return whether this process, not the robot, was silent: newer messages may wait. Not twice in a row."""
        self._slept = now - self._due > self.loaded.period and not self._slept
        return self._slept

    def _watch_in(self, seconds: float) -> None:
        """Watch when so much time has passed without joint states; executors are slow, so it is not done more often."""
        self._due = time.monotonic() + seconds
        self._alarm.timer_period_ns = round(seconds * NANOSECONDS)
        self._alarm.reset()

    def _step(self, passed: float, measured: Array | None, now: float) -> None:
        """Send one command, so long (s) after the start by the robot's clock, and now by ours.

        A message that comes after a step was taken without it may be stamped before that step.
        """
        control, before, gap = self.control, self.control.phase, now - self._stepped
        self.longest_period = max(self.longest_period, gap)
        if control.phase is Phase.ACTIVE and (cause := self._why_not()):
            control.emergency_stop(cause)
        self._passed, self._stepped = max(passed, self._passed), now
        age, inputs = max(self._periods.age(now), self._wrench_input.wrench_age), self._wrench_input
        is_late = self._brakes_early and self.age >= 0.99 * self._patience
        if is_late or (self._localisation and self._localisation.silence):
            age = np.inf
        if self._haptics and inputs.age > self.loaded.stale_after:
            self._haptics.let_go()
        control.step(self._passed, measured, age, gap, inputs.effort, inputs.wrench)
        # no effort by joints that nobody saw, nor after a fault: the springs may be what is wrong
        if self._impedance is None or (measured is not None and control.is_calm):
            self._send(control.rate)
        if self.recorder:
            self.recorder.take(control, self._passed)
        if control.phase is not before:
            self._node.follow_up(before)

    def _why_not(self) -> str:
        """Say why the robot may not move, beside what the supervisor sees."""
        if rivals := self._commands.rivals:
            return f"{rivals}; a robot obeys one at a time"
        for topic in {self._topic, *([self._localisation.topic] if self._localisation else [])}:
            if several := interfaces.several_publish(self._node, topic):
                return several
        patience = parameters.number(self._node, "enable_timeout")
        if patience and time.monotonic() - self._enabled > patience:
            return "not enabled"
        return ""

    def _hear_enable(self, message: Bool) -> None:
        self._enabled = time.monotonic() if message.data else -np.inf

    def _beat(self) -> None:
        """Say whether the robot needs its power: while this lives, and the robot moves or brakes under control."""
        self._heartbeat.publish(Bool(data=self.control.phase in (Phase.ACTIVE, Phase.STOPPING)))

    def _retune(self, numbers: dict[str, float]) -> None:
        active = self.control.phase is not Phase.INACTIVE
        allow = self._node.get_parameter(OVERRIDE).value
        said = {**parameters.numbers_said(self._node, self._numbers), **numbers}
        leader = said if self._haptics else None
        law, supervisor, unjudged = retune(
            self.loaded, numbers, active=active, allow_unstable=bool(allow), leader=leader
        )
        if unjudged:
            self._node.get_logger().warning(f"law: {unjudged}")
        if law:
            self.control.law = self.loaded.prepared_law(self._node.source)
        if supervisor:
            self.control.supervisor = self.loaded.prepared_supervisor(self._interface)
            self.control.longest_advance = self.loaded.longest_advance
            self._wrench_input.listen(self.control.supervisor, self.control.law)
        if isinstance(self.target, TwistTarget):
            self.target.timeout = said["twist_timeout"]
        if isinstance(self.target, PoseTarget):
            forever = POSE_TIMEOUT if self._haptics else np.inf
            self.target.timeout = said["pose_timeout"] or forever
