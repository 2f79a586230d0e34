"""Answers expected of a controller: steps taken in Python, with faults, stops and a new start among them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, ValueRangeError
from dqcontrol.export.controller_parts import ControllerParts
from dqcontrol.loop.control import Control, Phase

OK, STOPPING, STOPPED, ENDED, LAW_FAILED, NO_MEASUREMENT = 0, 1, 2, 3, -6, -11  # as dqc_controller.h has them
NO_REQUEST, END, STOP, RESET = range(4)
_STATUS = {Phase.ACTIVE: OK, Phase.STOPPING: STOPPING, Phase.STOPPED: STOPPED}

# Sample numbers at which something happens in a test vector, of those that the reference has.
_FAULTS = {40: "not finite", 60: "old", 75: "missing", 90: "jump"}
_SILENT = 20, 35  # first sample without wrench, and the first with one again
_STOP_AT, _END_AT, _MOST = 110, 60, 700  # the end after the new start


@dataclass
class VectorRow:
    """One call of a controller and its answer.

    Attributes
    ----------
    request
        Made before it: nothing, end, stop or reset.
    measured
        Shape (n,), rad or m; None if none came.
    time, age, elapsed
        As dqc_step_measured takes them, s.
    wrench
        Measured, shape (6,), N and N·m, NaN where the sensor says nothing; None for a law without contact.
    status, interventions, command
        What it answers.
    """

    request: int
    measured: Array | None
    time: float
    age: float
    elapsed: float
    wrench: Array | None = None
    status: int = OK
    interventions: int = 0
    command: Array | None = None

    def numbers(self, n: int, m: int) -> list[float]:
        """Return it as a row of numbers, of a robot with n coordinates and m inputs."""
        measured = np.zeros(n) if self.measured is None else self.measured
        command = np.zeros(m) if self.command is None else self.command
        head = [self.request, self.measured is not None, self.time, self.age, self.elapsed]
        return [
            *map(float, head),
            *measured.tolist(),
            *([] if self.wrench is None else self.wrench.tolist()),
            float(self.status),
            float(self.interventions),
            *command.tolist(),
        ]


class PythonController:
    """A controller in Python that is called as the library in C is."""

    def __init__(self, parts: ControllerParts) -> None:
        self._parts, self._control, self._origin = parts, None, 0.0
        self._state, self._status = np.zeros(0), OK

    def answer(self, row: VectorRow) -> None:
        """Write what the controller answers into a row."""
        if row.request == RESET:
            self._control, self._state, self._status = None, np.zeros(0), OK
        if self._parts.supervisor:
            self._supervised(row)
        else:
            self._alone(row)

    def _supervised(self, row: VectorRow) -> None:
        parts = self._parts
        if self._control is None:
            assert parts.supervisor
            assert row.measured is not None
            self._control = Control(parts.law, parts.target(), parts.supervisor[1])
            self._control.activate(row.measured)
            self._origin = row.time
        control = self._control
        if row.request == END:
            control.deactivate()
        elif row.request == STOP:
            control.emergency_stop()
        commands = control.is_commanding
        wrench = np.zeros(0) if row.wrench is None else row.wrench
        control.step(row.time - self._origin, row.measured, row.age, row.elapsed, wrench=wrench)
        row.command = control.command.copy() if commands else np.zeros_like(control.command)
        row.interventions = control.supervisor.code(control._state)
        row.status = _STATUS.get(control.phase, ENDED)

    def _alone(self, row: VectorRow) -> None:
        parts, period = self._parts, self._parts.period
        if not len(self._state):
            assert row.measured is not None
            self._state, self._origin = parts.law.initial_state(row.measured), row.time
            self._time = self._stamp = 0.0
        row.command = np.zeros(parts.robot.input_size)
        if self._status != OK:
            row.status = self._status
            return
        since = row.time - self._origin
        passed = since - self._stamp if self._stamp or since else period
        self._stamp = since
        self._time += min(max(passed, 0.0), 1.5 * period) if since else 0.0
        target = parts.target()
        if row.request in (END, STOP) or target.is_over(self._time):
            row.status = self._status = STOPPED if row.request == STOP else ENDED
            return
        if row.measured is None:
            row.status, self._status = NO_MEASUREMENT, STOPPED
            return
        try:
            parts.robot.fkm(row.measured)
            sample = target.sample(self._time, np.zeros(8))
            if row.wrench is not None:
                parts.law.wrench[:] = row.wrench
            parts.law.step(row.measured, sample, max(round(self._time / period), 0), self._state, row.command)
        except (DivergedError, ValueRangeError):
            row.command[:] = 0.0
            row.status, self._status = LAW_FAILED, STOPPED


def vector_rows(parts: ControllerParts, *, whole: bool = False) -> Iterator[VectorRow]:
    """Yield the steps of a closed loop with the spec's plant.

    With a supervisor there are faults on the way, an emergency stop, a new start, and then a soft end, or the ``whole``
    reference.
    """
    controller, period = PythonController(parts), parts.period
    steps = len(parts.samples) + _MOST
    plant = parts.started_plant(steps)
    is_supervised, first, is_new, ending = parts.supervisor is not None, 0, True, False
    for k in range(steps if whole else _MOST):
        since = k - first
        row = VectorRow(RESET if k and is_new else NO_REQUEST, plant.measured.copy(), k * period, 0.0, 0.0)
        if is_supervised:
            _spoil(row, since if not first else -1, period)
            if not first and since == _STOP_AT:
                row.request = STOP
            if first and since == _END_AT and not whole:
                row.request = END
        if parts.wrench_at >= 0:
            silent = _SILENT[0] <= since < _SILENT[1]
            row.wrench = np.full(6, np.nan) if silent else plant.wrench.copy()
        controller.answer(row)
        is_new = False
        yield row
        if row.status == STOPPED and is_supervised and not first:
            first, is_new = k + 1, True
            plant = parts.started_plant(steps)  # the robot was brought back to its start
            continue
        if row.status in (ENDED, STOPPED, LAW_FAILED, NO_MEASUREMENT) and not ending:
            ending = True  # one row more: it says the same again
        elif ending:
            return
        assert row.command is not None
        plant.step(row.command)


def _spoil(row: VectorRow, k: int, period: float) -> None:
    """Do to a measurement what may happen at sample k."""
    what = _FAULTS.get(k, "")
    if what == "missing":
        row.measured, row.age = None, 2.0 * period
    elif what == "old":
        row.age = 10.0 * period
    elif what and row.measured is not None:
        row.measured[0] = np.nan if what == "not finite" else row.measured[0] + 1.0


def c_number(value: float) -> str:
    """Return a number in C, to the last bit."""
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return float(value).hex()
