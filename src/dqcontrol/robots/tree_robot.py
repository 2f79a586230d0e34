"""Trees of joints: robots with several frames to drive, joints that they share, and joints that follow others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import takewhile
from types import ModuleType
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import SINGULAR
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, unknown_name
from dqcontrol.robots.chain_robot import Kinematics
from dqcontrol.robots.inverse.inverse_kernels import solve_tasks, task_solver_work
from dqcontrol.robots.inverse.inverse_kinematics import Problem, Solution
from dqcontrol.robots.kinematics import pose_task_kernels as task_kernels
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS
from dqcontrol.robots.kinematics.kinematics_kernels import HEADING, PRISMATIC
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.poses import compose, positions, shift, unit_pose, z_onto
from dqcontrol.robots.robot import NamedFrame, Robot, distinct_names

Root: TypeAlias = Literal["midpoint", "screw"]
TaskKind: TypeAlias = Literal["frame", "relative", "absolute", "center_of_mass"]

_BASE, _HAND, _MASS = "base", "hand", "center_of_mass"


@dataclass(frozen=True)
class PoseTask:
    """What of a tree a law drives: one pose.

    Attributes
    ----------
    kind
        ``"frame"``: the pose of a frame. ``"relative"``: x₂*x₁, the first frame seen from the second. ``"absolute"``:
        what two frames have in common, x₂ (x₂*x₁)^½. ``"center_of_mass"``: that of all that moves, without orientation.
    frames
        One or two names; none for the centre of mass.
    root
        Of absolute poses. ``"midpoint"``: position and orientation are halved apart, so that the position is midway
        between both frames. [Adorno 2011] ``"screw"``: both lie half a screw motion away, symmetrically.
    sign
        Given to x₂*x₁ before the root: 1, −1, or 0 for the short way round at each configuration. With the other sign
        the absolute pose is turned by half a turn about the axis between the frames.
    point, axis
        A point in the first frame, m, in place of its origin, and a direction there that is taken for its z axis.
    """

    kind: TaskKind
    frames: tuple[str, ...]
    root: Root = "midpoint"
    sign: Literal[-1, 0, 1] = 0
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        for field in ("point", "axis"):
            as_array(f"task.{field}", getattr(self, field), (3,))
        if not np.linalg.norm(self.axis) > 1e-12:
            raise ValueRangeError(f"task.axis: must not be zero, got {list(self.axis)}")
        for field, allowed in (("kind", TaskKind), ("root", Root)):
            if getattr(self, field) not in get_args(allowed):
                raise unknown_name(f"task.{field}", str(getattr(self, field)), get_args(allowed))
        wanted = {"frame": 1, "center_of_mass": 0}.get(self.kind, 2)
        if len(self.frames) != wanted:
            raise ShapeError(
                f"task: {self.kind} needs {wanted or 'no'} frame{'s' * (wanted > 1)}, got "
                f"{', '.join(self.frames) or 'none'}"
            )
        if wanted == 2 and self.frames[0] == self.frames[1]:
            raise ShapeError(f"task: {self.kind} needs two different frames, got '{self.frames[0]}' twice")
        if self.sign not in (-1, 0, 1):
            raise ValueRangeError(f"task.sign: must be -1, 0 or 1, got {self.sign!r}")

    @property
    def label(self) -> str:
        """What it is called in tables: ``left``, ``left seen from right``, ``left and right``."""
        if self.kind == "center_of_mass":
            return "centre of mass"
        words = {"frame": "", "relative": " seen from ", "absolute": " and "}[self.kind].join(self.frames)
        return words if self.on_frame else f"point of {words}"

    @property
    def on_frame(self) -> bool:
        """Whether it is of the first frame as that is, without another point or axis."""
        return self.point == (0.0, 0.0, 0.0) and self.axis == (0.0, 0.0, 1.0)

    def of_frames(self, poses: Mapping[str, Array]) -> Array:
        """Return the pose, shape (8,), that frames at given poses make of it, without another point or axis.

        Raises
        ------
        ShapeError
            If it has another point or axis, or is the centre of mass.
        """
        if self.kind == "center_of_mass" or not self.on_frame:
            raise ShapeError(f"task: frames alone do not say where {self.label} is")
        first = poses[self.frames[0]]
        if self.kind == "frame":
            return first
        second = poses[self.frames[1]]
        relative = algebra.multiply(algebra.conjugate(second), first)
        if self.kind == "relative":
            return relative
        half = algebra.power(relative * (self.sign or (1.0 if relative[0] >= 0 else -1.0)), 0.5)
        middle = algebra.multiply(second, half)
        if self.root == "screw":
            return middle
        return algebra.pose(
            algebra.rotation(middle), 0.5 * (algebra.translation(first) + algebra.translation(second))
        )

    @property
    def offset(self) -> Array:
        """Pose (7,) of point and axis in the first frame."""
        axis = np.asarray(self.axis, np.float64)
        return np.array([*z_onto(axis / np.linalg.norm(axis))[:4], *self.point])


class TreeJoints(NamedTuple):
    """The joints of a tree, one row each, parents before children.

    Attributes
    ----------
    fixed
        Pose (7,) of each joint's frame in its parent's, after that one's screw; quaternion first; shape (N, 7).
    kind
        As in chains, see ``kinematics_kernels``; shape (N,).
    parent
        Row of the joint that carries it, −1 for the base.
    coordinate, column
        Index of the coordinate that moves it, and of the input (−1: none).
    multiplier, offset
        It is moved by multiplier · q + offset.
    names
        Of the joints.
    """

    fixed: Array
    kind: Array
    parent: NDArray[np.intp]
    coordinate: NDArray[np.intp]
    column: NDArray[np.intp]
    multiplier: Array
    offset: Array
    names: tuple[str, ...] = ()

    def path(self, joint: int) -> list[int]:
        """Return the rows of the joints from the base to one, both included; none for −1."""
        rows = []
        while joint >= 0:
            rows.append(joint)
            joint = int(self.parent[joint])
        return rows[::-1]


class TreeRobot(Robot):
    """A tree of joints with named frames, of which a law drives one pose at a time: its task.

    `fkm`, the Jacobians and all else that robots have are those of the task. `with_task` returns the same robot with
    another one; ``frame_pose`` and ``frame_jacobian`` give those of any frame.

    Parameters
    ----------
    joints
        See `TreeJoints`.
    frames
        Named frames. ``"base"`` is always one: the frame in which poses are given.
    task
        What laws drive.
    joint_names, joint_types, limits
        Of the coordinates; velocities and efforts of the inputs.
    input_coordinates
        Index of the coordinate that each input moves; the coordinates themselves if omitted.
    drives
        As of `Robot`.
    inertia
        Of the body that each joint (row) moves.
    name
        Shown in tables.
    """

    kernels: ClassVar[ModuleType] = task_kernels

    def __init__(
        self,
        joints: TreeJoints,
        frames: Mapping[str, NamedFrame],
        task: PoseTask,
        *,
        joint_names: Sequence[str],
        joint_types: Sequence[str],
        limits: Limits,
        input_coordinates: NDArray[np.intp] | None = None,
        drives: Array | None = None,
        inertia: Inertia | None = None,
        name: str = "tree",
    ) -> None:
        n = len(joint_names)
        identity = NamedFrame(-1, np.array([1.0, 0, 0, 0, 0, 0, 0]))
        self.joints = joints
        self.tips: tuple[str, ...] = ()  # those that its file was loaded for
        self.named_frames: dict[str, NamedFrame] = {_BASE: identity, **frames}
        self.name = name
        self.configuration_size = n
        self.joint_names: tuple[str, ...] = tuple(joint_names)
        self.joint_types: tuple[str, ...] = tuple(joint_types)
        self.limits = limits
        self.inertia = inertia
        self.input_coordinates: NDArray[np.intp] = (
            np.arange(n) if input_coordinates is None else input_coordinates
        )
        self.input_size: int = len(self.input_coordinates)
        self.input_names: tuple[str, ...] = tuple(self.joint_names[i] for i in self.input_coordinates)
        self.input_types: tuple[str, ...] = tuple(self.joint_types[i] for i in self.input_coordinates)
        self.drives: Array = np.zeros((0, DRIVE_COLUMNS)) if drives is None else drives
        used, factors = joints.coordinate.tolist(), joints.multiplier
        followed = {i for i, factor in zip(used, factors, strict=True) if factor != 1 or used.count(i) > 1}
        self.follows = tuple(name for i, name in enumerate(self.joint_names) if i in followed)
        self.row_coordinates, self.row_names = joints.coordinate, joints.names or self.joint_names
        self.joint_factors, self.joint_offsets = joints.multiplier, joints.offset
        self._tree = self._tree_table()
        self.inertia_chain = self.joint_table
        self.chain: Array = self._tree[1:, :8]
        self.chain.flags.writeable = False
        self._tables: dict[PoseTask, Array] = {}
        self._choose(task)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({self.name!r}, {self.configuration_size} coordinates, {self.task.label})"
        )

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(self.named_frames)

    @property
    def parents(self) -> NDArray[np.intp]:
        """For each row of ``chain`` and `frames` the row that carries it, −1 for the base: joints, then frames."""
        return self._tree[1:, task_kernels.PARENT].astype(np.intp)

    @property
    def joint_table(self) -> Array:
        """The rows of all joints as compiled code reads them, after a first one; see ``pose_task_kernels``."""
        return self._tree[: 1 + len(self.joints.kind)]

    @property
    def table_with_hands(self) -> Array:
        """Those rows, and those of the frames of the task."""
        return np.vstack(
            [self.joint_table, *(_frame_row(self.named_frames[name]) for name in self.task.frames)]
        )

    @property
    def columns_outwards(self) -> list[int]:
        """Columns of the task's twist Jacobian as joints carry each other; see `Robot`."""
        task = self.table
        middle = 1 + int(task[0, task_kernels.FIRST_ROWS])
        first, second = task[1 : middle - 1], task[middle:-1]
        if task[0, task_kernels.KIND] == task_kernels.FRAME:
            path = first
        elif task[0, task_kernels.KIND] == task_kernels.RELATIVE:
            # from the second frame back along its arm, then out along the first's
            path = np.vstack([second[::-1], first])
            if (path[:, 7] == HEADING).any():  # a heading does not turn with its own base as seen from there
                return []
        else:
            return []
        columns = (
            path[path[:, task_kernels.INPUT_COLUMN] >= 0, task_kernels.INPUT_COLUMN].astype(int).tolist()
        )
        return columns if len(set(columns)) == len(columns) else []

    @property
    def ends(self) -> tuple[int, ...]:
        """Rows of ``chain`` and `frames` that are end effectors: frames of the task, and joints that carry no other."""
        count, names = len(self.joints.kind), list(self.named_frames)
        driven = {self.named_frames[name].joint for name in self.task.frames}
        last = {frame.joint: count + k for k, frame in enumerate(self.named_frames.values())}
        leaves = set(last) - set(self.joints.parent.tolist()) - driven - {-1}
        rows = {count + names.index(name) for name in self.task.frames}
        return tuple(sorted(rows | {last[joint] for joint in leaves}))

    def with_task(self, task: PoseTask | str) -> TreeRobot:
        """Return the same robot with something else to be driven.

        Parameters
        ----------
        task
            A `PoseTask`, or the name of a frame.

        Raises
        ------
        UnknownNameError
            If there is no such frame.
        """
        robot = copy(self)
        robot._choose(self.as_task(task))
        return robot

    def as_task(self, task: PoseTask | str) -> PoseTask:
        """Return a task, also of a frame's name, or of ``"center_of_mass"``."""
        if isinstance(task, PoseTask):
            return task
        if task == _MASS and task not in self.named_frames:
            return PoseTask(_MASS, ())
        return PoseTask("frame", (str(task),))

    def from_start(self, q: Array) -> TreeRobot:
        """Return the robot for a run from a configuration: the sign of the relative pose is kept from there on."""
        task = self.for_start(self.task, q)
        return self if task == self.task else self.with_task(task)

    def for_start(self, task: PoseTask | str, q: Array) -> PoseTask:
        """Return a task with the sign that an absolute pose keeps in a run from a configuration."""
        wanted = self.as_task(task)
        if wanted.kind != "absolute" or wanted.sign:
            return wanted
        return replace(wanted, sign=self.relative_sign(q, *wanted.frames))

    def relative_sign(self, q: ArrayLike, first: str, second: str, previous: ArrayLike = 0) -> Any:
        """Return the sign h of x₂*x₁ for which h Re(r) ≥ −0.2: the previous one as long as that allows it.

        Half a turn between the frames then is no place where the absolute pose jumps: it does only 0.2 beyond (at 203°
        between them, and back at 203° the other way round), and then by half a turn. Without a previous sign (0) the
        short way round.
        """
        real = self.pose_of(PoseTask("relative", (first, second)), q)[..., 0]
        last = np.broadcast_to(np.asarray(previous, dtype=np.float64), real.shape)
        short = np.where(real >= 0, 1, -1)
        sign = np.where((last == 0) | (last * real < -_HYSTERESIS), short, last).astype(int)
        return int(sign) if sign.ndim == 0 else sign

    def fkm(self, q: ArrayLike, frame: str | None = None, base: str | None = None) -> Array:
        """Return the pose of the task, or of a named frame seen from the base or another frame, shape (…, 8)."""
        if frame is None:
            return super().fkm(q)
        return self.pose_of(seen_from(frame, base), q)

    def frames(self, q: ArrayLike) -> Array:
        """Return the poses of all joint frames after their screws, then of all named frames: shape (…, N + F, 8)."""
        rows = len(self._tree) - 1
        flat = self._map(task_kernels.tree_frames, q, self.configuration_size, 8 * rows, self._tree)
        return flat.reshape(*flat.shape[:-1], rows, 8)

    def pose_of(self, task: PoseTask | str, q: ArrayLike) -> Array:
        """Return the pose of any task or named frame, shape (…, 8)."""
        return self._map(self.kernels.forward, q, self.configuration_size, 8, self.table_of(task))

    def pose_jacobian_of(self, task: PoseTask | str, q: ArrayLike) -> Array:
        """Return the pose Jacobian of any task or named frame, shape (…, 8, m)."""
        return self._columns(q, self.kernels.kinematics, 0, 8, self.table_of(task))

    def twist_jacobian_of(self, task: PoseTask | str, q: ArrayLike) -> Array:
        """Return the twist Jacobian of any task or named frame, shape (…, 6, m)."""
        return self._columns(q, self.kernels.kinematics, 8, 6, self.table_of(task))

    def kinematics_of(
        self, task: PoseTask | str | Array, q: Array, out: Kinematics | None = None
    ) -> Kinematics:
        """Compute pose and both Jacobians of any task in one pass; fastest with what `table_of` gives."""
        table = task if isinstance(task, np.ndarray) else self.table_of(task)
        found = Kinematics(self.input_size) if out is None else out
        arrays = found.pose, found.pose_jacobian, found.twist_jacobian
        compute = self.kernels.kinematics_apart.compiled
        try:
            status = compute(table, q, *arrays)
        except TypeError:  # a list, integers
            status = compute(table, self._rows("q", q), *arrays)
        if status:
            self._raise(status, q)
        return found

    @property
    def reach(self) -> float:
        """Sum of the distances between neighbouring joints, m: of the longest path to a frame of the task."""
        return max(self._path_length(self._frame(name)) for name in self.task.frames)

    def _path_length(self, frame: NamedFrame) -> float:
        joints, limits = self.joints, self.limits
        rows = joints.path(frame.joint)
        steps = [float(np.linalg.norm(joints.fixed[row, 4:7])) for row in rows[1:]]
        slides = [
            float(np.abs(joints.multiplier[row] * np.array([limits.lower[c], limits.upper[c]])).max())
            for row, c in zip(rows, joints.coordinate[rows], strict=True)
            if joints.kind[row] == PRISMATIC
        ]
        return sum(steps) + sum(slides) + float(np.linalg.norm(frame.pose[4:7]))

    def solve_tasks(
        self,
        poses: Mapping[PoseTask | str, ArrayLike],
        start: ArrayLike | None = None,
        *,
        position_tolerance: float = 1e-6,
        orientation_tolerance: float = 1e-6,
        restarts: int = 400,
        seed: int = 0,
    ) -> Solution:
        """Find one configuration within the joint limits that gives several tasks their poses at once.

        Parameters
        ----------
        poses
            Desired unit dual quaternion, shape (8,), of each task or named frame.
        start, position_tolerance, orientation_tolerance, restarts, seed
            As of `solve`.

        Returns
        -------
        Solution
            Its errors are those of the task that is farthest from its pose.

        Raises
        ------
        ShapeError, ValueRangeError, UnknownNameError
            If a size, value or name is wrong. Poses that cannot be reached are no error: see `Solution`.
        """
        tasks = [self.as_task(task) for task in poses]
        if not tasks:
            raise ShapeError("poses: expected the pose of at least one task, got none")
        problem = self._problem(position_tolerance, orientation_tolerance, restarts, seed)
        targets = [
            unit_pose(f"poses[{task.label}]", pose) for task, pose in zip(tasks, poses.values(), strict=True)
        ]
        guess = problem.middle if start is None else self._rows("start", start)
        if guess.ndim != 1:
            raise ShapeError(f"start: expected one configuration, got shape {guess.shape}")
        q = np.clip(guess, *problem.limits)[None]
        report = self._newton_tasks(tasks, problem, np.concatenate(targets)[None], q)[0]
        success = problem.is_reached(report[0], report[1])
        reason = "" if success else self._why_not(tasks, targets, q[0])
        return Solution(
            q[0], success, float(report[0]), float(report[1]), int(report[2]), int(report[3]), reason
        )

    def _why_not(self, tasks: Sequence[PoseTask], targets: Sequence[Array], q: Array) -> str:
        """Return how far each task is from its pose at the nearest configuration found."""
        parts = []
        for task, target in zip(tasks, targets, strict=True):
            pose = self.pose_of(task, q)
            away = float(np.linalg.norm(positions(pose) - positions(target)))
            turned = 2 * float(np.arccos(min(abs(float(pose[:4] @ target[:4])), 1.0)))
            parts.append(f"{task.label} {away:.3g} m and {turned:.3g} rad")
        return f"unreachable: not all at once; the nearest configuration found has {', '.join(parts)} to go"

    def _newton(self, problem: Problem, poses: Array, q: Array) -> Array:
        return self._newton_tasks([self.task], problem, poses, q)

    def _newton_tasks(self, tasks: Sequence[PoseTask], problem: Problem, poses: Array, q: Array) -> Array:
        """Call the kernel: overwrite q and return the reports."""
        tables = [self._inverse_table(task) for task in tasks]
        begins = np.cumsum([0, *map(len, tables)]).astype(np.float64)
        options = np.array([problem.options[2], *np.tile(problem.options[:2], len(tasks))])
        reports = np.empty((len(poses), 4))
        work = np.empty(task_solver_work.size(len(tasks), self.configuration_size))
        solve_tasks(
            np.vstack(tables), begins, problem.limits, problem.starts, poses, options, q, reports, work
        )
        return reports

    def _inverse_table(self, task: PoseTask) -> Array:
        """Return the table of a task in which each coordinate has an input, those of drives too."""
        table = self.table_of(task).copy()
        rows = table[1:]
        rows[rows[:, 7] > PRISMATIC, 7] = PRISMATIC
        joints = rows[:, 7] != task_kernels.FIXED
        rows[joints, task_kernels.INPUT_COLUMN] = rows[joints, task_kernels.COORDINATE]
        return table

    def table_of(self, task: PoseTask | str) -> Array:
        """Return the table of a task or named frame as compiled code reads it, made once."""
        wanted = self.as_task(task)
        if wanted not in self._tables:
            self._tables[wanted] = self._task_table(wanted)
        return self._tables[wanted]

    def _choose(self, task: PoseTask) -> None:
        if task.kind == _MASS:
            raise ValueRangeError(
                "task: the centre of mass has no orientation, so no law drives it alone; put it beside the law's task "
                "(tasks: [{task: center_of_mass, gain: …}])"
            )
        self.task = task
        self._keep_table(self.table_of(task))

    def _rates(self, q: ArrayLike, u: ArrayLike) -> Array:
        raise ValueRangeError(f"u: rates of Jacobians are known of chains only, and {self.name} is a tree")

    def _raise(self, status: int, q: Any) -> None:
        if status == SINGULAR:
            raise ValueRangeError(
                f"q: both frames of the task are a full turn apart in {self.name}, where they have no absolute pose"
            )
        super()._raise(status, q)

    def _frame(self, name: str) -> NamedFrame:
        if name not in self.named_frames:
            raise unknown_name("frame", name, self.named_frames)
        return self.named_frames[name]

    def _tree_table(self) -> Array:
        """Return the table of all joints and named frames."""
        joints = self.joints
        moved = joints.kind, joints.coordinate, joints.column, joints.multiplier, joints.offset, joints.parent
        # in the order of `pose_task_kernels`
        rows = np.column_stack([joints.fixed, *moved]).astype(np.float64)
        return np.vstack([self._head(), rows, *map(_frame_row, self.named_frames.values())])

    def _head(self, kind: int = 0, sign: int = 0, first_rows: int = 0, second_rows: int = 0) -> Array:
        """Return the first row of a table, in the order of `pose_task_kernels`."""
        row = np.zeros((1, task_kernels.COLUMNS))
        row[0, :5] = kind, sign, first_rows, second_rows, self.configuration_size
        return row

    def _path_to(self, frame: NamedFrame, joints: Sequence[int]) -> Array:
        """Return the rows of joints that carry a frame, and its own."""
        return np.vstack([self._tree[1 + np.array(joints, dtype=np.intp)], _frame_row(frame)])

    def _task_table(self, task: PoseTask) -> Array:
        """Return the table of a task; a relative one leaves out the joints that carry both frames."""
        if task.kind == _MASS:
            return self._mass_table()
        frames = [self._frame(name) for name in task.frames]
        paths = [self.joints.path(frame.joint) for frame in frames]
        if task.kind == "relative":
            shared = sum(1 for _ in takewhile(lambda each: each[0] == each[1], zip(*paths, strict=False)))
            paths = [path[shared:] for path in paths]
        parts = [self._path_to(frame, path) for frame, path in zip(frames, paths, strict=True)]
        if not task.on_frame:
            parts[0][-1, :7] = compose(parts[0][-1, :7], task.offset)
        kind = getattr(task_kernels, (task.root if task.kind == "absolute" else task.kind).upper())
        return np.vstack([self._head(kind, task.sign, *map(len, parts)), *parts])

    def _mass_table(self) -> Array:
        """Return the table of the centre of mass: a path to each body that a joint moves."""
        if self.inertia is None:
            raise ValueRangeError(f"task: {self.name} has no inertia, so its centre of mass is unknown")
        parts = [self._head(task_kernels.CENTER_OF_MASS)]
        for row in np.flatnonzero(self.inertia.mass):
            centre = NamedFrame(int(row), np.array([1.0, 0, 0, 0, *self.inertia.center[row]]))
            parts.append(self._path_to(centre, self.joints.path(centre.joint)))
            parts[-1][-1, task_kernels.MULTIPLIER] = self.inertia.mass[row] / self.inertia.mass.sum()
        return np.vstack(parts)


