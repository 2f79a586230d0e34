"""Two arms as one robot: what their end effectors do relative to each other, and together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS
from dqcontrol.robots.link_shapes import LinkShape, LinkShapes
from dqcontrol.robots.poses import pose8, shift
from dqcontrol.robots.robot import Form, Robot, distinct_names
from dqcontrol.robots.serial_arm import joined_inertia, joined_limits
from dqcontrol.robots.tree_robot import PoseTask, Root, TaskKind, TreeRobot, joined_chains

TwoArmsTask: TypeAlias = Literal["relative", "absolute", "left", "right"]
_LEFT, _RIGHT = "left", "right"


class TwoArms(TreeRobot):
    """Two arms in one frame, side by side or on a common base: the cooperative dual task space. [Adorno 2011]

    q holds the coordinates of the left arm, then those of the right one; of a common base before both. So do inputs and
    columns of Jacobians. A law drives one of four poses: each end effector's, the relative one x_r = x₂*x₁, which is
    the left end effector seen from the right, and the absolute one x_a = x₂ x_r^½, which lies between both end
    effectors.

    Parameters
    ----------
    left, right
        Arms, or robots with bases, with poses in the same frame: that of the base's end if there is one.
    base
        What carries both: a torso, a drive.
    task
        What laws drive: ``"relative"``, ``"absolute"``, ``"left"`` or ``"right"``.
    root
        Of the absolute pose: see `PoseTask`.
    name
        The names of the parts joined by ``+`` if omitted.

    Attributes
    ----------
    left, right, base
        As given.
    parts
        What it was made of, in the order of the coordinates.

    Raises
    ------
    ShapeError, UnknownNameError
        If a part is no chain, or a name is unknown.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> panda, shift = dqc.load_robot("panda"), dqc.DualQuaternion.from_translation
    >>> left = dqc.SerialArm.join([shift([0, 0.4, 0]), panda])
    >>> right = dqc.SerialArm.join([shift([0, -0.4, 0]), panda])
    >>> arms = dqc.TwoArms(left, right)
    >>> q = np.array([0, -0.6, 0, -2.2, 0, 1.6, 0.8] * 2)
    >>> round(float(np.linalg.norm(dqc.DualQuaternion(arms.relative_pose(q)).translation)), 6)  # m apart
    0.8
    >>> arms.absolute_pose_jacobian(q).shape
    (8, 14)
    """

    def __init__(
        self,
        left: Robot,
        right: Robot,
        *,
        base: Robot | None = None,
        task: TwoArmsTask = "relative",
        root: Root = "midpoint",
        name: str | None = None,
    ) -> None:
        parts = {"base": base, _LEFT: left, _RIGHT: right}
        for field, part in parts.items():
            if not isinstance(part, Robot | (type(None) if field == "base" else Robot)):
                raise ShapeError(f"{field}: expected an arm or a whole body, got {part!r:.80}")
            if isinstance(part, TreeRobot):
                raise ShapeError(f"{field}: {part.name} is a tree already; choose two of its frames instead")
        self.left = left
        self.right = right
        self.base = base
        known = {label: part for label, part in parts.items() if part is not None}
        joints, frames = joined_chains(known)
        robots = list(known.values())
        firsts = np.cumsum([0, *(robot.configuration_size for robot in robots)]).tolist()
        placed = list(zip(firsts, robots, strict=False))
        super().__init__(
            joints,
            frames,
            self._named_task(task, root),
            joint_names=distinct_names({label: robot.joint_names for label, robot in known.items()}),
            joint_types=[kind for robot in robots for kind in robot.joint_types],
            limits=joined_limits([robot.limits for robot in robots]),
            input_coordinates=np.concatenate([robot.input_coordinates + first for first, robot in placed]),
            drives=np.vstack([robot.drives + first * np.eye(1, DRIVE_COLUMNS) for first, robot in placed]),
            inertia=joined_inertia([robot.inertia for robot in robots]),
            name=name or "+".join(robot.name for robot in robots),
        )
        self.parts: tuple[Robot, ...] = tuple(robots)
        self.bases = tuple((first + at, kind) for first, part in placed for at, kind in part.bases)
        self.driven_bases = tuple(base for part in robots for base in part.driven_bases)
        self.shapes: LinkShapes | None = _joined_shapes(known)
        self.input_names: tuple[str, ...] = tuple(
            distinct_names({label: robot.input_names for label, robot in known.items()})
        )
        self._relative = self.table_of(self._named_task("relative", "midpoint"))
        self._short, self._positive, self._negative = (
            {
                each: self.table_of(PoseTask("absolute", (_LEFT, _RIGHT), each, sign))
                for each in get_args(Root)
            }
            for sign in (0, 1, -1)
        )

    def as_task(self, task: PoseTask | str) -> PoseTask:
        """Return a task: a `PoseTask`, one of the four names, or the name of a frame."""
        if isinstance(task, str) and task in get_args(TwoArmsTask):
            return self._named_task(task, self.task.root)
        return super().as_task(task)

    def in_form(self, form: Form) -> TreeRobot:
        """Return the same robot with constrained or unconstrained inputs of its bases; see `WholeBody`."""
        left, right, base = self.left.in_form(form), self.right.in_form(form), self.base
        return TwoArms(left, right, base=base and base.in_form(form), name=self.name).with_task(self.task)

    def _base_accelerations(self) -> Array:
        return np.concatenate([part.acceleration_limits("limits") for part in self.parts])

    def relative_pose(self, q: ArrayLike) -> Array:
        """Return x_r = x₂*x₁, the left hand seen from the right one, shape (…, 8).

        Its sign follows q without a jump: it is not made short.
        """
        return self._map(self.kernels.forward, q, self.configuration_size, 8, self._relative)

    def absolute_pose(self, q: ArrayLike, root: Root = "midpoint", sign: ArrayLike | None = None) -> Array:
        """Return x_a = x₂ x_r^½, shape (…, 8), inertial frame.

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.
        root
            ``"midpoint"``: the position is midway between the end effectors, the orientation half the relative rotation
            away from both. [Adorno 2011] ``"screw"``: x_a is half a screw motion away from both.
        sign
            h = ±1 of h x_r, whose root is taken, shape (…): see `hands_sign`. The short way round if omitted, which
            turns x_a by half a turn where the relative angle passes π.

        Raises
        ------
        ShapeError, ValueRangeError, UnknownNameError
            If a size, value or name is wrong, or the end effectors are a full turn apart with the sign given.
        """
        forward, n = self.kernels.forward, self.configuration_size
        return self._by_sign(lambda rows, table: self._map(forward, rows, n, 8, table), q, root, sign)

    def relative_pose_jacobian(self, q: ArrayLike) -> Array:
        """Return J with vec8(ẋ_r) = J u, shape (…, 8, m)."""
        return self._columns(q, self.kernels.kinematics, 0, 8, self._relative)

    def absolute_pose_jacobian(
        self, q: ArrayLike, root: Root = "midpoint", sign: ArrayLike | None = None
    ) -> Array:
        """Return J with vec8(ẋ_a) = J u, shape (…, 8, m); parameters as of `absolute_pose`."""
        kinematics = self.kernels.kinematics
        return self._by_sign(lambda rows, table: self._columns(rows, kinematics, 0, 8, table), q, root, sign)

    def hands_sign(self, q: ArrayLike, previous: ArrayLike = 0) -> Any:
        """Return the sign h of x_r to take the root of, 1 or −1, shape (…).

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.
        previous
            That of the sample before, shape (…): it is kept as long as h Re(r) ≥ −0.2, up to a relative angle of 203°.
            0: the short way round.

        Examples
        --------
        >>> import numpy as np, dqcontrol as dqc
        >>> stick = dqc.SerialArm.from_dh(theta=[0], d=[0], a=[1], alpha=[0])
        >>> arms = dqc.TwoArms(stick, stick)
        >>> [arms.hands_sign([np.radians(angle), 0.0], previous=1) for angle in (179, 181, 202, 204)]
        [1, 1, 1, -1]
        """
        return self.relative_sign(q, _LEFT, _RIGHT, previous)

    def _by_sign(
        self, function: Callable[[ArrayLike, Array], Array], q: ArrayLike, root: Root, sign: ArrayLike | None
    ) -> Array:
        """Return what a function makes of configurations and the absolute pose's table of each one's sign."""
        if root not in get_args(Root):
            raise unknown_name("root", str(root), get_args(Root))
        if sign is None:
            return function(q, self._short[root])
        signs = np.asarray(sign, dtype=np.float64)
        if not (np.abs(signs) == 1).all():
            raise ValueRangeError(f"sign: must be 1 or -1, got {sign!r:.80}")
        rows = self._rows("q", q)
        signs = np.broadcast_to(signs, rows.shape[:-1])
        plus = function(rows[signs > 0], self._positive[root])
        out = np.empty((*signs.shape, *plus.shape[1:]))
        out[signs > 0], out[signs < 0] = plus, function(rows[signs < 0], self._negative[root])
        return out

    def _named_task(self, task: str, root: str) -> PoseTask:
        for field, name, allowed in (("task", task, TwoArmsTask), ("root", root, Root)):
            if name not in get_args(allowed):
                raise unknown_name(field, str(name), get_args(allowed))
        if task in (_LEFT, _RIGHT):
            return PoseTask("frame", (task,), cast(Root, root))
        return PoseTask(cast(TaskKind, task), (_LEFT, _RIGHT), cast(Root, root))


def _joined_shapes(parts: dict[str, Robot]) -> LinkShapes | None:
    """Return the shapes of all parts, ``left/NAME``; those of one arm are kept apart from those of the other."""
    found, owners, pairs = [], [], []
    first, start, mount = 0, 0, shift()
    for label, part in parts.items():
        own, count = part.shapes or LinkShapes(()), len(found)
        move = pose8(mount)
        for each in own.shapes:
            frame = each.frame + first if each.frame else start
            shape = each.shape if each.frame else each.shape.moved(move)
            found.append(LinkShape(f"{label}/{each.name}", frame, shape))
            owners.append(label)
        pairs += [(a + count, b + count) for a, b in own.pairs]
        first += part.configuration_size
        if label == "base":
            start, mount = first, part.chain[-1, :7]
    sides = [[i for i, owner in enumerate(owners) if owner == label] for label in (_LEFT, _RIGHT)]
    pairs += [(a, b) for a in sides[0] for b in sides[1] if max(found[a].frame, found[b].frame) > start]
    return LinkShapes(tuple(found), tuple(pairs)) if found else None
