"""The supervisor: the last stage between a law and a robot, which lets out what is safe."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from dqcontrol.errors import ValueRangeError, as_array, as_each, as_positive
from dqcontrol.limits.supervisor import supervisor_layout as at
from dqcontrol.limits.supervisor.prepared_supervisor import PreparedSupervisor
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.whole_body import base_coordinates

Array = NDArray[np.float64]

_LONGEST_WINDOW = 10_000  # samples


class WorkspaceBox(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the hand may be: a box with sides along the inertial axes, m."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


class Supervisor(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bounds on what leaves for the robot, whatever the law says, and when to stop.

    The supervisor keeps a position command p and moves it; all bounds are on p and its rates, not on the law's u (where
    u is counted from the measured joints, it also holds the arm against gravity: 14 rad/s on average in [P16]). Each
    period p moves by T v with |v| ≤ velocity (the whole command scaled, so that the hand keeps its direction),
    |v − v_before| ≤ T acceleration, and such that braking at that acceleration ends within the position limits and in
    the box. Jerk is bounded by the mean of the last rates, which keeps the other bounds of joints.

    It stops, at the acceleration limit, on two bad samples in a row (measurement too old or not finite, command not
    finite; the first of them brakes already), on a tracking error |q − p| beyond its bound and on request; it then
    stays so until it is reset, and brings p back to the measured joints before it follows the law again. This is
    software in a loop that is not hard real time: it stands beside the robot's own safety, not in its place.

    Parameters
    ----------
    velocity
        Of inputs, rad/s or m/s: one number, or one an input; the robot's own limits if omitted.
    acceleration
        rad/s² or m/s²: one number, or one an input.
    jerk
        rad/s³ or m/s³; not bounded if omitted. It delays commands by about acceleration/jerk.
    position_margin
        Kept from the robot's position limits, rad or m.
    tracking_error
        |q − p| that stops, rad or m, joints only: one number, or one an input.
    stale_after
        Age of a measurement at which it no longer counts, s; 1.5 periods if omitted.
    slow_below, hold_below
        Smallest singular value of the hand's Jacobian [ω ; ṗ] (rad and m) below which motions towards a singularity
        are slowed, and below which they are held until it exceeds the mean of both. Motions away are free. 0: off.
    workspace
        Box that the hand stays in; anywhere if omitted. With ``jerk`` kept as far as the hand's path is straight.
    ramp
        Time in which speed comes up after a start and goes down at a soft stop, s.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> supervisor = dqc.limits.Supervisor(acceleration=5.0, ramp=0.0).prepare(arm, dt=0.01)
    >>> state = supervisor.start(q)
    >>> supervisor.command(q, np.full(7, 100.0), state).round(3).tolist()[0]  # after one period: 5 rad/s² · 0.01 s
    0.05
    >>> supervisor.reasons(state)
    ('velocity limit', 'acceleration limit')
    """

    velocity: Annotated[float | list[float] | None, Meta(description="> 0, rad/s or m/s")] = None
    acceleration: Annotated[float | list[float], Meta(description="> 0, rad/s² or m/s²")] = 10.0
    jerk: Annotated[float | list[float] | None, Meta(description="> 0, rad/s³ or m/s³")] = None
    position_margin: Annotated[float, Meta(ge=0, description="rad or m")] = 0.0
    tracking_error: Annotated[float | list[float], Meta(description="> 0, rad or m")] = 0.3
    stale_after: Annotated[float, Meta(gt=0, description="s")] | None = None
    slow_below: Annotated[float, Meta(ge=0, description="singular value")] = 0.04
    hold_below: Annotated[float, Meta(ge=0, description="singular value")] = 0.02
    workspace: WorkspaceBox | None = None
    ramp: Annotated[float, Meta(ge=0, le=60, description="s")] = 0.5

    def prepare(
        self, robot: Robot, dt: float, command_mode: Literal["integrated", "measured"] = "integrated"
    ) -> PreparedSupervisor:
        """Check the parameters for a robot and a period.

        Parameters
        ----------
        robot
            The robot to guard.
        dt
            Control period, s.
        command_mode
            What a plant moves by T u: its last target (``integrated``), or its measured joints (``measured``).

        Raises
        ------
        ShapeError, ValueRangeError
            If a parameter is not allowed, or the robot has no velocity limits and none are given.
        """
        dt, m = as_positive("dt", dt), robot.input_size
        velocity = robot.limits.velocity if self.velocity is None else _each("velocity", self.velocity, m)
        if not np.isfinite(velocity).all():
            raise ValueRangeError(
                f"supervisor.velocity: {robot.name} has no limits of its own; give them here"
            )
        acceleration = _each("acceleration", self.acceleration, m)
        window = 1
        if self.jerk is not None:
            window = max(1, math.ceil((2 * acceleration / (_each("jerk", self.jerk, m) * dt)).max() - 1e-9))
            if window > _LONGEST_WINDOW:
                raise ValueRangeError(
                    f"supervisor.jerk: smooths over {window} periods; at most {_LONGEST_WINDOW}: allow more jerk"
                )
        if self.slow_below < self.hold_below:
            raise ValueRangeError(
                f"supervisor.slow_below: must be ≥ hold_below {self.hold_below:g}, got {self.slow_below:g}"
            )
        moved = robot.input_coordinates
        lower = robot.limits.lower[moved] + self.position_margin
        upper = robot.limits.upper[moved] - self.position_margin
        if (lower > upper).any():
            raise ValueRangeError(
                f"supervisor.position_margin: {self.position_margin:g} leaves "
                f"{robot.input_names[int((lower > upper).argmax())]} no room"
            )
        head = np.zeros(at.HEAD)
        head[at.DT], head[at.WINDOW] = dt, window
        head[at.STALE] = 1.5 * dt if self.stale_after is None else self.stale_after
        head[at.SLOW], head[at.HOLD] = self.slow_below, self.hold_below
        head[at.RAMP] = dt / self.ramp if self.ramp else 1.0
        head[at.FROM_MEASURED] = command_mode == "measured"
        if self.workspace is not None:
            head[at.BOXED] = 1.0
            head[at.BOX : at.BOX + 6] = _box(self.workspace)
        tracking = _each("tracking_error", self.tracking_error, m)
        joints = ~base_coordinates(robot)[moved]
        rows = (head, acceleration, lower, upper, tracking, moved, joints, velocity, robot.drives.ravel())
        return PreparedSupervisor(robot, np.concatenate([np.asarray(row, dtype=np.float64) for row in rows]))


def _each(field: str, value: float | list[float], m: int) -> Array:
    """Return a bound for each input."""
    numbers = as_each(f"supervisor.{field}", value, m)
    if (numbers <= 0).any():
        raise ValueRangeError(f"supervisor.{field}: must be > 0, got {numbers.min():g}")
    return numbers


def _box(workspace: WorkspaceBox) -> Array:
    """Return lower and upper corner, (6,)."""
    lower = as_array("supervisor.workspace.lower", workspace.lower, (3,))
    upper = as_array("supervisor.workspace.upper", workspace.upper, (3,))
    if (lower >= upper).any():
        raise ValueRangeError(f"supervisor.workspace: lower {lower} must be below upper {upper}")
    return np.concatenate([lower, upper])