def seen_from(frame: str, base: str | None) -> PoseTask:
    """Return the task of a frame, seen from the base of the robot or from another frame."""
    return PoseTask("frame", (frame,)) if base is None else PoseTask("relative", (frame, base))


_HYSTERESIS = 0.2  # −cos of half of 203°


def _frame_row(frame: NamedFrame) -> Array:
    row = np.zeros((1, task_kernels.COLUMNS))
    row[0, :7], row[0, 7] = frame.pose, task_kernels.FIXED
    row[0, task_kernels.PARENT], row[0, task_kernels.INPUT_COLUMN] = frame.joint, -1
    return row


def chain_as_tree(robot: Robot) -> TreeRobot:
    """Return a chain as a tree of one branch, whose frames are ``hand`` and, by its name, that of each joint.

    q, inputs and limits are the same. A tree is returned as it is.
    """
    if isinstance(robot, TreeRobot):
        return robot
    joints, frames = joined_chains({_HAND: robot})
    own = {name: NamedFrame(i, shift()) for i, name in enumerate(robot.joint_names) if name != _HAND}
    tree = TreeRobot(
        joints,
        {**frames, **own},
        PoseTask("frame", (_HAND,)),
        joint_names=robot.joint_names,
        joint_types=robot.joint_types,
        limits=robot.limits,
        input_coordinates=robot.input_coordinates,
        drives=robot.drives,
        inertia=robot.inertia,
        name=robot.name,
    )
    tree.input_names = robot.input_names
    return tree


