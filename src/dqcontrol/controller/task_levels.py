"""Several tasks at once: what is added to a law's command so that further tasks are done, level after level.

A law drives one pose of a robot. Further tasks, each with a reference and a gain of its own, stand on levels with it: a
level does what it can without disturbing those before it, and those of one level share by weights. For the command u
that the law gave, δ is found from level to level (P = I, δ = 0 at first): [Siciliano and Slotine 1991]

    A = J P,   δ ← δ + A⁺ (y − J (u + δ)),   P ← P − A⁺A,   A⁺ = Aᵀ(AAᵀ + λ²I)⁻¹

with y = J u for the law's own pose. λ is 0 where the level's rows are well apart, as with `FilteredInverse`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.algebra.dual_quaternion_kernels import half_turn, position
from dqcontrol.algebra.symmetric import cholesky, inverse_trace
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import (
    INPUT,
    NOT_FINITE,
    OK,
    READ,
    READ2,
    STATUS,
    WRITE,
    inline,
    kernel,
    types,
)
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive, error_prefix, unknown_name
from dqcontrol.laws.growth import LEAST, counted, curvature, pose_error
from dqcontrol.references import Reference
from dqcontrol.references.sample import SAMPLE_SIZE
from dqcontrol.robots.kinematics.kinematics_kernels import hand_jacobian
from dqcontrol.robots.kinematics.pose_task_kernels import COLUMNS, task_twist_kinematics
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.robots.tree_robot import PoseTask, TreeRobot

TaskPart = Literal["pose", "position", "orientation", "axis", "line"]
POSTURE = "posture"

# Weights of tasks before and after the law's where constraints make something give way: errors count a hundred times
# and a tenth. Their ratio, 1e6, leaves ten of sixteen digits to the last one.
_BEFORE, _AFTER = 1e4, 1e-2
_THRESHOLD, _DAMPING, _LENGTH = 0.04, 0.02, 0.3  # m; as of `FilteredInverse`

# q, pose, twist Jacobian and sample of the law's task, number of the sample, parameters, work, command
TASKS = STATUS(INPUT, READ, READ2, READ, types.intp, READ, WRITE, WRITE)


@dataclass(frozen=True, eq=False)
class FurtherTask:
    """A task beside that of the law.

    Attributes
    ----------
    task
        What of the robot is driven: a `PoseTask`, or its name, as for `TreeRobot.with_task`; ``"center_of_mass"``, of
        which the position counts; or ``"posture"``, all joints. A chain has the frames ``hand`` and, by its name, that
        of each joint.
    gain
        k, 1/s: ω = k θn + ω_d and ṗ = k (p_d − p) + ṗ_d, position and orientation apart. 0: it moves as the reference
        does and corrects nothing, as end effectors do that press something between them.
    reference
        The motion to follow; None: the pose at the start is held.
    level
        Levels are done in order; the law's own task is on level 1. On 0 a task comes before the law's, on 2 after it.
    weight
        Against the tasks of the same level.
    part
        What of it counts: ``"pose"``, ``"position"``, ``"orientation"``; ``"axis"``, where the z axis points, or
        ``"line"``, where the z axis lies, both free to turn about it. A point and an axis of a link are those of a
        `PoseTask`.
    posture
        Of a posture: where the joints are to be, shape (n,), rad or m; None: where they start.
    """

    task: PoseTask | str
    gain: float
    reference: Reference | None = None
    level: int = 2
    weight: float = 1.0
    part: TaskPart = "pose"
    posture: ArrayLike | None = None


class TaskRow(NamedTuple):
    """What compiled code knows of a task: where its table and its samples begin, and the rest of `FurtherTask`.

    A posture has no table; its samples are where the joints are to be, and which coordinate each input moves (−1: none
    alone). ``along`` is 1 where turns about the desired z axis and moves along it are free.
    """

    table: float
    table_rows: float
    samples: float
    sample_rows: float
    gain: float
    level: float
    turns: float
    moves: float
    along: float


class TaskLevels(NamedTuple):
    """Tasks as compiled code reads them.

    Attributes
    ----------
    tasks, rows
        How many there are, and the most rows that a level has.
    first, last
        Levels.
    growth, late
        How far the law's damping grows, and half of period and lag together, s; 0 where it does not.
    share
        Of the law's inverse.
    data
        A `TaskRow` for each, then their tables and samples.
    """

    tasks: float
    rows: float
    first: float
    last: float
    growth: float
    late: float
    share: float
    data: Annotated[Array, ...]


class LevelWork(NamedTuple):
    """Scratch for m inputs and the most rows of a level; the rest is m × m numbers, or none.

    These are Σ w Jᵀ J of the further tasks, by which constraints reckon what a change of the command costs.
    """

    left: Annotated[Array, "m", "m"]
    jacobian: Annotated[Array, "rows", "m"]
    projected: Annotated[Array, "rows", "m"]
    gram: Annotated[Array, "rows", "rows"]
    residual: Annotated[Array, "rows"]
    column: Annotated[Array, "rows"]
    change: Annotated[Array, "m"]
    pose: Annotated[Array, 8]
    turn: Annotated[Array, 4]
    error: Annotated[Array, 6]
    twist: Annotated[Array, 6, "m"]
    hand: Annotated[Array, 6, "m"]
    axes: Annotated[Array, 9]
    scratch: Annotated[Array, "8 * m"]
    metric: Annotated[Array, ...]


task_row: MemoryLayout[TaskRow] = MemoryLayout(TaskRow)
task_levels: MemoryLayout[TaskLevels] = MemoryLayout(TaskLevels)
level_work: MemoryLayout[LevelWork] = MemoryLayout(LevelWork, "m", "rows")
_ROW = task_row.size()


@inline
def _add_rows(count, hand, y, turns, moves, along, out, own):
    """Append the rows of a task's [ω ; ṗ] and what they lack under the command so far; return how many there are."""
    for i in range(6):
        weight = turns if i < 3 else moves
        if weight == 0.0 or (along != 0.0 and i % 3 == 2):
            continue
        missing = y[i]
        for j in range(out.shape[0]):
            own.jacobian[count, j] = weight * hand[i, j]
            missing -= hand[i, j] * (out[j] + own.change[j])
        own.residual[count] = weight * missing
        count += 1
    return count


