"""A supervisor in the loop: its state over a run, what it did, and who is told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.limits.supervisor.interventions import reasons
from dqcontrol.limits.supervisor.prepared_supervisor import END, GO, PreparedSupervisor
from dqcontrol.loop.signals import Signal

Array = NDArray[np.float64]
Watch = Callable[[float, tuple[str, ...]], None]

INTERVENTIONS = "interventions"  # name of the signal


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
    """

    def __init__(self, supervisor: PreparedSupervisor, q: ArrayLike, watch: Watch | None = None) -> None:
        self.supervisor = supervisor
        self.state: Array = supervisor.start(q)
        self.request: int = GO
        self.codes: Array = np.zeros(0)
        self._watch = watch

    def begin(self, count: int) -> None:
        """Make room for so many samples."""
        self.codes = np.zeros(count)

    def step(self, k: int, time: float, measured: Array, command: Array, age: float) -> bool:
        """Replace the command of sample k by what leaves; return whether the robot is stopped and at rest."""
        halted = self.supervisor.step(measured, command, self.state, age, self.request, command)
        self.codes[k] = code = self.supervisor.code(self.state)
        if self._watch and code != (self.codes[k - 1] if k else 0):
            self._watch(time, reasons(code))
        return halted

    def end(self) -> None:
        """Ask for a soft stop, unless another stop was asked for; interrupts may call it."""
        if self.request == GO:
            self.request = END

    def why(self, count: int) -> str:
        """Say why it is stopped after so many samples."""
        return ", ".join(reasons(self.codes[count - 1]))

    def signals(self, count: int) -> dict[str, Signal]:
        """Return what it did at the first samples, as a quantity of the recording."""
        return {INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), self.codes[:count, None])}
