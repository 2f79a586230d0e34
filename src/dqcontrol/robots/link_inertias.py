"""The bodies of a URDF chain: everything that moves with a joint, as one rigid body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.robots.kinematics.axes import rotation_matrix
from dqcontrol.robots.limits import Inertia


def lump(
    chain: Sequence[Any],
    children: Mapping[str, Sequence[Any]],
    links: Mapping[str, Any],
    turns: Sequence[Array],
) -> Inertia | None:
    """Return the body of each moving joint: its link and all links below, without those of the next joint.

    Parameters
    ----------
    chain
        The moving joints of the arm, from base to tip.
    children
        The joints below each link; those off the chain are held at zero.
    links
        The links, with their inertials.
    turns
        For each moving joint the pose (7,) of the arm's joint frame in the URDF's.

    Returns
    -------
    Inertia
        In the arm's joint frames, or None if there is no mass at all.
    """
    n = len(chain)
    mass, center, tensor = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    for i, joint in enumerate(chain):
        parts = []
        pending = [(joint.child, np.eye(4))]
        while pending:
            link, pose = pending.pop()
            if (part := _part(links[link], pose)) is not None:
                parts.append(part)
            for below in children[link]:
                if i + 1 == n or below is not chain[i + 1]:
                    pending.append((below.child, pose if below.origin is None else pose @ below.origin))
        turn = rotation_matrix(turns[i])
        mass[i] = sum(m for m, _, _ in parts)
        if mass[i] > 0:
            middle = sum(m * c for m, c, _ in parts) / mass[i]
            about = sum(t + m * _steiner(c - middle) for m, c, t in parts)
            center[i], tensor[i] = turn.T @ middle, turn.T @ about @ turn
    return Inertia(mass, center, tensor) if mass.any() else None


def _part(link: Any, pose: Array) -> tuple[float, Array, Array] | None:
    """Return mass, centre and tensor of one link, in the frame in which its pose is given."""
    inertial = link.inertial
    if inertial is None or not inertial.mass:
        return None
    frame = pose if inertial.origin is None else pose @ inertial.origin
    own = np.zeros((3, 3)) if inertial.inertia is None else inertial.inertia
    return inertial.mass, frame[:3, 3], frame[:3, :3] @ own @ frame[:3, :3].T


def _steiner(offset: Array) -> Array:
    return (offset @ offset) * np.eye(3) - np.outer(offset, offset)
