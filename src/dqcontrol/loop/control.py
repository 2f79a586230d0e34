"""The closed loop as messages come and go: law and supervisor, and the states that a controller is in."""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.errors import DivergedError, Error, FallenError, ValueRangeError
from dqcontrol.loop.closed_loop import SampleSink
from dqcontrol.loop.supervision import BlackBox
from dqcontrol.loop.targets import JogTarget, Target
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots import Robot
from dqcontrol.supervisor import PreparedSupervisor, supervisor_layout as layout
from dqcontrol.supervisor.interventions import EMERGENCY, SOFT_STOP, stop_category
from dqcontrol.supervisor.supervisor_layout import END, GO, STOP

# Periods that the reference's time advances a step at most, if nobody says how long: it follows a step that is late by
# less than half a period, and waits for one that is missing.
FASTEST_REFERENCE = 1.5
_EARLY = 0.1  # periods by which a measurement may come before its time
_NOTHING: Array = np.zeros(0)


class Phase(Enum):
    """What a controller is doing."""

    UNCONFIGURED = "unconfigured"  # the spec is not loaded
    INACTIVE = "inactive"  # says nothing to the robot
    ACTIVE = "active"  # follows
    STOPPING = "stopping"  # brakes
    STOPPED = "stopped"  # holds the robot until it is reset


