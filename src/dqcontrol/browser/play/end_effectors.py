"""Targets of each end effector, and the tasks of the law and beside it that follow from them."""

from __future__ import annotations

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.loop.live import Live
from dqcontrol.robots import PoseTask, TreeRobot

LAW = ""  # name of the handle of what the law drives, where that is none of the end effectors


class EndEffectors:
    """What a robot is dragged by: its end effectors if tasks say where each is to be, else what its law drives.

    Two arms whose law drives what lies between both hands, with how they hold it beside it, are dragged by either hand,
    or by what lies between: then both go along.

    Parameters
    ----------
    live
        The robot.

    Attributes
    ----------
    frames
        Names of the end effectors; empty where what the law drives is dragged alone.
    """

    frames: tuple[str, ...]

    def __init__(self, live: Live) -> None:
        self._live = live
        self._wanted: dict[str, Array] = {}
        self._told: Array | None = None  # the law's target that follows from these
        self._law: PoseTask | None = live.robot.task if isinstance(live.robot, TreeRobot) else None
        self._tasks: dict[int, PoseTask] = {}
        self.frames = ()
        further = live.control.law.tasks
        if self._law is None or further is None:
            return
        self._tasks = {
            i: task
            for i, (task, part) in enumerate(zip(further.tasks, further.parts, strict=True))
            if task is not None and task.kind != "center_of_mass" and task.on_frame and part == "pose"
        }
        known = [self._law, *self._tasks.values()]
        frames = tuple(dict.fromkeys(name for task in known for name in task.frames))
        if 1 < len(frames) <= len(known) and self._law.on_frame and self._law.kind != "center_of_mass":
            self.frames = frames

    @property
    def aimed(self) -> tuple[int, ...]:
        """Numbers of the further tasks that they are dragged by."""
        return tuple(self._tasks) if self.frames else ()

    @property
    def labels(self) -> tuple[str, str]:
        """What the law drives, and what further tasks do; empty where what the law drives is dragged alone."""
        if not self.frames or self._law is None:
            return "", ""
        further = dict.fromkeys(_label(task) for task in self._tasks.values())
        return _label(self._law), ", ".join(further)

    @property
    def further_error(self) -> float:
        """How far the further task that is farthest off is from its moving target, m; NaN without one."""
        here = {name: self._frame(name) for name in self.frames}
        pairs = ((self._live.aimed(i), self._tasks[i].of_frames(here)) for i in self.aimed)
        away = (algebra.translation(wanted) - algebra.translation(at) for wanted, at in pairs)
        return max((float(np.linalg.norm(each)) for each in away), default=np.nan)

    @property
    def handles(self) -> dict[str, Array]:
        """Where each of them is to be, or is where nothing is said, shape (8,), inertial frame."""
        live = self._live
        if not self.frames:
            target = live.target
            return {LAW: self.in_room(live.state.pose if target is None else target)}
        found = self._poses()
        if self._law is not None and self._law.kind == "absolute":
            found[LAW] = self._law.of_frames(found)
        return found

    def in_room(self, pose: Array) -> Array:
        """Return a pose of the law's task, shape (8,), in the inertial frame: a relative one is seen from a hand."""
        if self._law is None or self._law.kind != "relative":
            return pose
        return algebra.multiply(self._frame(self._law.frames[1]), pose)

    def drag(self, name: str, pose: Array) -> None:
        """Take one to a pose, shape (8,), inertial frame; what the law drives takes all along. NaN: all stay."""
        live = self._live
        if not np.isfinite(pose).all():
            self._wanted.clear()
            live.hold()
            return
        if not self.frames:
            if self._law is not None and self._law.kind == "relative":
                pose = algebra.multiply(algebra.conjugate(self._frame(self._law.frames[1])), pose)
            live.target = pose
            return
        poses = self._poses()
        if name in self.frames:
            poses[name] = pose
        else:
            assert self._law is not None
            moved = algebra.multiply(pose, algebra.conjugate(self._law.of_frames(poses)))
            poses = {each: algebra.multiply(moved, own) for each, own in poses.items()}
        self._wanted = poses
        self._aim()

    def go_on_from(self, before: EndEffectors) -> None:
        """Go to where others of the same robot were to be."""
        if before.frames != self.frames or not self.frames:
            if (target := before._live.target) is not None:
                self._live.target = target
        elif before._told is not None:
            self._wanted = before._poses()
            self._aim()

    def _aim(self) -> None:
        assert self._law is not None
        self._told = self._live.target = self._law.of_frames(self._wanted)
        for i, task in self._tasks.items():
            self._live.aim(i, task.of_frames(self._wanted))

    def _poses(self) -> dict[str, Array]:
        """Return where each end effector is to be, or is once another one says where to go: a device, a reference."""
        target = self._live.target
        if self._told is None or target is None or not np.array_equal(target, self._told):
            self._wanted = {}
        return self._wanted | {name: self._frame(name) for name in self.frames if name not in self._wanted}

    def _frame(self, name: str) -> Array:
        """Return where a frame is."""
        robot = self._live.robot
        assert isinstance(robot, TreeRobot)
        return robot.fkm(self._live.plant.q, name)


def _label(task: PoseTask) -> str:
    return " to ".join(task.frames)