def joined_chains(parts: Mapping[str, Robot]) -> tuple[TreeJoints, dict[str, NamedFrame]]:
    """Return the joints of a base and of two chains at its end, and the frame at the end of each."""
    rows: list[tuple[Any, ...]] = []
    frames, coordinates, inputs = {}, 0, 0
    start, mount = -1, shift()
    for label, part in parts.items():
        columns = np.full(part.configuration_size, -1)
        columns[part.input_coordinates] = inputs + np.arange(part.input_size)
        parent, fixed = start, mount
        for i in range(part.configuration_size):
            row = part.chain[i]
            at = compose(fixed, row[:7]) if i == 0 else row[:7]
            rows.append((at, row[7], parent, coordinates + i, columns[i], 1.0, 0.0))
            parent, fixed = len(rows) - 1, shift()
        end = compose(fixed, part.chain[-1, :7])
        frames[label] = NamedFrame(parent, end)
        if label == _BASE:
            start, mount = parent, end
        coordinates, inputs = coordinates + part.configuration_size, inputs + part.input_size
    names = tuple(distinct_names({label: part.joint_names for label, part in parts.items()}))
    poses, kinds, parents, moved, driven, multipliers, offsets = map(np.array, zip(*rows, strict=True))
    return TreeJoints(poses, kinds, parents, moved, driven, multipliers, offsets, names), frames
