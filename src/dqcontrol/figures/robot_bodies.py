"""Bodies to draw: meshes that move with the frames of a robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.figures.solids import Surface, box, rod
from dqcontrol.figures.urdf_shapes import placed_shapes, pose_matrix, urdf_shapes
from dqcontrol.robots import (
    CarLikeBase,
    DifferentialDrive,
    HolonomicBase,
    Robot,
    SerialArm,
    TreeRobot,
    TwoArms,
    WholeBody,
)
from dqcontrol.robots.dh import compose
from dqcontrol.robots.files.description import foot_below, joint_range, rod_radii
from dqcontrol.robots.kinematics.kinematics_kernels import PRISMATIC
from dqcontrol.robots.poses import inverse7
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.robots.whole_body import Drive, Mover, parts_with_offsets

Colour = tuple[int, int, int]

SHELL, JOINT, DARK, TYRE = (236, 238, 241), (213, 94, 0), (64, 69, 77), (32, 33, 36)
_SHARP = 0.6  # rad; edges between faces that meet at a larger angle stay edges
_PLATFORM = 0.08  # m; height of a base, at most
_SPOKE = 0.3  # of a wheel's radius


class CarriedBody(NamedTuple):
    """A mesh that moves with a frame.

    ``carrier`` is the row of `Track.frames` that it moves with, −1 for one that stands still; ``vertices`` (V, 3), m,
    are in that frame, ``faces`` (F, 3) are indices of vertices, ``colour`` is red, green and blue, 0 … 255.
    """

    carrier: int
    vertices: Array
    faces: NDArray[np.int64]
    colour: Colour


def robot_shapes(robot: Robot) -> list[CarriedBody]:
    """Return the bodies of a robot: the meshes of its URDF file if there are any, rods and drums otherwise; and bases.

    Parameters
    ----------
    robot
        An arm or a whole body. The wheels of its differential drives, right and left, are carried by rows that follow
        those of `Robot.frames`.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> {shape.carrier for shape in robot_shapes(dqc.load_robot("iiwa7"))}
    {0, 1, 2, 3, 4, 5, 6, -1}
    """
    drawn: list[tuple[int, Surface, Colour]] = []
    own: set[int] = set()  # joints whose links have meshes
    for rows, found in arm_meshes(robot):
        drawn += [(carrier, smoothed(mesh), colour) for carrier, mesh, colour in found]
        own |= set(rows) if found else set()
    drawn += _chassis(robot)
    drawn += _rods(robot, own)
    return list(_merged(drawn))


def arm_meshes(robot: Robot) -> Iterator[tuple[range, list[tuple[int, Any, Colour]]]]:
    """Yield for each part with a file its rows of `Robot.frames`, and its meshes with the row that moves each."""
    if isinstance(robot, TreeRobot) and robot.placed_links is not None:
        yield range(len(robot.joints.kind)), placed_shapes(robot.placed_links)
        return
    for first, below, part in _chains(robot):
        bare = part.bare if isinstance(part, SerialArm) and part.bare is not None else part
        if isinstance(bare, SerialArm) and bare.urdf is not None:
            found = urdf_shapes(*bare.urdf, bare)
        elif isinstance(bare, Robot) and bare.placed_links is not None:
            found = placed_shapes(bare.placed_links)
        else:
            continue
        mount = pose_matrix(compose(robot.chain[first, :7], inverse7(bare.chain[0, :7])))
        yield (
            range(first, first + part.configuration_size),
            [
                (first + row if row >= 0 else below, mesh.apply_transform(mount) if row < 0 else mesh, colour)
                for row, mesh, colour in found
            ],
        )


def chain_rows(robot: Robot) -> list[range]:
    """Return the rows of `Robot.frames` of each arm, or of a whole tree of one file."""
    if isinstance(robot, TreeRobot) and not isinstance(robot, TwoArms):
        return [range(len(robot.joints.kind))]
    return [
        range(first, first + part.configuration_size)
        for first, _, part in _chains(robot)
        if isinstance(part, SerialArm)
    ]


def _chains(robot: Robot) -> Iterator[tuple[int, int, Robot | Mover]]:
    """Yield the chains of a robot, each with its first row of `Robot.frames` and the row that carries it."""
    if isinstance(robot, TwoArms):
        first, below = 0, -1
        for part in (robot.base, robot.left, robot.right):
            if part is None:
                continue
            for at, each in parts_with_offsets(part.parts if isinstance(part, WholeBody) else [part]):
                yield first + at, first + at - 1 if at else below, each
            first += part.configuration_size
            below = first - 1 if part is robot.base else below
        return
    for first, part in parts_with_offsets(robot.parts if isinstance(robot, WholeBody) else [robot]):
        yield first, first - 1, part


def smoothed(mesh: Any) -> Surface:
    """Return a mesh (trimesh) whose edges are drawn as edges and whose curves are drawn round."""
    import trimesh

    shaded = trimesh.graph.smooth_shade(trimesh.Trimesh(mesh.vertices, mesh.faces), angle=_SHARP)
    return Surface(np.asarray(shaded.vertices), np.asarray(shaded.faces))


def tinted(colour: Colour, tint: Colour) -> Colour:
    """Return a colour mixed with that of a run."""
    r, g, b = (round(0.45 * c + 0.55 * t) for c, t in zip(colour, tint, strict=True))
    return r, g, b


def _merged(drawn: Iterable[tuple[int, Surface, Colour]]) -> Iterator[CarriedBody]:
    """Yield one shape for each frame and colour."""
    groups: dict[tuple[int, Colour], list[Surface]] = {}
    for carrier, solid, colour in drawn:
        groups.setdefault((carrier, colour), []).append(solid)
    for (carrier, colour), solids in groups.items():
        yield CarriedBody(carrier, *Surface.joined(solids), colour)


def _rods(robot: Robot, own: set[int]) -> Iterator[tuple[int, Surface, Colour]]:
    """Yield a rod from each joint to the next, a drum on each axis, thinner towards the end effector; and rails."""
    points, parents, ends = robot.chain[:, 4:7], robot.parents, robot.ends
    count, bases = len(robot.row_coordinates), base_coordinates(robot)
    radii = rod_radii(robot)
    for i in [*range(count), *ends]:
        carrier, joint = int(parents[i]), i < count
        if i in own or (not joint and carrier in own):
            continue
        on_base = joint and bases[robot.row_coordinates[i]]
        stands = joint and carrier < 0
        foot = foot_below(robot, i) if stands else np.zeros(3)
        if stands and not on_base:
            yield -1, rod(foot, foot + np.array([0, 0, 0.2 * radii[i]]), 1.7 * radii[i]), DARK
        if not on_base:
            radius = 0.85 * radii[i]
            if np.linalg.norm(points[i] - foot) > 0.5 * radius:
                yield carrier, rod(foot, points[i], radius, round_ends=joint), DARK if stands else SHELL
        if joint and not on_base and robot.chain[i, 7] == PRISMATIC:
            yield from _rail(robot, i, 0.4 * radii[i])
        if joint and not on_base:
            below = (
                0.0 if i == 0 and np.linalg.norm(points[0]) < radii[0] else 1.0
            )  # the first stands on the floor
            yield i, rod(*_along_z(-1.02 * below * radii[i], 1.02 * radii[i]), 1.15 * radii[i]), SHELL
            yield i, rod(*_along_z(-1.12 * below * radii[i], 1.12 * radii[i]), 0.7 * radii[i]), JOINT


def _rail(robot: Robot, i: int, radius: float) -> Iterator[tuple[int, Surface, Colour]]:
    """Yield the way along which joint i slides, if it has ends."""
    way = joint_range(robot, i) + robot.joint_offsets[i]
    if np.isfinite(way).all() and np.ptp(way) > 0:
        start, end = (
            robot.chain[i, 4:7] + way[:, None] * algebra.matrix_from_rotation(robot.chain[i, :4])[:, 2]
        )
        yield int(robot.parents[i]), rod(start, end, radius, round_ends=True), DARK


def _chassis(robot: Robot) -> Iterator[tuple[int, Surface, Colour]]:
    """Yield the bases; the wheels of the k-th differential drive are carried by rows n + 1 + 2 k and one more."""
    row = robot.configuration_size + 1
    for first, part in parts_with_offsets(robot.parts if isinstance(robot, WholeBody) else ()):
        carrier = first + 2
        mount = robot.chain[min(first + 3, robot.configuration_size), 4:7]
        if isinstance(part, Drive):
            radius, track = part.wheel_radius, part.half_track
            body = _along_z(0.4 * radius, max(0.7 * mount[2], radius))
            yield carrier, rod(*body, max(track - 0.02, 0.5 * track)), DARK
            for _ in range(2):
                yield row, rod(np.array([0, -0.012, 0]), np.array([0, 0.012, 0]), radius), TYRE
                yield row, box([1.5 * radius, 0.028, _SPOKE * radius]), SHELL
                row += 1
            if not isinstance(part, DifferentialDrive):
                yield carrier, _front(part.wheelbase, radius, 0.15 * track), DARK
                for y in (-track, track) if isinstance(part, CarLikeBase) else (0.0,):
                    ends = np.array([[part.wheelbase, y + w, radius] for w in (-0.012, 0.012)])
                    yield carrier, rod(ends[0], ends[1], radius), TYRE
        elif isinstance(part, HolonomicBase):
            height = min(mount[2], _PLATFORM) if mount[2] > 0 else _PLATFORM
            half = max(1.25 * float(np.abs(mount[:2]).max()), 0.2)
            yield carrier, box([2 * half, 1.3 * half, height], [0, 0, 0.5 * height + 0.03]), DARK
            for x in (-0.75 * half, 0.75 * half):
                for y in (-0.68 * half, 0.68 * half):
                    ends = np.array([[x, y - 0.03, 0.05], [x, y + 0.03, 0.05]])
                    yield carrier, rod(ends[0], ends[1], 0.05), TYRE


def _front(wheelbase: float, radius: float, half_width: float) -> Surface:
    """Return the beam from the rear axle to the front one."""
    return box([wheelbase, 2 * half_width, 0.4 * radius], [0.5 * wheelbase, 0, 1.2 * radius])


def _along_z(low: float, high: float) -> tuple[Array, Array]:
    return np.array([0, 0, low]), np.array([0, 0, high])