@inline
def _add_metric(begin, count, level, own):
    """Add what the rows of a task weigh where constraints must choose what gives way."""
    m = own.change.shape[0]
    if own.metric.shape[0] == 0:
        return
    scale = _BEFORE if level == 0 else 1.0 if level == 1 else _AFTER
    for i in range(begin, count):
        for j in range(m):
            for k in range(m):
                own.metric[m * j + k] += scale * own.jacobian[i, j] * own.jacobian[i, k]


@inline
def _asked(task, sample, own):
    """Write the [ω ; ṗ] that a task asks for: k times what is left, and what its reference does."""
    pose, error = own.pose, own.error
    half_turn(pose, sample, own.turn, error)
    px, py, pz = position(pose)
    x, y, z = position(sample)
    a, b, c = sample[8], sample[9], sample[10]
    error[0] = 2.0 * task.gain * error[0] + a
    error[1] = 2.0 * task.gain * error[1] + b
    error[2] = 2.0 * task.gain * error[2] + c
    error[3] = task.gain * (x - px) + sample[11] + b * z - c * y
    error[4] = task.gain * (y - py) + sample[12] + c * x - a * z
    error[5] = task.gain * (z - pz) + sample[13] + a * y - b * x


@inline
def _write_axes(r, axes):
    """Write the rotation matrix of a pose."""
    w, x, y, z = r[0], r[1], r[2], r[3]
    axes[0], axes[1], axes[2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    axes[3], axes[4], axes[5] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    axes[6], axes[7], axes[8] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@inline
def _free_along(gain, sample, own):
    """Let an axis take the short way to the desired one, and write rows and what is asked in its desired axes."""
    axes, error, hand = own.axes, own.error, own.hand
    _write_axes(own.pose, axes)
    ax, ay, az = axes[2], axes[5], axes[8]
    _write_axes(sample, axes)
    dx, dy, dz = axes[2], axes[5], axes[8]
    x, y, z = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
    sine = math.sqrt(x * x + y * y + z * z)
    scale = gain * (math.atan2(sine, ax * dx + ay * dy + az * dz) / sine if sine > 1e-12 else 1.0)
    error[0], error[1], error[2] = scale * x + sample[8], scale * y + sample[9], scale * z + sample[10]
    for part in range(0, 6, 3):
        for j in range(hand.shape[1]):
            a, b, c = hand[part, j], hand[part + 1, j], hand[part + 2, j]
            for i in range(3):
                hand[part + i, j] = axes[i] * a + axes[3 + i] * b + axes[6 + i] * c
        a, b, c = error[part], error[part + 1], error[part + 2]
        for i in range(3):
            error[part + i] = axes[i] * a + axes[3 + i] * b + axes[6 + i] * c


@inline
def _add_posture(count, task, q, given, out, own):
    """Append a row for each joint, and what it lacks of k times the way to where it is to be."""
    n = q.shape[0]
    for j in range(out.shape[0]):
        at = int(given[n + j])
        if at < 0:
            continue
        for i in range(out.shape[0]):
            own.jacobian[count, i] = 0.0
        own.jacobian[count, j] = task.moves
        own.residual[count] = task.moves * (task.gain * (given[at] - q[at]) - out[j] - own.change[j])
        count += 1
    return count


@inline
def _curvature(pose, twist_jacobian, desired, turns, moves, growth, given):
    """Return c‖C‖ of a task whose rows of ω and ṗ are weighed."""
    if growth == 0.0:
        return 0.0
    a, b, c, d, e, f = counted(pose_error(pose, desired), given.share)
    square = moves * moves
    px, py, pz = position(pose)
    return growth * curvature(
        twist_jacobian, px, py, pz, (a, b, c, square * d, square * e, square * f), turns * turns
    )


@inline
def _do_level(count, grown, out, own):
    """Add to the change what the rows of a level ask for, and take what they use from what is left.

    What the curvature of its errors asks for beyond 1/tr G⁻¹ is damped at least.
    """
    m, left, projected, gram = out.shape[0], own.left, own.projected, own.gram
    residual, column = own.residual, own.column
    for i in range(count):
        for j in range(m):
            value = 0.0
            for k in range(m):
                value += own.jacobian[i, k] * left[k, j]
            projected[i, j] = value
    damping = _DAMPING * _DAMPING
    for attempt in range(2):
        for i in range(count):
            for j in range(i + 1):
                value = 0.0
                for k in range(m):
                    value += projected[i, k] * projected[j, k]
                gram[i, j] = value
            if attempt == 1:
                gram[i, i] += damping
        regular = cholesky(gram, count)
        if attempt == 0:
            least = 1.0 / inverse_trace(gram, count, column) if regular else 0.0
            damping = max(damping * (1.0 - least / (_THRESHOLD * _THRESHOLD)), grown - least)
            if not damping > 0.0:
                break
    for i in range(count):  # L⁻¹ of rows and residual
        value = residual[i]
        for k in range(i):
            value -= gram[i, k] * residual[k]
        residual[i] = value * gram[i, i]
        for j in range(m):
            value = projected[i, j]
            for k in range(i):
                value -= gram[i, k] * projected[k, j]
            projected[i, j] = value * gram[i, i]
    for i in range(m):
        for k in range(count):
            own.change[i] += projected[k, i] * residual[k]
        for j in range(m):
            for k in range(count):
                left[i, j] -= projected[k, i] * projected[k, j]


@kernel(TASKS)
def do_tasks(q, pose, twist_jacobian, sample, k, parameters, work, out):
    """Add to a law's command what further tasks need."""
    given, m = task_levels(parameters), out.shape[0]
    own = level_work(work, m, int(given.rows))
    data, tasks = given.data, int(given.tasks)
    for i in range(m):
        own.change[i] = 0.0
        for j in range(m):
            own.left[i, j] = 1.0 if i == j else 0.0
    for i in range(own.metric.shape[0]):
        own.metric[i] = 0.0
    for level in range(int(given.first), int(given.last) + 1):
        count, grown = 0, 0.0
        if level == 1:
            grown += _curvature(pose, twist_jacobian, sample, _LENGTH, 1.0, given.growth, given)
            hand_jacobian(position(pose), twist_jacobian, own.hand)
            for i in range(6):
                own.error[i] = 0.0
                for j in range(m):
                    own.error[i] += own.hand[i, j] * out[j]
            count = _add_rows(count, own.hand, own.error, _LENGTH, 1.0, 0.0, out, own)
        for t in range(tasks):
            task = task_row(data[_ROW * t : _ROW * (t + 1)])
            if int(task.level) != level:
                continue
            begin = count
            if task.table_rows == 0.0:
                count = _add_posture(count, task, q, data[int(task.samples) :], out, own)
                _add_metric(begin, count, level, own)
                continue
            at, rows = int(task.table), int(task.table_rows)
            table = as_matrix(data[at : at + COLUMNS * rows], rows, COLUMNS)
            status = task_twist_kinematics(table, q, own.pose, own.twist, own.scratch)
            if status != OK:
                return status
            at = int(task.samples) + SAMPLE_SIZE * min(k, int(task.sample_rows) - 1)
            wanted = data[at : at + SAMPLE_SIZE]
            if level == int(given.first) and given.growth > 0.0:  # later ones have what those before leave
                growth = max(LEAST, task.gain * given.late)
                grown += _curvature(own.pose, own.twist, wanted, task.turns, task.moves, growth, given)
            _asked(task, wanted, own)
            hand_jacobian(position(own.pose), own.twist, own.hand)
            if task.along != 0.0:
                _free_along(task.gain, wanted, own)
            count = _add_rows(count, own.hand, own.error, task.turns, task.moves, task.along, out, own)
            _add_metric(begin, count, level, own)
        if count > 0:
            _do_level(count, grown, out, own)
    check = 0.0
    for i in range(m):
        out[i] += own.change[i]
        check += 0.0 * out[i]
    return OK if check == 0.0 else NOT_FINITE


class PreparedTasks:
    """Further tasks made ready for one robot, start and period.

    Parameters
    ----------
    robot
        Any; a chain has the frames of `chain_as_tree`.
    tasks
        What is to be done beside the law's task.
    start
        Configuration, shape (n,), whose poses are held by tasks without reference.
    times
        Of the samples, shape (N,), s.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If a task is not allowed.
    """

    kernel = do_tasks

    def __init__(self, robot: Robot, tasks: list[FurtherTask], start: Array, times: Array) -> None:
        from dqcontrol.robots.tree_robot import chain_as_tree  # most laws have no further tasks

        self.robot: TreeRobot = chain_as_tree(robot)
        self.tasks: list[PoseTask | None] = []  # None: a posture
        self.labels: list[str] = []
        rows, blocks, at = [], [], _ROW * len(tasks)
        self.samples: list[Array] = []
        self.parts: list[str] = [each.part for each in tasks]
        self.gains = [float(each.gain) for each in tasks]
        self.levels = [each.level for each in tasks]
        for i, each in enumerate(tasks):
            with error_prefix(f"tasks[{i}]"):
                task, table, samples = _made_ready(each, self.robot, start, times)
                rows.append(_checked_row(each, at, table, samples))
            if task is not None and task == self.robot.task:
                raise ValueRangeError(
                    f"tasks[{i}]: {task.label} is what the law drives; give it another task"
                )
            label = task.label if task else POSTURE
            self.tasks.append(task)
            self.labels.append(f"{label} {i + 1}" if label in self.labels else label)
            self.samples.append(samples)
            blocks += [table.ravel(), samples.ravel()]
            at += table.size + samples.size
        most = max(
            _rows_of_level(level, rows, robot.input_size) for level in {1, *(row.level for row in rows)}
        )
        self.parameters: Array = task_levels.pack(
            tasks=len(tasks),
            rows=most,
            first=min(*self.levels, 1),
            last=max(*self.levels, 1),
            growth=0.0,
            late=0.0,
            share=1.0,
            data=np.concatenate([*(np.array(row) for row in rows), *blocks]),
        )
        self.work_size: int = level_work.size(robot.input_size, most)

    def samples_in(self, parameters: Array, number: int) -> Array:
        """Return a view of the samples of a task, shape (N, 21), in parameters that compiled code reads."""
        data = task_levels(parameters).data
        row = task_row(data[_ROW * number : _ROW * (number + 1)])
        begin, rows = int(row.samples), int(row.sample_rows)
        samples: Array = data[begin : begin + rows * SAMPLE_SIZE].reshape(rows, SAMPLE_SIZE)
        return samples

    def errors(self, q: Array) -> dict[str, Array]:
        """Return of each task by its label how far it is from its pose at each sample: m and rad, shape (N, 2).

        What of the pose does not count is NaN. A posture has the angle that its worst joint is away, of a slide in m.
        """
        found = {}
        for label, task, samples, part in zip(self.labels, self.tasks, self.samples, self.parts, strict=True):
            if task is None:
                found[label] = self._posture_errors(q, samples[: q.shape[1]])
                continue
            desired = samples[np.minimum(np.arange(len(q)), len(samples) - 1), :8]
            poses = self.robot.pose_of(task, q)
            away = algebra.translation(poses) - algebra.translation(desired)
            error = algebra.multiply(algebra.conjugate(poses), desired)
            turned = 2 * np.arctan2(np.linalg.norm(error[:, 1:4], axis=1), np.abs(error[:, 0]))
            if part in ("axis", "line"):
                own, wanted = (algebra.matrix_from_pose(each)[:, :3, 2] for each in (poses, desired))
                away = np.cross(wanted, away)
                turned = np.arctan2(np.linalg.norm(np.cross(own, wanted), axis=1), (own * wanted).sum(axis=1))
            found[label] = np.column_stack([np.linalg.norm(away, axis=1), turned])
            if part not in ("pose", "line"):
                found[label][:, 1 if part == "position" else 0] = np.nan
        return found

    def _posture_errors(self, q: Array, wanted: Array) -> Array:
        slides = np.array([kind == "prismatic" for kind in self.robot.joint_types])
        away, out = np.abs(q - wanted), np.full((len(q), 2), np.nan)
        for column, chosen in enumerate((slides, ~slides)):
            if chosen.any():
                out[:, column] = away[:, chosen].max(axis=1)
        return out


def _rows_of_level(level: float, rows: list[TaskRow], inputs: int) -> int:
    """Return how many rows the tasks of a level have at most, that of the law on level 1 with them."""
    own = [inputs if row.table_rows == 0 else 6 for row in rows if row.level == level]
    return sum(own) + (6 if level == 1 else 0)


def _made_ready(
    each: FurtherTask, robot: TreeRobot, start: Array, times: Array
) -> tuple[PoseTask | None, Array, Array]:
    """Return a task, None for a posture, its table and its samples."""
    if each.task == POSTURE and POSTURE not in robot.named_frames:
        if each.reference is not None:
            raise ShapeError("reference: a posture has none; give 'posture', where the joints are to be")
        given = start if each.posture is None else each.posture
        target = as_array("posture", given, (robot.configuration_size,))
        alone = robot.input_coordinates.astype(float)
        for first, *_ in robot.drives:  # a drive goes nowhere directly
            alone[(robot.input_coordinates >= first) & (robot.input_coordinates < first + 3)] = -1.0
        return None, np.zeros((0, COLUMNS)), np.concatenate([target, alone])
    if each.posture is not None:
        raise ShapeError("posture: only the task 'posture' has one")
    task = robot.for_start(each.task, start)
    if task.kind == "center_of_mass" and each.part != "position":
        raise ValueRangeError(
            f"part: a centre of mass has a position only; give part: position, not {each.part!r}"
        )
    return task, np.ascontiguousarray(robot.table_of(task)), _samples(each, robot.pose_of(task, start), times)


def _checked_row(each: FurtherTask, at: int, table: Array, samples: Array) -> TaskRow:
    gain = as_positive("gain", each.gain, zero_allowed=True)
    weight = as_positive("weight", each.weight)
    if not isinstance(each.level, int) or not 0 <= each.level <= 9:
        raise ValueRangeError(f"level: must be a whole number from 0 to 9, got {each.level!r}")
    if each.part not in get_args(TaskPart):
        raise unknown_name("part", str(each.part), get_args(TaskPart))
    scale = math.sqrt(weight)
    turns = 0.0 if each.part == "position" else scale * _LENGTH
    moves = 0.0 if each.part in ("orientation", "axis") else scale
    along = float(each.part in ("axis", "line"))
    return TaskRow(at, len(table), at + table.size, len(samples), gain, each.level, turns, moves, along)


def _samples(each: FurtherTask, pose: Array, times: Array) -> Array:
    if each.reference is None:
        return np.concatenate([pose, np.zeros(SAMPLE_SIZE - 8)])[None]
    return np.ascontiguousarray(each.reference.samples(times))
