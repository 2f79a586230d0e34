"""A motion of the joints, as a file says it, whatever the end effector's reference."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import FileFormatError, ValueRangeError, suggest
from dqcontrol.files.input_file import as_number, read_text
from dqcontrol.laws.law import LAW, Law, LoopRates, check_steps
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference


class JointMotionParameters(NamedTuple):
    """What compiled code knows of a sample: gain, wanted positions, and the velocities to the next sample."""

    gain: float
    position: Annotated[Array, "n"]
    velocity: Annotated[Array, "n"]


joint_motion_parameters: MemoryLayout[JointMotionParameters] = MemoryLayout(JointMotionParameters, "n")


@kernel(LAW)
def joint_motion(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = q̇_d + k (q_d − q)."""
    given = joint_motion_parameters(parameters, out.shape[0])
    for i in range(out.shape[0]):
        out[i] = given.velocity[i] + given.gain * (given.position[i] - q[i])
    return OK


class JointMotion(Law, frozen=True, kw_only=True, tag="joint-motion"):
    r"""q̇ = q̇_d + k (q_d − q): joint positions over time, q_d, from a file, and not the end effector's reference.

    The command leads exactly to the wanted positions of the next sample, so that the targets of servos whose targets
    grow (``integrated``) are these positions, with k = 0. After the end of the file its last positions are held. Start
    where the file does. For motions that are given joint by joint, as those of ``dqcontrol excite``.

    Sampling limits: every joint has the loop gain k.

    Parameters
    ----------
    file
        A table: a line of column names, ``time`` (s) and a column a joint, by name or ``q1`` …, rad or m; then a line a
        sample.
    gain
        k in 1/s; 0 for no feedback.

    Examples
    --------
    >>> import tempfile, pathlib, numpy as np, dqcontrol as dqc
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "motion.csv"
    >>> _ = file.write_text("time,q1,q2\n0,0,0\n1,0.1,0.2\n")
    >>> arm = dqc.SerialArm.from_dh([0, 0], [0, 0], [1, 1], [0, 0])
    >>> law = dqc.laws.JointMotion(file=str(file))
    >>> law.command(arm, [0, 0], dqc.Sample(arm.fkm([0, 0])), period=0.01).round(9).tolist()
    [0.1, 0.2]
    """

    file_keys: ClassVar[tuple[str, ...]] = ("file",)
    kernel = joint_motion
    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]
    gain: Annotated[float, Meta(ge=0, description="k, 1/s")] = 0.0

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> Array:
        """Return gain, positions and velocities at each sample of the motion."""
        if robot.input_size != robot.configuration_size:
            raise ValueRangeError(f"law: joint-motion is for arms; {robot.name} has a mobile base")
        times, positions = read_joint_motion(self.file, robot)
        steps = float(np.ceil(times[-1] / period - 1e-9)) + 1
        check_steps("law.file", steps)
        grid = period * np.arange(int(steps) + 1)
        wanted = np.column_stack([np.interp(grid, times, each) for each in positions.T])
        speeds = np.diff(wanted, axis=0) / period
        return np.column_stack([np.full(int(steps), self.gain), wanted[:-1], speeds])

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return k, the rate of every joint."""
        return LoopRates(position=parameters[:, 0], orientation=parameters[:, 0])


def read_joint_motion(path: str | Path, robot: Robot) -> tuple[Array, Array]:
    """Return times (N,) from 0, s, and positions (N, n) of a file, rad or m.

    Raises
    ------
    FileFormatError
        If it cannot be read, a column is missing, or time does not increase.
    """
    lines = read_text(path).splitlines()
    rows = [(k, next(csv.reader([line]))) for k, line in enumerate(lines, start=1) if line.strip()]
    if len(rows) < 3:
        raise FileFormatError(f"{path}: expected a line of column names and at least two samples")
    (number, header), *rows = rows
    names = [name.strip() for name in header]
    numbered = [f"q{i + 1}" for i in range(robot.configuration_size)]
    joints = numbered if set(numbered) <= set(names) else list(robot.joint_names)
    for name in ("time", *joints):
        if name not in names:
            raise FileFormatError(
                f"{path}:{number}: column missing: {name}{suggest(name, names)} (columns: {', '.join(names)})"
            )
    places, table = [names.index(name) for name in ("time", *joints)], np.empty((len(rows), len(joints) + 1))
    for k, (line, cells) in enumerate(rows):
        if len(cells) != len(names):
            raise FileFormatError(f"{path}:{line}: expected {len(names)} values, got {len(cells)}")
        table[k] = [as_number(f"{path}:{line}: {names[i]}", cells[i]) for i in places]
    for k in np.flatnonzero(np.diff(table[:, 0]) <= 0)[:1]:
        raise FileFormatError(
            f"{path}:{rows[k + 1][0]}: time: must increase, got {table[k + 1, 0]:g} after {table[k, 0]:g}"
        )
    return table[:, 0] - table[0, 0], table[:, 1:]
