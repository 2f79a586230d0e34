"""A supervisor at work: its state, and one step a period."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.robots.kinematics.pose_task_kernels import COLUMNS
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.tree_robot import TreeRobot
from dqcontrol.supervisor import supervisor_layout as layout
from dqcontrol.supervisor.interventions import describe_stop, reasons, stop_category
from dqcontrol.supervisor.supervisor_step import check_start, clearance, supervise

START_TOLERANCE = 0.01  # rad or m: encoders of a robot at rest at its limit may read a little beyond
_NOTHING: Array = np.zeros(0)


def tree_of(robot: Robot) -> Array:
    """Return the rows of a tree's joints and of the frames of its task, its end effectors; none of a chain."""
    return robot.table_with_hands if isinstance(robot, TreeRobot) else np.zeros((0, COLUMNS))


class PreparedSupervisor:
    """A supervisor for one robot and period; it holds scratch memory, so use one in each thread.

    Parameters
    ----------
    robot
        Whose commands it bounds.
    bounds
        See ``supervisor_layout.Bounds``.

    Attributes
    ----------
    memory
        As the compiled step takes it.
    sizes, bounds
        Its parameters by name; writing to bounds changes them.
    """

    kernel = supervise

    def __init__(self, robot: Robot, bounds: Array, tree: Array) -> None:
        n, m = robot.configuration_size, robot.input_size
        self.robot = robot
        self.sizes: layout.Sizes = layout.sizes_of(bounds[layout.SIZES : layout.HEAD])
        scratch = np.zeros(layout.scratch_layout.size(self.sizes))
        self.memory: Array = layout.supervisor_memory.pack(
            bounds=bounds, table=robot.table, tree=tree, scratch=scratch
        )
        self._parts = layout.supervisor_memory(self.memory, self.sizes)
        self.bounds: layout.Bounds = layout.bounds_layout(self._parts.bounds, self.sizes)
        self._moment = np.zeros(len(layout.Moment._fields))
        self._position, self._rate = (
            slice(first, first + m)
            for first in (layout.state_layout.place(name, n, m) for name in ("sent", "sent_rate"))
        )

    @property
    def period(self) -> float:
        """Between two steps, s."""
        return float(self.memory[layout.DT])

    @property
    def window(self) -> int:
        """Number of rates whose mean leaves; 1 where jerk is not limited."""
        return int(self.memory[layout.WINDOW])

    @property
    def acceleration(self) -> Array:
        """Largest of each input, shape (m,), rad/s² or m/s²."""
        return self.bounds.acceleration

    @property
    def watches_effort(self) -> bool:
        """Whether it bounds measured efforts."""
        bounds = self.bounds
        return bool(np.isfinite(bounds.effort).any() or np.isfinite(bounds.head[layout.CONTACT_EFFORT]))

    @property
    def watches_wrench(self) -> bool:
        """Whether it bounds the wrench measured at the end effector."""
        return bool(np.isfinite(self.bounds.head[[layout.CONTACT_FORCE, layout.CONTACT_TORQUE]]).any())

    @property
    def carries_payload(self) -> bool:
        """Whether it takes the weight of a payload, or a bias, off the wrench measured at the end effector."""
        bias = self.bounds.head[layout.SENSOR_BIAS : layout.SENSOR_BIAS + 6]
        return bool(self.bounds.head[layout.PAYLOAD_WEIGHT] or bias.any())

    def start(self, q: ArrayLike) -> Array:
        """Return the state of a robot that rests at q, shape (n,), rad or m.

        One that is beyond a limit by no more than 0.01 is brought in, within its acceleration.

        Raises
        ------
        ValueRangeError
            If a joint is outside its limits, the end effector outside the box, or the base in a zone that it keeps out
            of: move it by other means first.
        """
        n, m, bounds = self.robot.configuration_size, self.robot.input_size, self.bounds
        measured = as_array("q", q, (n,))
        if measured.ndim != 1:
            raise ShapeError(f"q: expected one configuration, got shape {measured.shape}")
        position = measured[self.robot.input_coordinates]
        outside = (position < bounds.lower - START_TOLERANCE) | (position > bounds.upper + START_TOLERANCE)
        if outside.any():
            i = int(outside.argmax())
            raise ValueRangeError(
                f"q: {self.robot.input_names[i]} is {position[i]:.4g}, outside "
                f"{bounds.lower[i]:.4g} … {bounds.upper[i]:.4g}"
            )
        state = np.zeros(layout.state_layout.size(n, m) + self.window * m)
        memory = layout.state_layout(state, n, m)
        memory.numbers[layout.LATENESS] = 1.0
        memory.good[:] = measured
        memory.sent[:] = memory.position[:] = memory.sent_then[:] = position
        memory.usual_effort[:] = np.nan
        if self.looks_at_start and (refused := check_start(self.memory, state)):
            raise ValueRangeError(self._why_not_there(refused, measured))
        return state

    @property
    def looks_at_start(self) -> bool:
        """Whether a start is judged by more than joints: a box for end effectors and points, or zones for the base."""
        return bool(self.bounds.head[layout.BOXED] or len(self.bounds.zones))

    def _why_not_there(self, refused: int, measured: Array) -> str:
        """Say where a robot that `check_start` has refused would start."""
        head = self.bounds.head
        if refused == layout.IN_ZONE:
            x, y, footprint = *measured[:2], head[layout.FOOTPRINT]
            return (
                f"supervisor.keep_out: the base starts at ({x:.4g}, {y:.4g}) m, "
                f"{clearance(self.bounds.zones, x, y):.3g} m from a zone (negative: inside), nearer than its "
                f"footprint of {footprint:.3g} m"
            )
        box, scratch = head[layout.BOX : layout.BOX + 6], self._parts.scratch
        hands = layout.scratch_layout(scratch, self.sizes).ahead.reshape(-1, 3)[: self.sizes.hands]
        places = " and ".join(str(each) for each in hands.round(4))
        return (
            f"supervisor.workspace: the end effector starts at {places}, or a point of its links, outside "
            f"{box[:3]} … {box[3:]} m"
        )

    def command(
        self,
        q: Array,
        wanted: Array,
        state: Array,
        *,
        age: float = 0.0,
        elapsed: float | None = None,
        request: int = layout.GO,
        effort: Array = _NOTHING,
        wrench: Array = _NOTHING,
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
        elapsed
            Since the last step, s, on a clock that never jumps; one period if omitted.
        request
            ``GO``, ``END`` (soft stop: the law is followed while speed goes down), ``FINISH`` (soft stop at the
            acceleration limit: the law is not asked any more), ``STOP`` (emergency stop) or ``RESET`` (go on after a
            stop, once it rests).
        effort
            Measured, shape (m,), N·m or N; empty if it is not.
        wrench
            Force and torque that payload and environment exert on the end effector, its axes and about its origin,
            shape (6,), N and N·m; empty if it is not measured.
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
            elapsed,
            effort,
            wrench,
        )
        return out

    def step(
        self,
        q: Array,
        wanted: Array,
        state: Array,
        age: float,
        request: int,
        out: Array,
        elapsed: float | None = None,
        effort: Array = _NOTHING,
        wrench: Array = _NOTHING,
        still: float = 0.0,
    ) -> bool:
        """Write the inputs that leave; return whether the robot is stopped and at rest. What the loop calls."""
        moment, memory = self._moment, self.memory
        moment[0], moment[1], moment[2] = age, memory[layout.DT] if elapsed is None else elapsed, request
        moment[4] = still
        kinematics = self.robot.kernels.twist_kinematics.pointer
        status = supervise(kinematics, memory, moment, q, wanted, effort, wrench, state, out)
        if status not in (0, layout.AT_REST):
            raise ShapeError(
                f"supervisor: expected {self.robot.configuration_size} measured and {self.robot.input_size} wanted "
                f"numbers, {self.robot.input_size} efforts and a wrench of 6 or none, and the state from start, got "
                f"{q.shape}, {wanted.shape}, {effort.shape}, {wrench.shape} and {state.shape}"
            )
        return status == layout.AT_REST

    def position(self, state: Array) -> Array:
        """Return the position command p, one number an input, rad or m; of bases no more than what they drove."""
        return state[self._position]

    def rate(self, state: Array) -> Array:
        """Return the rate of the position command, shape (m,), rad/s or m/s."""
        return state[self._rate]

    def code(self, state: Array) -> int:
        """Return what it did in the last step, and why it is stopped, as one number; see `reasons`."""
        return int(state[layout.NOW])

    def reasons(self, state: Array) -> tuple[str, ...]:
        """Return what it did in the last step, and why it is stopped, in words."""
        return reasons(state[layout.NOW])

    def is_stopped(self, state: Array) -> bool:
        """Return whether it is stopping or stopped until it is reset."""
        return state[layout.MODE] == layout.STOPPED

    def stop_category(self, state: Array) -> int | None:
        """Return the category (IEC 60204-1) of the stop that it is in, None if it is in none; see `stop_category`."""
        return stop_category(state[layout.FAULT]) if self.is_stopped(state) else None

    def describe_stop(self, state: Array) -> str:
        """Return category and reasons of the stop that it is in, in words; empty if it is in none."""
        return describe_stop(state[layout.FAULT]) if self.is_stopped(state) else ""
