"""Shapes of the links of URDF and MJCF files, and the pairs of them that are worth keeping apart."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, NoteWarning, ShapeError
from dqcontrol.geometry import Box, Capsule, Sphere, bounding_capsule, distance_kernels as kernels
from dqcontrol.robots.files.mjcf import Geom, mjcf_geoms
from dqcontrol.robots.files.urdf import UrdfTree, origin_matrix
from dqcontrol.robots.files.urdf_xml import CheckedXml, mesh_file, missing_note
from dqcontrol.robots.link_shapes import LinkShape, moved_rows
from dqcontrol.robots.poses import pose8
from dqcontrol.robots.robot import PlacedLinks, Robot
from dqcontrol.robots.serial_arm import SerialArm

_INSIDE = 0.994  # of a ball of 642 corners: radius of the ball that fits inside it
_TOUCHING = 0.002  # m: pairs that never come nearer are not looked after
_APART = 0.02  # m: pairs that are nearly always nearer are made of parts of one thing
_ALWAYS = 0.95  # of all samples


class FittedShape(NamedTuple):
    """A shape, and what it was made of.

    Attributes
    ----------
    shape
        The shape.
    made_of
        ``"sphere"``, ``"cylinder"``, ``"box"``, or a mesh's file.
    overhead
        Its volume over that of what it was made of (of a mesh, its convex hull).
    """

    shape: LinkShape
    made_of: str
    overhead: float


class SampledPair(NamedTuple):
    """Two shapes, how near they come, and why they are kept apart or not.

    Attributes
    ----------
    a, b
        Numbers of the shapes.
    least
        Least distance of all samples, m.
    colliding
        Share of samples in which they overlap.
    reason
        Why the pair is left out; empty for one that is kept apart.
    """

    a: int
    b: int
    least: float
    colliding: float
    reason: str


def collision_shapes(robot: Robot) -> list[FittedShape]:
    """Return shapes of the links of a robot that was read from a URDF or MJCF file: primitives, capsules of meshes.

    A cylinder becomes the capsule of its radius with its flat ends inside. A mesh, and an ellipsoid, becomes the
    smallest capsule around it that `bounding_capsule` finds. Balls inside of a capsule of the same link are left out,
    and so is what an MJCF file lets touch nothing.

    Raises
    ------
    ShapeError
        If the robot has no file.
    FileFormatError
        If the file has no collision shapes, or a mesh is not found.
    """
    if isinstance(robot, SerialArm) and robot.urdf is not None:
        file, parts = robot.urdf[0], _parts_of_urdf_arm(robot, *robot.urdf)
    elif robot.placed_links is not None:
        file = robot.placed_links.path
        parts = (_parts_of_mjcf if file.suffix == ".xml" else _parts_of_urdf)(robot.placed_links)
    else:
        raise ShapeError(f"{robot.name}: was not read from a URDF or MJCF file, which have collision shapes")
    found = [each for own in parts for each in own if not _is_inside(each, own)]
    if not found:
        raise FileFormatError(f"{file}: its links have no collision shapes")
    return found


@lru_cache(maxsize=8)
def known_shapes(robot: Robot) -> tuple[LinkShape, ...]:
    """Return the shapes of a robot's links: its own, else of a mobile robot those fitted to its file, empty without.

    A `NoteWarning` says why a file gives none.
    """
    if robot.shapes is not None:
        return robot.shapes.shapes
    if len(robot.bases) and robot.placed_links is not None:
        try:
            return tuple(each.shape for each in collision_shapes(robot))
        except FileFormatError as error:
            warnings.warn(str(error), NoteWarning, stacklevel=2)
    return ()


def _parts_of_urdf_arm(arm: SerialArm, path: Path, base_link: str) -> Iterator[list[FittedShape]]:
    """Yield the shapes of each link."""
    tree = UrdfTree(CheckedXml(path))
    frames = arm.frames(np.zeros(arm.configuration_size))[:-1]
    homes = [np.eye(4), *(algebra.matrix_from_pose(frame) for frame in frames)]
    places = {link: (place, carrier) for link, place, carrier in tree.places(arm.joint_names)}
    to_base = np.linalg.inv(places[base_link][0])
    for link, (place, carrier) in places.items():
        yield _shapes_of_link(
            path, tree.links[link], carrier, np.linalg.inv(homes[carrier]) @ to_base @ place
        )


def _parts_of_urdf(placed: PlacedLinks) -> Iterator[list[FittedShape]]:
    """Yield the shapes of each link."""
    links = UrdfTree(CheckedXml(placed.path)).links
    for name, frame in placed.frames.items():
        if name in links:
            yield _shapes_of_link(
                placed.path, links[name], frame.joint + 1, algebra.matrix_from_pose(pose8(frame.pose))
            )


def _shapes_of_link(path: Path, link: Any, carrier: int, place: Array) -> list[FittedShape]:
    several = len(link.collisions) > 1
    return [
        _fitted(
            path,
            f"{link.name}.{k + 1}" if several else link.name,
            carrier,
            part.geometry,
            place @ origin_matrix(part),
        )
        for k, part in enumerate(link.collisions)
    ]


def _parts_of_mjcf(placed: PlacedLinks) -> Iterator[list[FittedShape]]:
    """Yield the shapes of each body."""
    geoms = [geom for geom in mjcf_geoms(placed.path) if geom.collides]
    for name, frame in placed.frames.items():
        yield [
            _fitted_geom(geom, frame.joint + 1, algebra.matrix_from_pose(pose8(frame.pose)) @ geom.place)
            for geom in geoms
            if geom.body == name
        ]


def _fitted_geom(geom: Geom, frame: int, at: Array) -> FittedShape:
    if geom.kind == "ellipsoid":
        import trimesh

        ball = trimesh.creation.icosphere(3)  # its corners are on a ball of radius 1
        volume = 4 / 3 * np.pi * float(np.prod(geom.size))
        return _around(geom.name, frame, geom.kind, ball.vertices * geom.size / _INSIDE, volume, at)
    if geom.kind == "mesh":
        from scipy.spatial import ConvexHull

        hull = _hull(geom.name, lambda: ConvexHull(geom.vertices))
        return _around(geom.name, frame, geom.kind, geom.vertices[hull.vertices], hull.volume, at)
    return _primitive(geom.name, frame, geom.kind, geom.size, at)


def _primitive(name: str, frame: int, kind: str, size: Array, at: Array) -> FittedShape:
    """Return what stands for a sphere, box, capsule or cylinder, with sizes as of `Geom`."""
    turn, middle, overhead = at[:3, :3], at[:3, 3], 1.0
    shape: Sphere | Box | Capsule
    if kind == "sphere":
        shape = Sphere(middle, size[0])
    elif kind == "box":
        shape = Box(algebra.pose(algebra.rotation_from_matrix(turn), middle), 2 * size)
    else:
        along = size[1] * turn[:, 2]
        shape = Capsule(middle - along, middle + along, size[0])
        if kind == "cylinder":
            overhead = shape.volume / (2 * np.pi * size[0] ** 2 * size[1])
    return FittedShape(LinkShape(name, frame, shape), kind, float(overhead))


def _around(name: str, frame: int, made_of: str, corners: Array, volume: float, at: Array) -> FittedShape:
    """Return a capsule around the corners of something of that volume."""
    capsule = bounding_capsule(corners @ at[:3, :3].T + at[:3, 3])
    return FittedShape(LinkShape(name, frame, capsule), made_of, capsule.volume / max(volume, 1e-12))


def _fitted(path: Path, name: str, frame: int, geometry: Any, at: Array) -> FittedShape:
    if geometry.sphere is not None:
        return _primitive(name, frame, "sphere", np.array([geometry.sphere.radius]), at)
    if geometry.cylinder is not None:
        size = np.array([geometry.cylinder.radius, 0.5 * geometry.cylinder.length])
        return _primitive(name, frame, "cylinder", size, at)
    if geometry.box is not None:
        return _primitive(name, frame, "box", 0.5 * np.asarray(geometry.box.size), at)
    file, mesh = geometry.mesh.filename, _mesh(path, geometry.mesh)
    hull = _hull(f"{path}: {file}", lambda: mesh.convex_hull)
    return _around(name, frame, Path(file).name, hull.vertices, hull.volume, at)


def _hull(name: str, find: Callable[[], Any]) -> Any:
    """Return a mesh's convex hull.

    Raises
    ------
    FileFormatError
        If its points span no volume.
    """
    try:
        return find()
    except Exception as error:  # Qhull's
        first = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise FileFormatError(f"{name}: spans no volume: {first}") from None


def _mesh(path: Path, given: Any) -> Any:
    import trimesh

    try:
        mesh = trimesh.load(mesh_file(path, given.filename), force="mesh")
    except FileNotFoundError:
        raise FileFormatError(missing_note(path) or f"{path}: {given.filename} is not found") from None
    except Exception as error:  # readers of damaged files raise anything
        raise FileFormatError(f"{path}: {given.filename} cannot be read: {error}") from None
    return mesh.apply_scale(1.0 if given.scale is None else given.scale)


def _is_inside(each: FittedShape, own: list[FittedShape]) -> bool:
    """Return whether a ball lies inside of a capsule of its link."""
    ball = each.shape.shape
    if not isinstance(ball, Sphere):
        return False
    for other in own:
        capsule = other.shape.shape
        if isinstance(capsule, Capsule):
            along = capsule.end - capsule.start
            share = np.clip((ball.center - capsule.start) @ along / max(along @ along, 1e-12), 0, 1)
            away = float(np.linalg.norm(ball.center - capsule.start - share * along))
            if away + ball.radius <= capsule.radius + 1e-6:
                return True
    return False


def sampled_pairs(
    robot: Robot, shapes: tuple[LinkShape, ...], samples: int = 20_000, seed: int = 0
) -> list[SampledPair]:
    """Return pairs of shapes of different links, how near random configurations bring them, and which to keep apart.

    Left out are pairs of one link and of neighbours in the chain, pairs that overlap in nearly all samples, that never
    come nearer than 2 mm, and that are nearly always nearer than 20 mm: the last are parts of one thing, whose shapes
    are too large for it. A sample is no proof.

    Parameters
    ----------
    robot
        Of whom the shapes are.
    shapes
        Its shapes.
    samples, seed
        Number and seed of configurations within the limits (of joints without limits and beyond, half a turn each way).
    """
    rng = np.random.default_rng(seed)
    low = np.maximum(robot.limits.lower, -math.pi)
    high = np.minimum(robot.limits.upper, math.pi)
    q = rng.uniform(low, high, (samples, robot.configuration_size))
    rows = moved_rows(robot, q, shapes)
    neighbours = _neighbours(robot, {each.frame for each in shapes})
    return [
        _sampled_pair(a, b, shapes, rows, neighbours)
        for a in range(len(shapes))
        for b in range(a + 1, len(shapes))
        if shapes[a].frame != shapes[b].frame
    ]


def _neighbours(robot: Robot, carrying: set[int]) -> set[frozenset[int]]:
    """Return the pairs of frames with shapes of which one carries the other, with no third between them."""
    found = set()
    for frame in carrying - {0}:
        above = int(robot.parents[frame - 1]) + 1
        while above and above not in carrying:
            above = int(robot.parents[above - 1]) + 1
        found.add(frozenset((frame, above)))
    return found


def _sampled_pair(
    a: int, b: int, shapes: tuple[LinkShape, ...], rows: list[Array], neighbours: set[frozenset[int]]
) -> SampledPair:
    out = np.empty((len(rows[a]), kernels.FOUND))
    kernels.distances(rows[a], rows[b], out)
    distance = out[:, kernels.DISTANCE]
    least, colliding = float(distance.min()), float((distance < 0).mean())
    reason = ""
    if frozenset((shapes[a].frame, shapes[b].frame)) in neighbours:
        reason = "neighbours"
    elif colliding > _ALWAYS:
        reason = f"overlap in {100 * colliding:.0f} % of samples"
    elif least > _TOUCHING:
        reason = f"never nearer than {1000 * least:.0f} mm"
    elif float((distance < _APART).mean()) > _ALWAYS:
        reason = f"nearly always within {1000 * _APART:.0f} mm"
    return SampledPair(a, b, least, colliding, reason)


def kept(pairs: list[SampledPair]) -> Iterator[tuple[int, int]]:
    """Yield the pairs that are kept apart."""
    return ((each.a, each.b) for each in pairs if not each.reason)
