"""A supervisor at work: its state, and one step a period."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.limits.supervisor import supervisor_layout as at
from dqcontrol.limits.supervisor.interventions import reasons
from dqcontrol.limits.supervisor.supervisor_step import supervise
from dqcontrol.robots import kinematics_kernels as kernels
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.whole_body import base_coordinates

Array = NDArray[np.float64]

GO, END, STOP, RESET = at.GO, at.END, at.STOP_NOW, at.RESET

_START_TOLERANCE = 0.01  # rad or m: encoders of a robot at rest at its limit may read a little beyond


class PreparedSupervisor:
    """A supervisor for one robot and period; it holds scratch memory, so use one in each thread.

    Attributes
    ----------
    parameters
        As the compiled step reads them.
    """

    def __init__(self, robot: Robot, parameters: Array) -> None:
        self.robot = robot
        self.parameters = parameters
        n, m = robot.configuration_size, robot.input_size
        self.work: Array = np.zeros(at.work_size(n, m))
        self._position = slice(at.MEMORY + n, at.MEMORY + n + m)
        self._rate = slice(at.MEMORY + n + m, at.MEMORY + n + 2 * m)

    @property
    def window(self) -> int:
        """Number of rates whose mean leaves; 1 where jerk is not limited."""
        return int(self.parameters[at.WINDOW])

    @property
    def acceleration(self) -> Array:
        """Largest of each input, shape (m,), rad/s² or m/s²."""
        return self.parameters[at.HEAD : at.HEAD + self.robot.input_size]

    def start(self, q: ArrayLike) -> Array:
        """Return the state of a robot that rests at q, shape (n,), rad or m.

        Raises
        ------
        ValueRangeError
            If a joint is outside its limits, or the hand outside the box: move it inside by other means first.
        """
        n, m, head = self.robot.configuration_size, self.robot.input_size, at.HEAD
        measured = as_array("q", q, (n,))
        if measured.ndim != 1:
            raise ShapeError(f"q: expected one configuration, got shape {measured.shape}")
        lower, upper = (self.parameters[head + k * m : head + (k + 1) * m] for k in (1, 2))
        position = measured[self.robot.input_coordinates]
        outside = (position < lower - _START_TOLERANCE) | (position > upper + _START_TOLERANCE)
        if outside.any():
            i = int(outside.argmax())
            raise ValueRangeError(
                f"q: {self.robot.input_names[i]} is {position[i]:.4g}, outside {lower[i]:.4g} … {upper[i]:.4g}"
            )
        position = np.clip(position, lower, upper)
        state = np.zeros(at.MEMORY + n + (4 + int(self.parameters[at.WINDOW])) * m)
        state[at.MEMORY : at.MEMORY + n] = measured
        state[self._position] = position
        state[at.MEMORY + n + 2 * m : at.MEMORY + n + 3 * m] = position
        if self.parameters[at.BOXED]:
            self._check_inside(measured, position)
        return state

    def _check_inside(self, measured: Array, position: Array) -> None:
        config = measured.copy()
        joints = ~base_coordinates(self.robot)
        coordinates = self.robot.input_coordinates
        config[coordinates] = np.where(joints[coordinates], position, config[coordinates])
        hand = algebra.translation(self.robot.fkm(config))
        box = self.parameters[at.BOX : at.BOX + 6]
        if (hand < box[:3]).any() or (hand > box[3:]).any():
            raise ValueRangeError(
                f"supervisor.workspace: the hand starts at {hand.round(4)}, outside {box[:3]} … {box[3:]} m"
            )

    def command(
        self,
        q: Array,
        wanted: Array,
        state: Array,
        *,
        age: float = 0.0,
        request: int = GO,
        out: Array | None = None,
    ) -> Array:
        """Return the inputs that leave for the robot this period.

        Parameters
        ----------
        q
            Measured configuration, shape (n,), rad or m; may be anything.
        wanted
            What the law commands, shape (m,), rad/s or m/s; may be anything.
        state
            From `start`; updated in place.
        age
            Of the measurement, s.
        request
            ``GO``, ``END`` (soft stop), ``STOP`` (emergency stop) or ``RESET`` (go on after a stop, once it rests).
        out
            Written in place and returned, if given, shape (m,).

        Returns
        -------
        u : ndarray, shape (m,)
            rad/s or m/s, counted as the plant counts; the position command is `position`, its rate `rate`.

        Raises
        ------
        ShapeError
            If a size is wrong.
        """
        if out is None:
            out = np.empty(self.robot.input_size)
        self.step(
            np.ascontiguousarray(q, dtype=np.float64),
            np.ascontiguousarray(wanted, dtype=np.float64),
            state,
            age,
            request,
            out,
        )
        return out

    def step(self, q: Array, wanted: Array, state: Array, age: float, request: int, out: Array) -> bool:
        """Write the inputs that leave; return whether the robot is stopped and at rest. What the loop calls."""
        status = supervise(
            kernels.twist_kinematics.pointer,
            self.robot.chain,
            q,
            age,
            request,
            wanted,
            self.parameters,
            state,
            self.work,
            out,
        )
        if status not in (0, at.AT_REST):
            raise ShapeError(
                f"supervisor: expected {self.robot.configuration_size} measured and {self.robot.input_size} wanted "
                f"numbers and the state from start, got {q.shape}, {wanted.shape} and {state.shape}"
            )
        return status == at.AT_REST

    def position(self, state: Array) -> Array:
        """Return the position command p, one number an input, rad or m; of bases no more than what they drove."""
        return state[self._position]

    def rate(self, state: Array) -> Array:
        """Return the rate of the position command, shape (m,), rad/s or m/s."""
        return state[self._rate]

    def code(self, state: Array) -> int:
        """Return what it did in the last step, and why it is stopped, as one number; see `reasons`."""
        return int(state[at.NOW])

    def reasons(self, state: Array) -> tuple[str, ...]:
        """Return what it did in the last step, and why it is stopped, in words."""
        return reasons(state[at.NOW])

    def is_stopped(self, state: Array) -> bool:
        """Return whether it is stopping or stopped until it is reset."""
        return state[at.MODE] == at.STOPPED
