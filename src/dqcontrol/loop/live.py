"""A robot that follows what it is told now: by a program, a page in a browser, keys, or any other device."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.controller import Controller, PreparedTasks
from dqcontrol.errors import FallenError, ShapeError, as_array, as_positive
from dqcontrol.laws.law import Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop.closed_loop import SampleSink
from dqcontrol.loop.control import Control, Phase, warm_up
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.replanning import refuse_replanning
from dqcontrol.loop.supervision import BlackBox, Senses
from dqcontrol.loop.targets import PoseTarget, SampledTarget, Speeds, Target, TwistTarget
from dqcontrol.plants.plant import (
    Plant,
    PlantProtocol,
    RunningPlant,
    command_mode,
    lagging_mode,
    limits_before,
    running_plant,
)
from dqcontrol.references.previewed import Previewed
from dqcontrol.references.reference import Reference
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TIME
from dqcontrol.robots import Robot, most_dexterous
from dqcontrol.robots.robot import AT_ONCE, CommandMode, Lag
from dqcontrol.supervisor import Supervisor

AnyTarget = TypeVar("AnyTarget", bound=Target)

NOISE = 100_000  # steps for which a plant's noise is drawn; then it repeats
TWIST_HELD = 0.15  # s that a twist lasts: keys held down repeat sooner
_MOST_BRAKING_STEPS = 100_000  # 100 s at 1 kHz; against a robot that never rests


@dataclass(frozen=True, eq=False)
class LiveState:
    """What a robot does at a moment; arrays are copies.

    Attributes
    ----------
    time
        Of that period since the robot was last activated, s.
    q, measured
        True and measured configuration, shape (n,), rad or m.
    command
        The inputs that left last, shape (m,), rad/s or m/s.
    share
        The largest of them as a share of its velocity limit.
    pose, desired
        Of the end effector, and where the moving target is, shape (8,), inertial frame.
    position_error, orientation_error
        From the end effector to the moving target, m and rad.
    missing
        From the end effector to the pose asked for, m; the farthest of law and further tasks; NaN if none is.
    condition
        What it does, and what the supervisor does about it, in words.
    """

    time: float
    q: Array
    measured: Array
    command: Array
    share: float
    pose: Array
    desired: Array
    position_error: float
    orientation_error: float
    missing: float
    condition: str


class Live:
    """A closed loop that is stepped for as long as one likes: a law drives a plant to what it is told meanwhile.

    What it is told moves a target within bounds (``Speeds``), and a supervisor stands between law and plant: whatever
    it is told, joints keep their limits of position, velocity and acceleration. A pose that is not finite is none, and
    the end effector stays where it is then. The robot is simulated, or a real one behind a plant of one's own.

    Parameters
    ----------
    robot
        An arm or a whole body.
    law
        What commands.
    plant
        What moves: a kind of plant; or one at work, at rest, as `close_loop` takes it.
    period
        T, control period, s.
    start
        Configuration, shape (n,), rad or m; that of a plant at work, or the most dexterous one if omitted.
    limits
        What is done to commands before the supervisor; see `dqcontrol.plants.limits_before`.
    supervisor
        Between law and plant; one with default parameters if omitted.
    speeds
        How fast the target moves.
    tasks
        What two arms or another tree are to do beside the law's task.
    seed
        Of the plant's noise.

    Attributes
    ----------
    control
        Law, target and supervisor, and the phase they are in.
    plant
        At work.
    speeds
        As given; may be changed.
    lag
        How late its joints follow.
    pushed
        Force and torque on the end effector beside what the plant's sensor measures, its axes, shape (6,), N and N·m:
        of a hand in simulation, or what a follower feels; for a law with contact. None: there is nothing.
    recording
        Gets every step, if there is one; when it cannot be written the robot stops.
    spec
        Text of the experiment that it was made from, kept with its black box.

    Raises
    ------
    Error
        If something does not fit, or a joint is beyond its limits.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> law, plant = dqc.laws.ProportionalFeedforward(gain=5.0), dqc.plants.Servo()
    >>> live = dqc.loop.Live(arm, law, plant, period=0.01, start=[0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> live.target = dqc.algebra.multiply(dqc.algebra.pose([1, 0, 0, 0], [0, 0, 0.05]), live.state.pose)  # 5 cm up
    >>> for _ in range(300):
    ...     live.step()
    >>> bool(live.state.missing < 1e-4)
    True
    >>> live.target = np.full(8, np.nan)  # a device that sees nothing: the end effector stays
    """

    def __init__(
        self,
        robot: Robot,
        law: Law,
        plant: Plant | PlantProtocol,
        period: float,
        *,
        start: ArrayLike | None = None,
        limits: CommandLimits | None = None,
        supervisor: Supervisor | None = None,
        speeds: Speeds | None = None,
        tasks: PreparedTasks | None = None,
        seed: int = 0,
    ) -> None:
        period = as_positive("period", period)
        at_work = None if isinstance(plant, Plant) else running_plant(plant)
        if start is None:
            start = most_dexterous(robot) if at_work is None else at_work.measured
        start = as_array("start", start, (robot.configuration_size,)).copy()
        kind = plant if isinstance(plant, Plant) else None
        self._mode: CommandMode = lagging_mode(kind) if kind else "measured"
        self.lag: Lag = kind.lag(robot) if kind else AT_ONCE
        self._limits = limits_before(kind, limits, robot) if kind else limits or CommandLimits()
        mode = command_mode(kind) if kind else "integrated"
        guard = (supervisor or Supervisor()).prepare(robot, period, mode)
        self._reference: Reference | None = None
        self._tasks = tasks
        self._aims: dict[int, PoseTarget] = {}  # of further tasks, by their numbers
        controller = self._prepared(law, robot, period)
        sample = np.zeros(SAMPLE_SIZE)
        sample[POSE] = robot.fkm(start)
        warm_up(controller, guard, start, sample)
        moved = at_work if kind is None else running_plant(kind.start(robot, start, period, NOISE, seed))
        assert moved is not None
        self.plant: RunningPlant = moved
        self.law: Law = law
        self.speeds: Speeds = speeds or Speeds()
        self.control: Control = Control(controller, PoseTarget(self.speeds), guard)
        self.control.activate(self.plant.measured.copy())
        self._senses = Senses(moved, guard)
        self._q: Array = self.plant.q.copy()
        self._time, self._done, self._begun, self._ending = 0.0, 0, 0, False
        self.pushed: Array | None = None
        self.recording: SampleSink | None = None
        self.spec = self._fallen = ""

    def _prepared(self, law: Law, robot: Robot, period: float) -> Controller:
        if not isinstance(law, Law):
            raise ShapeError(f"law: expected a Law, got {law!r:.80}")
        made = law.prepare(robot, self._reference, period, self._limits, self._mode, self._tasks, self.lag)
        refuse_replanning(made, self._reference, "which nothing does under a person's hand")
        return made

    @property
    def robot(self) -> Robot:
        """Which is driven."""
        return self.control.robot

    @property
    def period(self) -> float:
        """Control period of `step`, s."""
        return self.control.law.period

    @property
    def target(self) -> Array | None:
        """The pose asked for, shape (8,); None if none is. Set, the target moves there; NaN: the end effector stays.

        Raises
        ------
        ShapeError, ValueRangeError
            If it is set to what is no unit dual quaternion; nothing changes then.
        """
        target = self.control.target
        goal = target.goal if isinstance(target, PoseTarget) else None
        return goal.copy() if goal is not None and np.isfinite(goal).all() else None

    @target.setter
    def target(self, pose: ArrayLike) -> None:
        goal = _one_pose("target", pose)
        target = self.control.target
        if not isinstance(target, PoseTarget):
            target = self._aim(PoseTarget(self.speeds))
        target.goal = goal

    def aim(self, number: int, pose: ArrayLike) -> None:
        """Take a further task to a pose (8,), as ``target`` does the law's, at the same speeds; NaN: it stays.

        Parameters
        ----------
        number
            Of the task, as in ``tasks``, from 0; a posture or a centre of mass has no pose.
        pose
            Unit dual quaternion, in the frame that the task is given in.

        Raises
        ------
        ShapeError, ValueRangeError
            If there is no such task, or it is no unit dual quaternion; nothing changes then.
        """
        goal = _one_pose("pose", pose)
        samples = self.control.law.task_samples(number)
        if number not in self._aims:
            self._aims[number] = target = PoseTarget(self.speeds)
            target.start(samples[min(self._row, len(samples) - 1), POSE].copy(), self.control.time)
        self._aims[number].goal = goal

    def aimed(self, number: int) -> Array:
        """Return where a further task is to be now, shape (8,)."""
        samples = self.control.law.task_samples(number)
        pose: Array = samples[min(self._row, len(samples) - 1), POSE].copy()
        return pose

    def hold(self) -> None:
        """Stay: the end effector comes to rest where it is then, and so does what further tasks move."""
        self.target = np.full(8, np.nan)
        for target in self._aims.values():
            target.goal = np.full(8, np.nan)

    def move(self, linear: Array, angular: Array, *, of_hand: bool = False) -> None:
        """Move on with these velocities (3,), m/s and rad/s, in the axes of the base or the end effector, for 0.15 s.

        Velocities that are not finite are none.
        """
        target = self.control.target
        if not isinstance(target, TwistTarget):
            target = self._aim(TwistTarget(self.speeds, timeout=TWIST_HELD))
        target.ask(self.control.time, linear, angular, of_hand=of_hand)

    def follow(self, reference: Reference) -> None:
        """Follow a reference from now on, and stay at its end. As in runs, twists lead by what the joints are late."""
        if not np.isfinite(reference.duration):
            self.target = reference.samples([0.0])[0, POSE]
            return
        times, delays = self.lag.mean
        if self.law.lag_at and times + delays and not isinstance(reference, Previewed):
            reference = Previewed(reference, delays + self.period / 2, times, self.period)
        count = round(reference.duration / self.period) + 1
        samples = reference.samples(self.period * np.arange(count, dtype=np.float64)).copy()
        samples[:, TIME] += self.control.time
        self._reference = reference
        self.set_law(self.law)  # what it makes of twists depends on how they lead
        self._aim(SampledTarget(samples, self.period))

    def _aim(self, target: AnyTarget) -> AnyTarget:
        target.start(self.control.desired[POSE].copy(), self.control.time)
        self.control.target = target
        return target

    def set_law(self, law: Law) -> None:
        """Go on with another law, or the same one with other parameters; its memory begins anew.

        But where the compliant frame of its `contact` is stays, while M, D, K and the wanted force change.

        Raises
        ------
        Error
            If it does not fit; the present one goes on then.
        """
        self.control.take_law(self._prepared(law, self.robot, self.period))
        self.law = law
        self._move_aims()

    @property
    def state(self) -> LiveState:
        """What it did in the last period, as a row of a `Record` has it: q, pose and target are those of its begin."""
        control = self.control
        pose, desired = self.robot.fkm(self._q), control.desired[POSE].copy()
        error = algebra.multiply(algebra.conjugate(pose), desired)
        shares = np.abs(control.command) / control.supervisor.bounds.velocity
        return LiveState(
            time=self._time,
            q=self._q.copy(),
            measured=control.measured.copy(),
            command=control.command.copy(),
            share=float(shares.max(initial=0.0)),
            pose=pose,
            desired=desired,
            position_error=float(np.linalg.norm(algebra.translation(error))),
            orientation_error=float(2 * np.arctan2(np.linalg.norm(error[1:4]), abs(error[0]))),
            missing=self._missing(pose),
            condition=self.condition,
        )

    def _missing(self, pose: Array) -> float:
        """Return how far the farthest of law and further tasks is from its pose asked for, m; NaN if none is."""
        told = [(self._task_pose(i, self._q), target.goal) for i, target in self._aims.items()]
        ways = [
            np.linalg.norm(algebra.translation(goal) - algebra.translation(own))
            for own, goal in ((pose, self.target), *told)
            if goal is not None and np.isfinite(goal).all()
        ]
        return float(np.fmax.reduce(ways, initial=np.nan))

    def _task_pose(self, number: int, q: Array) -> Array:
        assert self._tasks is not None
        task = self._tasks.tasks[number]
        assert task is not None
        return self._tasks.robot.pose_of(task, q)

    @property
    def _row(self) -> int:
        """Number of the present sample."""
        return max(round(self.control.time / self.period), 0)

    def _move_aims(self) -> None:
        """Write where further tasks that were told a pose are to be now."""
        for i, target in self._aims.items():
            pose = self._task_pose(i, self.control.measured)
            self.control.law.task_samples(i)[:] = target.sample(self.control.time, pose)

    @property
    def reason(self) -> str:
        """What the supervisor does, or why the robot stopped."""
        return self.control.reason

    @property
    def condition(self) -> str:
        """What it does, and what the supervisor does about it."""
        words = [self.control.phase.value, self.control.reason, self._fault]
        return ": ".join(word for word in words if word)

    @property
    def ended(self) -> bool:
        """Whether the robot has come to rest after `end`."""
        return not self.control.is_commanding

    @property
    def is_stopped(self) -> bool:
        """Whether it was stopped, and holds until `resume`."""
        return self.control.phase is Phase.STOPPED

    @property
    def black_box(self) -> BlackBox:
        """Its last seconds."""
        return self.control.black_box

    def stop(self) -> None:
        """Brake as hard as the supervisor may, and hold until `resume`."""
        self.control.emergency_stop()

    def resume(self) -> None:
        """Go on after a stop, at rest where the robot is.

        Raises
        ------
        Error
            If it is not stopped, or a joint is beyond its limits.
        """
        self.control.reset()
        self.control.activate(self.plant.measured.copy())
        for i, target in self._aims.items():
            target.start(self._task_pose(i, self.control.measured))
        self._time, self._begun = 0.0, self._done

    def end(self) -> None:
        """Stop softly, and be `ended` then; interrupts may call it."""
        self._ending = True

    def step(self, elapsed: float | None = None) -> None:
        """Move for one period; ``elapsed`` s after the last step, a period if omitted.

        A plant that raises is braked first, as far as it still takes commands.
        """
        try:
            self._step(elapsed)
        except BaseException:
            with first_interrupt(self.control.emergency_stop):
                self.brake()
            raise

    def brake(self) -> None:
        """Stop as hard as the supervisor may, one step after the other, whatever the plant raises."""
        self.control.emergency_stop()
        for _ in range(_MOST_BRAKING_STEPS):
            if self.control.phase is Phase.STOPPED or not self.control.is_commanding:
                return
            time.sleep(self.period)
            with suppress(Exception):
                self._step(None)

    def _step(self, elapsed: float | None) -> None:
        plant, control, senses = self.plant, self.control, self._senses
        if self._ending and control.phase is Phase.ACTIVE:
            control.deactivate()
        elif self._ending and control.phase is Phase.STOPPED:
            control.reset()
        if self._fault and control.phase is Phase.ACTIVE:
            control.emergency_stop()
        if isinstance(control.target, SampledTarget) and control.target.is_over(control.time + self.period):
            self._aim(PoseTarget(self.speeds))
        self._q[:] = plant.q
        self._time = (self._done - self._begun) * self.period  # sums of periods drift
        self._move_aims()
        wrench = senses.wrench
        if self.pushed is not None:
            wrench = wrench + self.pushed if wrench.size else self.pushed
        control.step(self._time, plant.measured.copy(), senses.age, elapsed, senses.effort, wrench)
        if self.recording is not None:
            control.record(self.recording, self._done * self.period, plant.q)
        self._done += 1
        if self._done % NOISE == 0:
            plant.rewind()
        try:
            plant.step(control.command)
        except FallenError as error:  # it lies there, and may be looked at
            self._fallen = str(error)

    @property
    def _fault(self) -> str:
        return self._fallen or self.plant.fault


def _one_pose(field: str, pose: ArrayLike) -> Array:
    """Return a unit dual quaternion, shape (8,), or one that is no pose as it is not finite; raise of anything else."""
    try:
        goal = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError(f"{field}: expected one pose, shape (8,), got {pose!r:.80}") from None
    if goal.shape != (8,) or np.isfinite(goal).all():
        goal = algebra.as_unit(field, goal)
        if goal.shape != (8,):
            raise ShapeError(f"{field}: expected one pose, shape (8,), got {goal.shape}")
    return goal


class Pace:
    """When the steps of a loop without end are due: those that are late are counted, and none is caught up.

    Parameters
    ----------
    period
        s.
    now
        Time in s from any origin.

    Attributes
    ----------
    deadline
        Of the next step, on that clock.
    missed
        How many periods passed without a step.

    Examples
    --------
    >>> clock = iter([0.0, 0.004, 0.035]).__next__
    >>> pace = Pace(0.01, clock)
    >>> pace.done(), pace.done()  # in time; then 15 ms after the deadline
    (0.006, 0.0)
    >>> pace.missed, pace.deadline
    (1, 0.035)
    """

    def __init__(self, period: float, now: Callable[[], float] = time.monotonic) -> None:
        self.period, self._now = period, now
        self.deadline: float = now()
        self.missed: int = 0

    def done(self) -> float:
        """Note that a step is done; return the time until the next one is due, s."""
        now = self._now()
        self.deadline += self.period
        if now > self.deadline:
            self.missed += int((now - self.deadline) / self.period)
            self.deadline = now
        return self.deadline - now
