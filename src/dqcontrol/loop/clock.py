"""Real time for the closed loop: absolute deadlines, and what became of them."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import Error

Array = NDArray[np.float64]

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
    def overruns(self) -> int:
        """How many steps began late because of the work before them."""
        return int(self.late.sum())


class Clock:
    """Paces a loop in real time: step k begins k T after the first, so that delays never add up.

    A step whose deadline has passed begins at once and is counted as an overrun; the deadlines of the following ones
    stay where they are. It sleeps, and spins only through the last 0.2 ms. Garbage is collected before the loop, not
    within. This is as good as the operating system: nothing here is hard real time.

    Parameters
    ----------
    now, sleep
        Time in s from any origin, and what waits for some s.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.Proportional(gain=5.0).prepare(arm, None, dt=0.01)
    >>> plant = dqc.plants.Servo().start(arm, q, dt=0.01, steps=20, seed=0)
    >>> samples = dqc.references.SetPoint(arm.fkm(q)).samples(0.01 * np.arange(20))
    >>> clock = dqc.loop.Clock()
    >>> trace = dqc.loop.close_loop(law, plant, samples, clock=clock)
    >>> bool(clock.timing.begin[-1] >= 0.19)
    True
    """

    def __init__(
        self, now: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._now, self._sleep = now, sleep
        self._period, self._origin, self._steps = 0.0, 0.0, 0
        self._begin = self._computation = self._idle = np.empty(0)
        self._late = np.empty(0, dtype=bool)

    @contextmanager
    def running(self, period: float, steps: int) -> Iterator[None]:
        """Pace so many steps at most with a period (s), without garbage collection meanwhile."""
        self._begin, self._computation, self._idle = np.zeros(steps), np.zeros(steps), np.zeros(steps)
        self._late, self._period, self._steps = np.zeros(steps, dtype=bool), period, 0
        collecting = gc.isenabled()
        gc.collect()
        gc.disable()
        try:
            yield
        finally:
            if collecting:
                gc.enable()

    def await_step(self) -> None:
        """Wait until the next step is due."""
        k, ready = self._steps, self._now()
        if k == 0:
            self._origin = ready
        deadline, begin = self._origin + k * self._period, ready
        while begin < deadline:
            if deadline - begin > _SPIN:
                self._sleep(deadline - begin - _SPIN)
            begin = self._now()
        self._late[k] = ready > deadline
        self._begin[k], self._idle[k] = begin - self._origin, begin - ready
        self._steps = k + 1

    def commanded(self) -> None:
        """Note that the step's command is there."""
        k = self._steps - 1
        self._computation[k] = self._now() - self._origin - self._begin[k]

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
        return Timing(
            self._period, self._begin[:done], self._computation[:done], self._idle[:done], self._late[:done]
        )
