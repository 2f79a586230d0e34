"""Real time for the closed loop: absolute deadlines, and what became of them."""

from __future__ import annotations

import gc
import math
import os
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, RealTimeWarning, ValueRangeError, unknown_name

Overrun = Literal["catch up", "skip", "stop"]

_CATCH_UP = 1.1  # times as fast as real time after a delay: the end effector goes that much faster
_SPIN = 2e-4  # s before a deadline at which sleeping ends: operating systems wake a sleeper that much late


@dataclass(frozen=True)
class Timing:
    """When the steps of a loop began, and what they took.

    Attributes
    ----------
    period
        As set, s.
    begin
        Start of each step after the loop's, shape (N,), s.
    computation
        Of the law's command, shape (N,), s.
    idle
        Waited before each step, shape (N,), s.
    late
        Whether the work before took longer than the step's deadline, shape (N,).
    """

    period: float
    begin: Array
    computation: Array
    idle: Array
    late: NDArray[np.bool_]

    @property
    def periods(self) -> Array:
        """Measured periods, shape (N − 1,), s."""
        return np.diff(self.begin)

    @property
    def missed(self) -> int:
        """How many periods passed without a step."""
        return max(0, round((self.begin[-1] - self.begin[0]) / self.period) - len(self.begin) + 1)

    @property
    def overruns(self) -> int:
        """How many steps began late because of the work before them."""
        return int(self.late.sum())


class Clock:
    """Paces a loop in real time: step k begins k T after the first, so that delays never add up.

    A step whose deadline has passed is an overrun, and counted. It sleeps, and spins only through the last 0.2 ms.
    Garbage is collected before the loop, not within. This is as good as the operating system: nothing here is hard
    real time.

    Parameters
    ----------
    overrun
        What an overrun does. ``"catch up"``: the step begins at once, and the following ones, a tenth faster, until
        they keep their deadlines again. ``"skip"``: the periods that were missed are left out and all deadlines move by
        them (a step that is woken late is still followed by a period up to a tenth shorter). ``"stop"``: the loop ends.
    priority
        1 … 99: asks for real-time scheduling (SCHED_FIFO) while the loop runs; warns and runs without it if refused.
    now, sleep
        Time in s from any origin, and what waits for some s.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.Proportional(gain=5.0).prepare(arm, None, period=0.01)
    >>> plant = dqc.plants.Servo().start(arm, q, period=0.01, steps=20, seed=0)
    >>> samples = dqc.references.SetPoint(arm.fkm(q)).samples(0.01 * np.arange(20))
    >>> clock = dqc.loop.Clock()
    >>> trace = dqc.loop.close_loop(law, plant, samples, clock=clock)
    >>> bool(clock.timing.begin[-1] >= 0.19)
    True
    """

    def __init__(
        self,
        now: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
        *,
        overrun: Overrun = "catch up",
        priority: int | None = None,
    ) -> None:
        if overrun not in get_args(Overrun):
            raise unknown_name("clock.overrun", str(overrun), get_args(Overrun))
        if priority is not None and not 1 <= priority <= 99:
            raise ValueRangeError(f"clock.priority: must be 1 … 99, got {priority!r}")
        self._now, self._sleep, self._overrun, self._priority = now, sleep, overrun, priority
        self._period, self._origin, self._start, self._steps = 0.0, 0.0, 0.0, 0
        self.overran: str = ""
        self._ends_late = overrun == "stop"
        self._begin = self._computation = self._idle = np.empty(0)
        self._late = np.empty(0, dtype=bool)

    @contextmanager
    def running(self, period: float, steps: int) -> Iterator[None]:
        """Pace so many steps at most with a period (s), without garbage collection meanwhile."""
        # Filled, not only zero: the system gives memory when it is written, and is not asked within the loop.
        self._begin, self._computation, self._idle = (np.full(steps, 0.0) for _ in range(3))
        self._late, self._period, self._steps = np.full(steps, False), period, 0
        self.overran, self._ends_late = "", self._overrun == "stop"
        collecting = gc.isenabled()
        gc.collect()
        gc.disable()
        try:
            with real_time(self._priority) if self._priority else nullcontext():
                yield
        finally:
            if collecting:
                gc.enable()

    def await_step(self) -> bool:
        """Wait until the next step is due; return False if an overrun ends the loop."""
        k, ready = self._steps, self._now()
        if k == 0:
            self._origin = self._start = ready
        deadline, begin = self._origin + k * self._period, ready
        if k:  # no burst of steps makes up for a delay
            deadline = max(deadline, self._start + self._begin[k - 1] + self._period / _CATCH_UP)
        late = ready > deadline
        if late and self._ends_late:
            self.overran = f"the work of a period took {1e3 * (ready - deadline):.3g} ms too long"
            return False
        if late and self._overrun != "catch up":
            missed = math.ceil((ready - deadline) / self._period)
            self._origin += missed * self._period
            deadline += missed * self._period
        while begin < deadline:
            if deadline - begin > _SPIN:
                self._sleep(deadline - begin - _SPIN)
            begin = self._now()
        self._late[k] = late
        self._begin[k], self._idle[k] = begin - self._start, begin - ready
        self._steps = k + 1
        return True

    def go_on(self) -> None:
        """Leave overruns out from now on in this loop: a robot that is to come to rest does so in its own time."""
        self._ends_late = False

    @property
    def elapsed(self) -> float:
        """Time from the begin of the step before to that of this one, s; one period for the first."""
        k = self._steps - 1
        return float(self._begin[k] - self._begin[k - 1]) if k > 0 else self._period

    def commanded(self) -> None:
        """Note that the step's command is there."""
        k = self._steps - 1
        self._computation[k] = self._now() - self._start - self._begin[k]

    @property
    def timing(self) -> Timing:
        """What was measured in the last loop.

        Raises
        ------
        Error
            If there was none.
        """
        done = self._steps
        if not done:
            raise Error("clock: has paced no loop yet; pass it to close_loop first")
        measured = self._begin, self._computation, self._idle
        return Timing(self._period, *(each[:done] for each in measured), late=self._late[:done])


def threads_of_process() -> list[int]:
    """Return the numbers of this process's threads, as `real_time` takes them; where they are unknown, this one."""
    tasks = Path("/proc/self/task")
    return [int(task.name) for task in tasks.iterdir()] if tasks.is_dir() else [0]


def allows_real_time(priority: int) -> bool:
    """Tell whether this user may run at a priority of real-time scheduling."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RealTimeWarning)
        try:
            with real_time(priority):
                return True
        except RealTimeWarning:
            return False


@contextmanager
def real_time(priority: int, threads: Sequence[int] = (0,)) -> Iterator[None]:
    """Run threads under real-time scheduling (SCHED_FIFO) meanwhile; warn where that is refused.

    Parameters
    ----------
    priority
        1 … 99.
    threads
        Of this process, by number; this one if omitted. Those that they start are scheduled as others.
    """
    try:
        before = [(thread, os.sched_getscheduler(thread), os.sched_getparam(thread)) for thread in threads]
        for thread in threads:
            os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except (AttributeError, OSError) as error:
        warnings.warn(
            f"real-time scheduling with priority {priority} was refused "
            f"({getattr(error, 'strerror', None) or 'this system has none'}); the loop runs without it. "
            "On Linux allow it with 'ulimit -r 99', or run with the capability CAP_SYS_NICE",
            RealTimeWarning,
            stacklevel=4,
        )
        yield
        return
    try:
        yield
    finally:
        for thread, policy, parameters in before:
            with suppress(ProcessLookupError):  # it may have ended
                os.sched_setscheduler(thread, policy, parameters)