class Control:
    """A law, its target and the supervisor that all its commands go through.

    Parameters
    ----------
    law, target, supervisor
        Ready to run.
    longest_advance
        Of the reference's time in one step, s, however late that is; one and a half periods if omitted. Where it is
        more, the law is asked for all periods that it missed.
    leads_targets
        Whether the law sees the position command in place of the measured joints, of an arm that gives way: fed back,
        these would wind its springs up to the force of a stiff one. The supervisor watches the measured ones.

    Attributes
    ----------
    phase
        What it is doing.
    reason
        Why it stopped, or what the supervisor does now; empty while nothing is to be said.
    time
        Of the reference since the start, s: it advances by no more than `longest_advance` a step.
    black_box
        The last seconds of what was commanded and measured, also across stops.
    desired
        Last sample of the target, shape (21,).
    is_commanding
        Whether each step has a command for the robot.
    measured
        The last measured joints, shape (n,), rad or m.
    wanted, command
        What the law wants, and the inputs that leave, shape (m,), rad/s or m/s.
    """

    law: Controller
    target: Target
    supervisor: PreparedSupervisor
    wanted: Array
    command: Array
    phase: Phase
    reason: str
    time: float

    def __init__(
        self,
        law: Controller,
        target: Target,
        supervisor: PreparedSupervisor,
        longest_advance: float | None = None,
        *,
        leads_targets: bool = False,
    ) -> None:
        self.law, self.target, self.supervisor = law, target, supervisor
        self.longest_advance: float = longest_advance or FASTEST_REFERENCE * law.period
        self.robot: Robot = law.robot
        self._leads_targets = leads_targets
        self.phase, self.reason = Phase.INACTIVE, ""
        m = self.robot.input_size
        self.wanted, self.command = np.zeros(m), np.zeros(m)
        self.desired: Array = np.zeros(21)
        self.measured: Array = np.zeros(self.robot.configuration_size)
        self._request, self._cause = GO, ""
        self.time = self._stamp = self._asked = 0.0
        self._elapsed, self._still = law.period, 0.0
        self.black_box: BlackBox = BlackBox(self.robot, law.period)
        self._law_state = self._state = np.zeros(0)
        self.is_commanding: bool = False

    @property
    def stop_category(self) -> int | None:
        """Category (IEC 60204-1) of the stop that it is in; None while it is in none."""
        if self.phase not in (Phase.STOPPING, Phase.STOPPED):
            return None
        return self.supervisor.stop_category(self._state) if self.is_commanding else stop_category(EMERGENCY)

    @property
    def is_calm(self) -> bool:
        """Whether it follows, or stops softly: nothing is wrong."""
        fault = self._state[layout.FAULT] if self.is_commanding else 0.0
        return self.phase in (Phase.ACTIVE, Phase.STOPPING) and fault in (0.0, SOFT_STOP)

    @property
    def stop(self) -> str:
        """Category and reason of the stop that it is in, in words; empty while it is in none."""
        category = self.stop_category
        return "" if category is None else f"stop category {category}: {self.reason}"

    @property
    def position(self) -> Array:
        """The position command, shape (m,), rad or m."""
        return self.supervisor.position(self._state)

    @property
    def rate(self) -> Array:
        """The rate of the position command, shape (m,), rad/s or m/s."""
        return self.supervisor.rate(self._state)

    def activate(self, measured: Array) -> None:
        """Begin to follow from a robot at rest at measured joints, shape (n,), rad or m.

        Raises
        ------
        Error
            If it is not inactive.
        ValueRangeError
            If a joint is beyond its limits.
        """
        if self.phase is not Phase.INACTIVE:
            raise Error(f"activate: the controller is {self.phase.value}, not inactive")
        self._state = self.supervisor.start(measured)
        self._law_state = self.law.initial_state(measured)
        self.measured[:] = measured
        self.wanted[:], self.command[:], self._request, self._cause = 0.0, 0.0, GO, ""
        self.time = self._stamp = self._asked = self._still = 0.0
        self.desired = np.zeros(21)
        self.desired[POSE] = pose = self.robot.fkm(measured)
        self.target.start(pose)
        self.phase, self.reason, self.is_commanding = Phase.ACTIVE, "", True

    def deactivate(self) -> None:
        """Stop softly, then say no more.

        Raises
        ------
        Error
            If it is not active.
        """
        if self.phase is not Phase.ACTIVE:
            raise Error(f"deactivate: the controller is {self.phase.value}, not active")
        self._request, self.phase = END, Phase.STOPPING

    @property
    def contact_wrench(self) -> Array:
        """Moment and force on the end effector as the law's contact last heard them, task axes, shape (6,)."""
        return self.law.contact_wrench(self._law_state)

    def take_law(self, law: Controller) -> None:
        """Go on with another law for the same robot and period; its memory begins with the last measured joints.

        What contact remembers stays, so that gains of a compliant frame change without a jump.

        Raises
        ------
        ShapeError, ValueRangeError
            If what it keeps is not kept there; the present law goes on then.
        """
        self._law_state = law.go_on_from(self.measured, self.law, self._law_state)
        self.law = law

    def emergency_stop(self, cause: str = "") -> None:
        """Brake as hard as the supervisor may, and hold until `reset`; while inactive it refuses to start.

        Parameters
        ----------
        cause
            What else there is to say of it.
        """
        self._request, self._cause = STOP, cause
        if self.phase is Phase.INACTIVE:
            self.phase, self.reason = Phase.STOPPED, "emergency stop"
        elif self.phase is not Phase.STOPPED:
            self.phase = Phase.STOPPING

    def reset(self) -> None:
        """Be inactive after a stop.

        Raises
        ------
        Error
            If it is not stopped.
        """
        if self.phase is not Phase.STOPPED:
            raise Error(f"reset: the controller is {self.phase.value}, not stopped")
        self.phase, self.reason, self.is_commanding = Phase.INACTIVE, "", False

    def step(
        self,
        time: float,
        measured: Array | None,
        age: float,
        elapsed: float | None = None,
        effort: Array = _NOTHING,
        wrench: Array = _NOTHING,
    ) -> None:
        """Find the command of one period, while there is one to be found.

        Parameters
        ----------
        time
            Since the start, s, as the robot stamps it.
        measured
            Joints, shape (n,), rad or m; None if none came: the law is not asked then.
        age
            Of the last measurement, s.
        elapsed
            Since the last step on this computer's steady clock, s; as ``time`` says if omitted. The longer of the two
            counts: one that is longer than the supervisor's ``stale_after`` stops, and so does a time that goes back,
            or stands still for so long.
        effort, wrench
            Measured, as for `PreparedSupervisor.command`.
        """
        if not self.is_commanding:
            return
        # the first step is a period long
        passed = time - self._stamp if self._stamp or time else self.law.period
        self._still = self._still + self.law.period if time == self._stamp else 0.0
        self._stamp = time
        self.time += min(max(passed, 0.0), self.longest_advance) if time else 0.0
        self._elapsed = passed if elapsed is None or not passed >= 0.0 else max(passed, elapsed)
        if self.phase is Phase.ACTIVE and self.target.is_over(self.time):
            self.deactivate()
        if measured is not None:
            self.measured[:] = measured
            if self.law.wrench.size:  # one that is old is none
                self.law.wrench[:] = wrench if wrench.size else math.nan
            self._ask_law(self.time)
        request, self._request = self._request, GO
        given = self.measured, self.wanted, self._state, age, request, self.command
        at_rest = self.supervisor.step(*given, self._elapsed, effort, wrench, self._still)
        self.law.sent(self._law_state, self.command)
        code = self.supervisor.code(self._state)
        self.black_box.take(self._elapsed, self.desired, self.measured, self.measured, self.command, code)
        self._follow_supervisor(at_rest)

    def record(self, recording: SampleSink, time: float, q: Array) -> None:
        """Hand the last step over to a recording, and stop the robot if that cannot be written.

        Parameters
        ----------
        recording
            Of the motion.
        time
            Since the motion's start, s; increases from step to step.
        q
            True joints, shape (n,), rad or m.
        """
        sample = self.desired.copy()
        sample[TIME] = time
        recording.take(sample, q, self.measured, self.command, self.supervisor.code(self._state))
        if recording.failure and self.phase is Phase.ACTIVE:
            self.emergency_stop(recording.failure)

    def _ask_law(self, time: float) -> None:
        """Ask the law, once for each period since it was asked last: what it adds up, it adds up by periods."""
        most, missed = self.longest_advance / self.law.period, (time - self._asked) / self.law.period
        self._asked = time
        row = max(round(time / self.law.period), 0)
        seen = self.position if self._leads_targets else self.measured
        try:
            self.desired = self.target.sample(time, self.robot.fkm(seen))
            if isinstance(self.target, JogTarget):
                self.wanted[:] = self.target.rates(time)
                return
            for _ in range(max(int(min(missed, most) + _EARLY), 1)):
                self.law.step(seen, self.desired, row, self._law_state, self.wanted)
        except (DivergedError, FallenError, ValueRangeError):
            self.wanted[:] = math.nan  # the supervisor stops, and says why

    def _follow_supervisor(self, at_rest: bool) -> None:
        words = self.supervisor.reasons(self._state)
        if not self.supervisor.is_stopped(self._state):
            self.reason = ", ".join(words)
            return
        if self.phase in (Phase.ACTIVE, Phase.STOPPING):
            cause = [f"emergency stop: {self._cause}"] if self._cause else []
            self.reason, self.phase = ", ".join(cause or words), Phase.STOPPING
            if at_rest:
                self.is_commanding = self._state[layout.FAULT] != SOFT_STOP
                self.phase = Phase.STOPPED if self.is_commanding else Phase.INACTIVE


def warm_up(law: Controller, supervisor: PreparedSupervisor, start: Array, sample: Array) -> None:
    """Compile what a step needs, so that the first one is not late."""
    command = np.zeros(law.robot.input_size)
    law.step(start, sample, 0, law.initial_state(start), command)
    law.robot.fkm(start)
    supervisor.step(start, command, supervisor.start(start), 0.0, GO, command)


def reference_time(time: Array, longest_advance: float) -> Array:
    """Return how far along its reference a `Control` was at the recorded times of its steps (N,), s.

    The reference waits where steps are late, so it falls behind the stamps of a robot whose messages are.

    Examples
    --------
    >>> reference_time(np.array([0.0, 0.01, 0.02, 0.08, 0.09]), 0.015).round(3).tolist()
    [0.0, 0.01, 0.02, 0.035, 0.045]
    """
    return np.cumsum(np.minimum(np.diff(time, prepend=time[:1]), longest_advance))
