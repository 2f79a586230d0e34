"""Chains made of chains: several in a row, the first part of one, one backwards."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.robots.dh import compose, rotation_x, shift
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.link_shapes import carried_shapes, mirrored_shapes, shapes_in_a_row
from dqcontrol.robots.poses import inverse7, pose7

if TYPE_CHECKING:  # at run time the class comes as an argument: its module imports this one
    from dqcontrol.robots.serial_arm import SerialArm


def join(arm_class: type[SerialArm], parts: Sequence[SerialArm | ArrayLike], name: str | None) -> SerialArm:
    """Return one arm of several in a row; see `SerialArm.join`."""
    arms: list[SerialArm] = []
    fixed = [shift()]
    for i, part in enumerate(parts):
        if isinstance(part, arm_class):
            arms.append(part)
            fixed[-1] = compose(fixed[-1], part.chain[0, :7])
            fixed.extend(part.chain[1:, :7])
        else:
            fixed[-1] = compose(fixed[-1], pose7(f"parts[{i}]", cast(ArrayLike, part)))
    if not arms:
        raise ShapeError(f"parts: expected at least one SerialArm, got {len(parts)} parts without any")
    joined = arm_class(
        np.array(fixed),
        [kind for arm in arms for kind in arm.joint_types],
        limits=joined_limits([arm.limits for arm in arms]),
        joint_names=_distinct_names(arms),
        name=name or "+".join(arm.name for arm in arms),
        inertia=joined_inertia([arm.inertia for arm in arms]),
    )
    firsts = np.cumsum([0, *(arm.configuration_size for arm in arms)])
    if len(arms) == 1:
        joined.bare = arms[0].bare or arms[0]
    joined.shapes = shapes_in_a_row(
        (int(first), carried_shapes(arm.shapes, arm.chain[0, :7], joined.chain[first, :7]))
        for first, arm in zip(firsts, arms, strict=False)
    )
    return joined


def up_to(arm_class: type[SerialArm], arm: SerialArm, joint: str | int) -> SerialArm:
    """Return the arm that ends after a joint; see `SerialArm.up_to`."""
    n = arm.configuration_size
    if isinstance(joint, str):
        if joint not in arm.joint_names:
            raise unknown_name("joint", joint, arm.joint_names)
        count = arm.joint_names.index(joint) + 1
    elif isinstance(joint, int | np.integer) and not isinstance(joint, bool) and 1 <= joint <= n:
        count = int(joint)
    else:
        raise ValueRangeError(f"joint: must be the name of a joint or a number from 1 to {n}, got {joint!r}")
    inertia = arm.inertia
    return arm_class(
        np.vstack([arm.chain[:count, :7], shift()]),
        arm.joint_types[:count],
        limits=_limits_at(arm.limits, slice(count)),
        joint_names=arm.joint_names[:count],
        name=arm.name if count == n else f"{arm.name} up to {arm.joint_names[count - 1]}",
        inertia=inertia and Inertia(inertia.mass[:count], inertia.center[:count], inertia.tensor[:count]),
    )


def reverse(arm_class: type[SerialArm], arm: SerialArm) -> SerialArm:
    """Return the arm seen from its tool; see `SerialArm.reversed`.

    The conjugate of a screw by q is one by −q; a half turn about x makes that one by q again.
    """
    back = [inverse7(row) for row in arm.chain[::-1, :7]]
    turn = rotation_x(np.pi)
    fixed = [compose(inverse7(turn), pose, turn) for pose in back]
    fixed[0], fixed[-1] = compose(back[0], turn), compose(inverse7(turn), back[-1])
    return arm_class(
        np.array(fixed),
        arm.joint_types[::-1],
        limits=_limits_at(arm.limits, slice(None, None, -1)),
        joint_names=arm.joint_names[::-1],
        name=f"{arm.name} reversed",
    )


def _limits_at(limits: Limits, part: slice) -> Limits:
    return Limits(limits.lower[part], limits.upper[part], limits.velocity[part], limits.effort[part])


def mirror(arm_class: type[SerialArm], arm: SerialArm) -> SerialArm:
    """Return the mirror image of an arm in the plane y = 0; see `SerialArm.mirrored`.

    Reflection of a frame in y takes (w, x, y, z) to (w, −x, y, −z) and y to −y. It turns rotations about z around, but
    not displacements along it: a half turn of each revolute joint's frame about its own x axis makes its angle the
    same, and the reflected axis the opposite one.
    """
    flip = np.array([1.0, -1, 1, -1, 1, -1, 1])
    fixed = [row * flip for row in arm.chain[:, :7]]
    turn = rotation_x(np.pi)
    for i, kind in enumerate(arm.joint_types):
        if kind == "revolute":
            fixed[i], fixed[i + 1] = compose(fixed[i], turn), compose(inverse7(turn), fixed[i + 1])
    flips = _mirrored_axes(arm.joint_types)
    image = arm_class(
        np.array(fixed),
        arm.joint_types,
        limits=arm.limits,
        joint_names=[_other_side(name) for name in arm.joint_names],
        name=arm.name,
        inertia=arm.inertia and _mirrored_inertia(arm.inertia, flips),
    )
    image.shapes = mirrored_shapes(arm.shapes, np.vstack([[1.0, -1, 1], flips]))
    return image


def _other_side(name: str) -> str:
    """Return a joint's name with left and right changed for each other."""
    return re.sub("left|right", lambda side: "right" if side[0] == "left" else "left", name)


def _mirrored_axes(joint_types: Sequence[str]) -> Array:
    """Return the signs of the axes of each joint's frame in the mirror image."""
    return np.array(
        [
            np.array([1.0, -1, 1]) * (np.array([1.0, -1, -1]) if kind == "revolute" else 1.0)
            for kind in joint_types
        ]
    )


def _mirrored_inertia(inertia: Inertia, flip: Array) -> Inertia:
    return Inertia(inertia.mass, inertia.center * flip, inertia.tensor * flip[:, :, None] * flip[:, None, :])


def joined_limits(limits: list[Limits]) -> Limits:
    """Return the limits of several robots, one after the other."""
    fields = ("lower", "upper", "velocity", "effort")
    return Limits(*(np.concatenate([getattr(lim, field) for lim in limits]) for field in fields))


def joined_inertia(bodies: list[Inertia | None]) -> Inertia | None:
    """Return the bodies of several robots, one after the other; None if those of one are not known."""
    known = [body for body in bodies if body is not None]
    if len(known) < len(bodies):
        return None
    return Inertia(
        *(np.concatenate([getattr(b, field) for b in known]) for field in ("mass", "center", "tensor"))
    )


def _distinct_names(arms: list[SerialArm]) -> list[str]:
    counts = Counter(name for arm in arms for name in arm.joint_names)
    return [
        name if counts[name] == 1 else f"{number}/{name}"
        for number, arm in enumerate(arms, 1)
        for name in arm.joint_names
    ]
