"""A supervisor in the loop: its state over a run, what it did, and who is told."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.plants.plant import PlantProtocol, running_plant
from dqcontrol.references.sample import TIME
from dqcontrol.robots.robot import Robot
from dqcontrol.supervisor import PreparedSupervisor, supervisor_layout as layout
from dqcontrol.supervisor.interventions import (
    COMMAND,
    INTERVENTIONS,
    SOFT_STOP,
    describe_stop,
    reasons,
)
from dqcontrol.supervisor.supervisor_layout import END, FINISH, GO, STOP

SECONDS = 20.0  # before a stop: what led to it, and not more than a person looks at
_MOST_ROWS = 20_000  # 20 s at 1 kHz


class BlackBox:
    """A ring of the last samples; it takes its memory once.

    Parameters
    ----------
    robot
        Whose motion it keeps.
    period
        Of the loop, s.
    seconds
        How far back it remembers, s; 20 000 samples at most.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> box = BlackBox(dqc.load_robot("iiwa7"), period=0.01)
    >>> for k in range(3000):
    ...     box.take(0.01, np.zeros(21), np.zeros(7), np.zeros(7), np.zeros(7), 0)
    >>> len(box), round(float(box.record("tracking error too large").time[0]), 9)
    (2000, 10.0)
    """

    def __init__(self, robot: Robot, period: float, seconds: float = SECONDS) -> None:
        self._robot = robot
        rows = max(min(math.ceil(seconds / period - 1e-9), _MOST_ROWS), 1)
        n, m = robot.configuration_size, robot.input_size
        self._desired, self._codes = np.zeros((rows, 21)), np.zeros((rows, 1))
        self._q, self._measured, self._command = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, m))
        self._count, self._time = 0, 0.0

    def __len__(self) -> int:
        return min(self._count, len(self._desired))

    def take(
        self, elapsed: float, desired: Array, q: Array, measured: Array, command: Array, code: float
    ) -> None:
        """Keep one sample, and forget the oldest.

        Parameters
        ----------
        elapsed
            Since the last sample, s.
        desired
            Sample of the reference, shape (21,).
        q, measured
            True (or again measured) and measured configuration, shape (n,), rad or m.
        command
            Inputs that left, shape (m,), rad/s or m/s.
        code
            Of what the supervisor did.
        """
        k = self._count % len(self._desired)
        if self._count:
            self._time += elapsed if 0.0 < elapsed < math.inf else 1e-9
        self._desired[k], self._q[k], self._measured[k], self._command[k] = desired, q, measured, command
        self._desired[k, TIME], self._codes[k, 0] = self._time, code
        self._count += 1

    def record(self, stopped: str) -> Record:
        """Return what is kept, in the order of time, as a record that ended for a reason.

        Raises
        ------
        Error
            If nothing is kept yet.
        """
        if not self._count:
            raise Error("black box: holds no samples yet")
        order = np.arange(self._count - len(self), self._count) % len(self._desired)
        q, desired = self._q[order], self._desired[order]
        # what an encoder said before it stopped the robot may be anything
        finite = np.isfinite(q).all(axis=1)
        pose = np.full((len(q), 8), np.nan)
        pose[finite] = self._robot.fkm(q[finite])
        return Record(
            desired[:, TIME],
            q,
            self._measured[order],
            self._command[order],
            pose,
            desired,
            self._robot.joint_names,
            self._robot.input_names,
            stopped=stopped,
            readings={INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), self._codes[order])},
        )


Watch = Callable[[float, tuple[str, ...]], None]

_NOTHING: Array = np.zeros(0)
_MOST_STEPS = 100_000  # of coming to rest


class Senses:
    """What a plant measures beside its joints, as far as it does, in the form that supervisors take it.

    Raises
    ------
    ValueRangeError
        If the supervisor bounds what the plant does not measure.
    """

    def __init__(self, plant: PlantProtocol, supervisor: PreparedSupervisor) -> None:
        self._plant = running_plant(plant)
        bounds = supervisor.bounds
        for field, limit, what, measured in (
            ("effort", bounds.effort.min(initial=np.inf), "effort", self.effort),
            ("contact_effort", bounds.head[layout.CONTACT_EFFORT], "effort", self.effort),
            ("contact_force", bounds.head[layout.CONTACT_FORCE], "wrench", self.wrench),
            ("contact_torque", bounds.head[layout.CONTACT_TORQUE], "wrench", self.wrench),
        ):
            if np.isfinite(limit) and not measured.size:
                raise ValueRangeError(
                    f"supervisor.{field}: {type(plant).__name__} measures no {what}; it may have none here"
                )

    @property
    def age(self) -> float:
        """Age of the measurement, s; 0 if the plant does not report it."""
        return self._plant.age

    @property
    def effort(self) -> Array:
        """Measured, shape (m,); empty if it is not."""
        return np.ascontiguousarray(self._plant.effort, dtype=np.float64)

    @property
    def wrench(self) -> Array:
        """Measured at the end effector, shape (6,); empty if it is not."""
        return np.ascontiguousarray(self._plant.wrench, dtype=np.float64)


def most_steps_to_rest(supervisor: PreparedSupervisor) -> int:
    """Return how many periods braking may take; no more are waited for."""
    bounds = supervisor.bounds
    braking = (bounds.velocity / (bounds.acceleration * supervisor.period)).max(initial=0.0)
    return int(min(braking + bounds.head[layout.WINDOW] + 10.0, _MOST_STEPS))


class Supervision:
    """A supervisor over the samples of one run.

    Parameters
    ----------
    supervisor
        From `Supervisor.prepare`.
    q
        Where the robot rests, shape (n,), rad or m.
    watch
        Called with time (s) and reasons whenever these change; in the interpreted loop only.
    black_box
        What keeps the last seconds of the interpreted loop; an own one if omitted.
    """

    def __init__(
        self,
        supervisor: PreparedSupervisor,
        q: ArrayLike,
        watch: Watch | None = None,
        black_box: BlackBox | None = None,
    ) -> None:
        self.supervisor = supervisor
        self.state: Array = supervisor.start(q)
        self.request: int = GO
        self.codes: Array = np.zeros(0)
        self.period: float = supervisor.period
        self.black_box: BlackBox = BlackBox(supervisor.robot, self.period) if black_box is None else black_box
        self._watch = watch

    def begin(self, count: int) -> None:
        """Make room for so many samples."""
        self.codes = np.zeros(count)

    def step(
        self,
        k: int,
        time: float,
        measured: Array,
        command: Array,
        senses: Senses | None = None,
        elapsed: float | None = None,
    ) -> bool:
        """Replace the command of sample k by what leaves; return whether the robot is stopped and at rest."""
        age = senses.age if senses else 0.0
        sensed = (senses.effort, senses.wrench) if senses else (_NOTHING, _NOTHING)
        asked = measured, command, self.state, age, self.request, command
        halted = self.supervisor.step(*asked, elapsed, *sensed)
        self.codes[k] = code = self.supervisor.code(self.state)
        if self._watch and code != (self.codes[k - 1] if k else 0):
            self._watch(time, reasons(code))
        return halted

    def end(self) -> None:
        """Ask for a soft stop, unless another stop was asked for; interrupts may call it."""
        if self.request == GO:
            self.request = END

    def finish(self) -> None:
        """Ask to brake because what was to be followed is over, unless a stop was asked for."""
        if self.request in (GO, END):
            self.request = FINISH

    def stop(self) -> None:
        """Ask to brake as hard as the supervisor may."""
        self.request = STOP

    @property
    def stopped_softly(self) -> bool:
        """Whether it is stopped because it was asked to end, and for nothing else."""
        return int(self.state[layout.FAULT]) == SOFT_STOP

    @property
    def missed_command(self) -> bool:
        """Whether it is stopped because the law had no command."""
        return bool(int(self.state[layout.FAULT]) & COMMAND)

    @property
    def is_stopped(self) -> bool:
        """Whether it is stopping or stopped."""
        return self.supervisor.is_stopped(self.state)

    def why(self, count: int) -> str:
        """Say in which category and why it is stopped after so many samples."""
        return describe_stop(self.codes[count - 1])

    def signals(self, count: int) -> dict[str, Signal]:
        """Return what it did at the first samples, as a quantity of the recording."""
        return {INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), self.codes[:count, None])}
