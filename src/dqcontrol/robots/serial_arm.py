"""Serial arms: the data of a chain; what can be computed from it is inherited."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, unknown_name
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.link_shapes import carried_shapes, mirrored_shapes, shapes_in_a_row
from dqcontrol.robots.poses import compose, inverse7, pose7, rotation_x, rotation_y, rotation_z, shift
from dqcontrol.robots.robot import Robot, distinct_names


class SerialArm(Robot):
    """An arm of n revolute or prismatic joints in a row.

    Parameters
    ----------
    fixed
        The n + 1 fixed poses, shape (n + 1, 7): unit quaternion (scalar first) and position (m) of each joint's frame
        in the frame after the joint before it (the first in the base frame), and of the tool after the last joint.
        Each joint turns about or slides along its z axis.
    joint_types
        ``"revolute"`` or ``"prismatic"`` for each joint.
    limits
        Joint limits; none if omitted.
    joint_names
        ``joint_1`` … if omitted.
    name
        Shown in tables.
    inertia
        Link inertias, needed for gravity and physics.

    Attributes
    ----------
    urdf
        The URDF file that it came from and the link in whose frame its poses are, for pictures; None without.
    bare
        Of an arm that `join` gave a base or a tool: the same without, as its file has it, for pictures; None of others.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If a size, a value or a joint type is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm = dqc.SerialArm.from_dh(theta=[0, 0], d=[0, 0], a=[1, 1], alpha=[0, 0])
    >>> dqc.DualQuaternion(arm.fkm([0.0, 0.0])).translation.round(12).tolist()
    [2.0, 0.0, 0.0]
    """

    def __init__(
        self,
        fixed: ArrayLike,
        joint_types: Sequence[str],
        *,
        limits: Limits | None = None,
        joint_names: Sequence[str] | None = None,
        name: str | None = None,
        inertia: Inertia | None = None,
    ) -> None:
        n = len(joint_types)
        table = as_array("fixed", fixed, (n + 1, 7))
        norms = np.linalg.norm(table[:, :4], axis=1)
        if (np.abs(norms - 1) > 1e-6).any():
            raise ValueRangeError(f"fixed: quaternions must have norm 1, got norms {norms}")
        for kind in joint_types:
            if kind not in JOINT_TYPES:
                raise unknown_name("joint_types", str(kind), JOINT_TYPES)
        chain = np.zeros((n + 1, 8))
        chain[:, :7] = table
        chain[:, :4] /= norms[:, None]
        chain[:n, 7] = [JOINT_TYPES.index(kind) for kind in joint_types]
        self.urdf: tuple[Path, str] | None = None
        self.bare: SerialArm | None = None
        self.links: tuple[str, ...] = ()  # of that file, from base to tip
        self.name: str = name or "arm"
        self._keep_chain(chain)
        self.joint_types: tuple[str, ...] = tuple(joint_types)
        self.joint_names: tuple[str, ...] = tuple(joint_names or (f"joint_{i + 1}" for i in range(n)))
        if not isinstance(limits, Limits | None):
            raise ShapeError(f"limits: expected Limits or None, got {limits!r:.80}")
        self.limits: Limits = limits or Limits.none(n)
        self.inertia = inertia
        self.configuration_size = self.input_size = n
        self.input_names, self.input_types = self.joint_names, self.joint_types
        self.input_coordinates: NDArray[np.intp] = np.arange(n)
        self.drives: Array = np.zeros((0, DRIVE_COLUMNS))
        for field, size in (
            ("joint_names", len(self.joint_names)),
            ("limits", len(self.limits.lower)),
            ("limits", len(self.limits.velocity)),
            ("inertia", len(inertia.mass) if inertia is not None else n),
        ):
            if size != n:
                raise ShapeError(f"{field}: the arm has {n} joints, got {size} entries")

    def __repr__(self) -> str:
        return f"SerialArm({self.name!r}, {self.configuration_size} joints)"

    @classmethod
    def from_dh(
        cls,
        theta: ArrayLike,
        d: ArrayLike,
        a: ArrayLike,
        alpha: ArrayLike,
        joint_types: list[str] | None = None,
        convention: str = "standard",
        base: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        limits: Limits | None = None,
        name: str | None = None,
        joint_names: Sequence[str] | None = None,
        inertia: Inertia | None = None,
    ) -> SerialArm:
        """Make an arm from Denavit–Hartenberg parameters.

        Parameters
        ----------
        theta, d, a, alpha
            One number a joint: rad, m, m, rad. The joint variable adds to theta (revolute) or d (prismatic).
        joint_types
            ``"revolute"`` (default) or ``"prismatic"`` for each joint.
        convention
            ``"standard"``: Rz(θ) Tz(d) Tx(a) Rx(α); ``"modified"`` (Craig): Tx(a) Rx(α) Rz(θ) Tz(d).
        base, tool
            Unit dual quaternions (8,): pose of the first frame in the inertial one, and of the tool in the last.
        limits, name, joint_names, inertia
            As for the class.
        """
        fixed, types = chain_from_dh(theta, d, a, alpha, joint_types, convention)
        table = _with_ends(fixed, base, tool)
        return cls(table, types, limits=limits, joint_names=joint_names, name=name, inertia=inertia)

    @classmethod
    def from_denso(
        cls,
        a: ArrayLike,
        b: ArrayLike,
        d: ArrayLike,
        alpha: ArrayLike,
        beta: ArrayLike,
        gamma: ArrayLike,
        joint_types: list[str] | None = None,
        base: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        limits: Limits | None = None,
        name: str | None = None,
        joint_names: Sequence[str] | None = None,
        inertia: Inertia | None = None,
    ) -> SerialArm:
        """Make an arm from the parameters that DENSO gives for its robots, as DQ_SerialManipulatorDenso reads them.

        Parameters
        ----------
        a, b, d, alpha, beta, gamma
            One number a joint, m and rad: Rz(γ + q) T(a, b, d) Rx(α) Ry(β). A prismatic joint adds q to d.
        joint_types, base, tool, limits, name, joint_names, inertia
            As for `from_dh`.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> arm = dqc.SerialArm.from_denso([0.3], [0.1], [0.2], [0], [0], [0])
        >>> dqc.DualQuaternion(arm.fkm([0.0])).translation.round(12).tolist()
        [0.3, 0.1, 0.2]
        """
        fixed, types = chain_from_denso(a, b, d, alpha, beta, gamma, joint_types)
        table = _with_ends(fixed, base, tool)
        return cls(table, types, limits=limits, joint_names=joint_names, name=name, inertia=inertia)

    @classmethod
    def join(cls, parts: Sequence[SerialArm | ArrayLike], name: str | None = None) -> SerialArm:
        """Make one arm of several in a row, each at the end of the one before.

        Parameters
        ----------
        parts
            Arms, and unit dual quaternions (8,) that stand for fixed poses between, before or after them.
        name
            Of the whole; the names of the arms joined by ``+`` if omitted.

        Returns
        -------
        SerialArm
            Limits, joint names and inertias are kept; joint names that occur twice are preceded by the number of
            their arm, ``2/joint_1``. Without inertias if an arm has none.

        Raises
        ------
        ShapeError, ValueRangeError
            If there is no arm, or a part is neither an arm nor a pose.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> arm = dqc.load_robot("iiwa7")
        >>> dqc.SerialArm.join([arm, dqc.DualQuaternion.from_translation([0, 0, 0.1]), arm]).joint_names[7]
        '2/joint_1'
        """
        arms: list[SerialArm] = []
        fixed = [shift()]
        for i, part in enumerate(parts):
            if isinstance(part, SerialArm):
                arms.append(part)
                fixed[-1] = compose(fixed[-1], part.chain[0, :7])
                fixed.extend(part.chain[1:, :7])
            else:
                fixed[-1] = compose(fixed[-1], pose7(f"parts[{i}]", part))
        if not arms:
            raise ShapeError(f"parts: expected at least one SerialArm, got {len(parts)} parts without any")
        joined = SerialArm(
            np.array(fixed),
            [kind for arm in arms for kind in arm.joint_types],
            limits=joined_limits([arm.limits for arm in arms]),
            joint_names=distinct_names({str(i): arm.joint_names for i, arm in enumerate(arms, 1)}),
            name=name or "+".join(arm.name for arm in arms),
            inertia=joined_inertia([arm.inertia for arm in arms]),
        )
        firsts = np.cumsum([0, *(arm.configuration_size for arm in arms)]).tolist()
        if len(arms) == 1:
            joined.bare = arms[0].bare or arms[0]
        joined.shapes = shapes_in_a_row(
            (first, carried_shapes(arm.shapes, arm.chain[0, :7], joined.chain[first, :7]))
            for first, arm in zip(firsts, arms, strict=False)
        )
        return joined

    def up_to(self, joint: str | int) -> SerialArm:
        """Return the arm that ends after a joint: its pose and Jacobians are those of that joint's frame.

        Parameters
        ----------
        joint
            Name of the last joint, or its number from 1.

        Raises
        ------
        UnknownNameError, ValueRangeError
            If there is no such joint.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> dqc.load_robot("iiwa7").up_to("joint_4").fkm([0.1, 0.2, 0.3, 0.4]).shape
        (8,)
        """
        n = self.configuration_size
        if isinstance(joint, str):
            if joint not in self.joint_names:
                raise unknown_name("joint", joint, self.joint_names)
            count = self.joint_names.index(joint) + 1
        elif isinstance(joint, int | np.integer) and not isinstance(joint, bool) and 1 <= joint <= n:
            count = int(joint)
        else:
            raise ValueRangeError(
                f"joint: must be the name of a joint or a number from 1 to {n}, got {joint!r}"
            )
        inertia = self.inertia
        return SerialArm(
            np.vstack([self.chain[:count, :7], shift()]),
            self.joint_types[:count],
            limits=self._limits_of(slice(count)),
            joint_names=self.joint_names[:count],
            name=self.name if count == n else f"{self.name} up to {self.joint_names[count - 1]}",
            inertia=inertia and Inertia(inertia.mass[:count], inertia.center[:count], inertia.tensor[:count]),
        )

    def reversed(self) -> SerialArm:
        """Return the arm seen from its tool: fkm is the conjugate of this one's, joints come in reverse order.

        Without inertias: the body that the last joint then moves is this arm's base, which has none.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> arm = dqc.load_robot("iiwa7")
        >>> back = dqc.DualQuaternion(arm.reversed().fkm([0.1] * 7))
        >>> bool((back * dqc.DualQuaternion(arm.fkm([0.1] * 7))).isclose(dqc.DualQuaternion.identity()))
        True
        """
        # the conjugate of a screw by q is one by −q; a half turn about x makes that one by q again
        back = [inverse7(row) for row in self.chain[::-1, :7]]
        turn = rotation_x(np.pi)
        fixed = [compose(inverse7(turn), pose, turn) for pose in back]
        fixed[0], fixed[-1] = compose(back[0], turn), compose(inverse7(turn), back[-1])
        return SerialArm(
            np.array(fixed),
            self.joint_types[::-1],
            limits=self._limits_of(slice(None, None, -1)),
            joint_names=self.joint_names[::-1],
            name=f"{self.name} reversed",
        )

    def mirrored(self) -> SerialArm:
        """Return the mirror image in the plane y = 0 of the base frame: a left arm of a right one.

        At the same q, end effector and axes are mirror images: p = (x, y, z) becomes (x, −y, z), a turn about n = (a,
        b, c) one about (−a, b, −c). Limits and inertias are those of this arm; left and right change in the names of
        joints.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> arm, q = dqc.load_robot("panda"), [0.3, -0.6, 0.1, -2.2, 0, 1.6, 0.8]
        >>> right, left = (dqc.DualQuaternion(each.fkm(q)).translation for each in (arm, arm.mirrored()))
        >>> abs(left - right * [1, -1, 1]).round(12).tolist()
        [0.0, 0.0, 0.0]
        """
        # Reflection of a frame in y takes (w, x, y, z) to (w, −x, y, −z) and y to −y. It turns rotations about z
        # around, but not displacements along it: a half turn of each revolute joint's frame about its own x axis makes
        # its angle the same, and the reflected axis the opposite one.
        fixed = [row * np.array([1.0, -1, 1, -1, 1, -1, 1]) for row in self.chain[:, :7]]
        turn = rotation_x(np.pi)
        for i, kind in enumerate(self.joint_types):
            if kind == "revolute":
                fixed[i], fixed[i + 1] = compose(fixed[i], turn), compose(inverse7(turn), fixed[i + 1])
        flips = np.array([[1.0, 1, -1] if kind == "revolute" else [1.0, -1, 1] for kind in self.joint_types])
        tensor_flips, body = flips[:, :, None] * flips[:, None, :], self.inertia
        image = SerialArm(
            np.array(fixed),
            self.joint_types,
            limits=self.limits,
            joint_names=[
                re.sub("left|right", lambda side: _OTHER[side[0]], name) for name in self.joint_names
            ],
            name=self.name,
            inertia=body and Inertia(body.mass, body.center * flips, body.tensor * tensor_flips),
        )
        image.shapes = mirrored_shapes(self.shapes, np.vstack([[1.0, -1, 1], flips]))
        return image

    def _limits_of(self, joints: slice) -> Limits:
        limits = self.limits
        return Limits(
            limits.lower[joints], limits.upper[joints], limits.velocity[joints], limits.effort[joints]
        )


_OTHER = {"left": "right", "right": "left"}


def joined_limits(limits: list[Limits]) -> Limits:
    """Return the limits of several robots, one after the other."""
    fields = ("lower", "upper", "velocity", "effort")
    return Limits(*(np.concatenate([getattr(lim, field) for lim in limits]) for field in fields))


def joined_inertia(bodies: list[Inertia | None]) -> Inertia | None:
    """Return the bodies of several robots, one after the other; None if those of one are not known."""
    known = [body for body in bodies if body is not None]
    if len(known) < len(bodies):
        return None
    fields = ("mass", "center", "tensor")
    return Inertia(*(np.concatenate([getattr(body, field) for body in known]) for field in fields))


def _with_ends(fixed: list[Array], base: ArrayLike | None, tool: ArrayLike | None) -> Array:
    """Return the fixed poses with base and tool added."""
    if base is not None:
        fixed[0] = compose(pose7("base", base), fixed[0])
    if tool is not None:
        fixed[-1] = compose(fixed[-1], pose7("tool", tool))
    return np.array(fixed)


JOINT_TYPES = ("revolute", "prismatic")
CONVENTIONS = ("standard", "modified")  # of DH tables


def chain_from_dh(
    theta: ArrayLike,
    d: ArrayLike,
    a: ArrayLike,
    alpha: ArrayLike,
    joint_types: list[str] | None,
    convention: str,
) -> tuple[list[Array], list[str]]:
    """Return the n + 1 fixed poses (7,) and the n joint types of a DH table.

    Standard: X = Rz(θ) Tz(d) Tx(a) Rx(α); modified (Craig): X = Tx(a) Rx(α) Rz(θ) Tz(d). The joint variable adds to θ
    (revolute) or to d (prismatic); both commute with the rest of Rz Tz, so each X is a fixed pose and a screw about z.
    """
    rows, types = _table({"theta": theta, "d": d, "a": a, "alpha": alpha}, joint_types)
    if convention not in CONVENTIONS:
        raise unknown_name("convention", convention, CONVENTIONS)

    fixed = [shift()]
    for th, dd, aa, al in rows:
        about_z, about_x = compose(rotation_z(th), shift(z=dd)), compose(shift(x=aa), rotation_x(al))
        if convention == "standard":
            fixed.append(compose(about_z, about_x))
        else:
            fixed[-1] = compose(fixed[-1], about_x, about_z)
            fixed.append(shift())
    return fixed, types


def chain_from_denso(
    a: ArrayLike,
    b: ArrayLike,
    d: ArrayLike,
    alpha: ArrayLike,
    beta: ArrayLike,
    gamma: ArrayLike,
    joint_types: list[str] | None,
) -> tuple[list[Array], list[str]]:
    """Return the n + 1 fixed poses (7,) and the n joint types of a table in DENSO's convention.

    X = Rz(γ) T(a, b, d) Rx(α) Ry(β); the joint variable adds to γ (revolute) or to d (prismatic).
    """
    rows, types = _table({"a": a, "b": b, "d": d, "alpha": alpha, "beta": beta, "gamma": gamma}, joint_types)
    fixed = [shift()]
    for aa, bb, dd, al, be, ga in rows:
        fixed.append(compose(rotation_z(ga), shift(aa, bb, dd), rotation_x(al), rotation_y(be)))
    return fixed, types


def _table(parameters: dict[str, ArrayLike], joint_types: list[str] | None) -> tuple[Array, list[str]]:
    """Return one row of parameters a joint, and the joint types."""
    columns = {field: as_array(field, value, (None,)) for field, value in parameters.items()}
    first = next(iter(columns))
    n = len(columns[first])
    if n == 0:
        raise ShapeError(f"{first}: a robot needs at least one joint")
    for field, value in columns.items():
        if value.shape != (n,):
            raise ShapeError(f"{field}: expected {n} numbers as in {first}, got shape {value.shape}")
    types = list(joint_types) if joint_types is not None else ["revolute"] * n
    if len(types) != n:
        raise ShapeError(f"joint_types: expected {n} entries, got {len(types)}")
    return np.column_stack(list(columns.values())), types
