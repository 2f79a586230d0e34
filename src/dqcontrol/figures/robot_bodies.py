"""Bodies to draw: meshes that move with the frames of a robot.

Rods, balls and boxes are made here. `trimesh` makes them, too; but what it imports takes 1.5 s of a processor's time
(NetworkX, SciPy), as much as all else from `dqcontrol play` to a robot that moves. It is imported where files with
meshes are read.
"""

from __future__ import annotations

import functools
import io
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra, robots
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, NoteWarning
from dqcontrol.files.input_file import read_whole
from dqcontrol.robots.files.description import foot_below, joint_range, rod_radii
from dqcontrol.robots.files.mjcf import geom_mesh, shown_geoms
from dqcontrol.robots.files.urdf import UrdfTree, origin_matrix
from dqcontrol.robots.files.urdf_xml import CheckedXml, mesh_file, missing_note
from dqcontrol.robots.kinematics.kinematics_kernels import PRISMATIC
from dqcontrol.robots.poses import compose, inverse7, pose7
from dqcontrol.robots.robot import PlacedLinks, base_coordinates
from dqcontrol.robots.whole_body import Drive, Mover, parts_with_offsets

_SECTIONS = 40  # around an axis
_RINGS = 10  # of half a ball


class Surface(NamedTuple):
    """A closed surface: vertices (V, 3), m, and faces (F, 3) of their indices, anticlockwise from outside.

    Vertices at an edge stand there once for each side, so that edges are drawn as edges and curves are drawn round.
    """

    vertices: Array
    faces: NDArray[np.int64]

    @classmethod
    def joined(cls, solids: Iterable[Surface]) -> Surface:
        """Return several as one: fewer and larger ones are quicker to draw."""
        parts = list(solids)
        firsts = np.cumsum([0, *(len(each.vertices) for each in parts)])
        return cls(
            np.concatenate([each.vertices for each in parts]),
            np.concatenate([each.faces + first for each, first in zip(parts, firsts, strict=False)]),
        )


def rod(start: ArrayLike, end: ArrayLike, radius: float, *, round_ends: bool = False) -> Surface:
    """Return a cylinder between two points, or a capsule about them; a ball where they are the same.

    Examples
    --------
    >>> import numpy as np
    >>> np.ptp(rod([0, 0, 0], [0, 0, 1], 0.25, round_ends=True).vertices, axis=0).tolist()
    [0.5, 0.5, 1.5]
    """
    start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.linalg.norm(end - start))
    if round_ends:
        angle = 0.5 * np.pi * np.linspace(0.0, 1.0, _RINGS + 1)
        up, out = radius * np.sin(angle), radius * np.cos(angle)
        out[-1] = 0.0
        first = np.column_stack([-up[::-1], out[::-1]])
        bands = [np.vstack([first, np.column_stack([length + up, out])[0 if length else 1 :]])]
    else:
        ends = [[0.0, 0.0], [0.0, radius], [length, radius], [length, 0.0]]
        bands = [np.array(ends[i : i + 2]) for i in range(3)]
    axis = (end - start) / length if length > 0 else np.array([0.0, 0.0, 1.0])
    solid = Surface.joined(_turned(band, axis) for band in bands)
    return Surface(solid.vertices + start, solid.faces)


def ball(centre: ArrayLike, radius: float) -> Surface:
    """Return a ball."""
    return rod(centre, centre, radius, round_ends=True)


def box(size: ArrayLike, centre: ArrayLike = (0.0, 0.0, 0.0), axes: ArrayLike | None = None) -> Surface:
    """Return a box with edges of these lengths, (3,), m, along the columns of ``axes`` (3, 3).

    Examples
    --------
    >>> len(box([1, 2, 3]).vertices)
    24
    """
    corners, faces = [], []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for sign in (-1.0, 1.0):
            first = len(corners)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[[i, j, k]] = sign, sign * a, b
                corners.append(corner)
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    turn = np.eye(3) if axes is None else np.asarray(axes, np.float64)
    vertices = (0.5 * np.array(corners) * np.asarray(size, np.float64)) @ turn.T
    return Surface(vertices + np.asarray(centre, np.float64), np.array(faces, np.int64))


def _turned(profile: Array, axis: Array) -> Surface:
    """Return what a line of points [along, out], (K, 2), m, passes over as it turns about an axis (3,)."""
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    angle = 2 * np.pi * np.arange(_SECTIONS) / _SECTIONS
    ring = np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(axis, across))
    along, out = profile.T
    vertices = along[:, None, None] * axis + out[:, None, None] * ring
    k, a = np.meshgrid(np.arange(len(profile) - 1), np.arange(_SECTIONS), indexing="ij")
    b = (a + 1) % _SECTIONS
    near, far = k * _SECTIONS, (k + 1) * _SECTIONS
    below = np.stack([near + a, near + b, far + b], axis=-1)[out[:-1] > 0]
    above = np.stack([near + a, far + b, far + a], axis=-1)[out[1:] > 0]
    return Surface(vertices.reshape(-1, 3), np.concatenate([below.reshape(-1, 3), above.reshape(-1, 3)]))


Colour = tuple[int, int, int]
Drawn = tuple[int, Any, Colour]

_PLAIN = (200, 203, 208)
_MESHES = ("dae", "stl", "obj", "ply", "off", "glb")  # none that is an archive, which may hold any amount
_LARGEST_MESH = 200_000_000  # bytes


def urdf_shapes(path: Path, base_link: str, arm: robots.SerialArm) -> list[Drawn]:
    """Return the row of `SerialArm.frames` that carries each visual, −1 for the base, its mesh there, and its colour.

    Joints that are not the arm's rest at zero. Without any visuals there are none; nor if a mesh is not found, which a
    `NoteWarning` names.

    Parameters
    ----------
    path
        The URDF file.
    base_link
        Link in whose frame the arm's poses are.
    arm
        The chain that was read from it.
    """
    tree = UrdfTree(CheckedXml(path))
    frames = arm.frames(np.zeros(arm.configuration_size))[:-1]
    homes = [np.eye(4), *(pose_matrix(pose7("frame", frame)) for frame in frames)]
    links = {link: (place, carrier) for link, place, carrier in tree.places(arm.joint_names)}
    to_base = np.linalg.inv(links[base_link][0])
    placed = {
        link: (carrier - 1, np.linalg.inv(homes[carrier]) @ to_base @ place)
        for link, (place, carrier) in links.items()
    }
    return _visuals(path, tree, placed)


def _visuals(path: Path, tree: UrdfTree, placed: Mapping[str, tuple[int, Array]]) -> list[Drawn]:
    """Return the visuals of links, each with the row that carries it and its place there, (4, 4)."""
    drawn: list[Drawn] = []
    for link, (row, place) in placed.items():
        for visual in tree.links[link].visuals if link in tree.links else ():
            at = place @ origin_matrix(visual)
            try:
                pieces = list(_geometry(path, visual))
            except FileNotFoundError:
                warnings.warn(missing_note(path), NoteWarning, stacklevel=3)
                return []
            drawn += [(row, mesh.copy().apply_transform(at), colour) for mesh, colour in pieces]
    return drawn


def _geometry(urdf: Path, visual: Any) -> Iterator[tuple[Any, Colour]]:
    """Yield the pieces of a visual, and their colours."""
    import trimesh

    shape, colour = visual.geometry, _material(visual)
    if shape.box is not None:
        yield trimesh.creation.box(shape.box.size), colour or _PLAIN
    elif shape.cylinder is not None:
        cylinder = trimesh.creation.cylinder(shape.cylinder.radius, shape.cylinder.length, sections=40)
        yield cylinder, colour or _PLAIN
    elif shape.sphere is not None:
        yield trimesh.creation.icosphere(3, shape.sphere.radius), colour or _PLAIN
    elif shape.mesh is not None:
        scale = np.ones(3) if shape.mesh.scale is None else np.broadcast_to(shape.mesh.scale, 3)
        for mesh, own in _loaded(mesh_file(urdf, shape.mesh.filename)):
            yield mesh.copy().apply_transform(np.diag([*scale, 1.0])), colour or own


def _material(visual: Any) -> Colour | None:
    colour = visual.material.color if visual.material is not None else None
    if colour is None or colour.rgba is None:
        return None
    r, g, b = (round(255 * float(c)) for c in colour.rgba[:3])
    return r, g, b


@functools.cache
def _loaded(path: Path) -> list[tuple[Any, Colour]]:
    """Return the meshes of a file with their colours."""
    import trimesh

    kind = path.suffix.lower().removeprefix(".")
    if kind not in _MESHES:
        raise FileFormatError(f"{path}: is no mesh that is read here (allowed: {', '.join(_MESHES)})")
    data = read_whole(path, _LARGEST_MESH)
    text = data.replace(b"\0", b"").upper() if kind == "dae" else b""
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise FileFormatError(f"{path}: declares a document type or entities, refused for safety")
    try:
        scene: Any = trimesh.load_scene(io.BytesIO(data), file_type=kind)
    except Exception as error:  # readers of damaged files raise anything
        raise FileFormatError(f"{path}: cannot be read as a mesh: {error}") from None
    return [(mesh, _own_colour(mesh)) for mesh in scene.dump() if hasattr(mesh, "faces")]


def _own_colour(mesh: Any) -> Colour:
    if not mesh.visual.defined:
        return _PLAIN
    material = getattr(mesh.visual, "material", None)
    r, g, b = (material if material is not None else mesh.visual).main_color[:3]
    return int(r), int(g), int(b)


def pose_matrix(pose: Array) -> Array:
    """Return the homogeneous matrix of a pose (7,), [quaternion, position]."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = algebra.matrix_from_rotation(pose[:4]), pose[4:]
    return matrix


def placed_shapes(placed: PlacedLinks) -> list[Drawn]:
    """Return what links of a URDF or MJCF file look like: the row of `Robot.frames`, −1 for the base, mesh and colour.

    Without any visuals there are none; nor if a mesh is not found, which a `NoteWarning` names.
    """
    if placed.path.suffix.lower() == ".xml":
        geoms = [(geom, placed.frames[geom.body]) for geom in shown_geoms(placed.path)]
        return [
            (frame.joint, geom_mesh(geom).apply_transform(pose_matrix(frame.pose)), geom.colour)
            for geom, frame in geoms
        ]
    at = {name: (frame.joint, pose_matrix(frame.pose)) for name, frame in placed.frames.items()}
    return _visuals(placed.path, UrdfTree(CheckedXml(placed.path)), at)


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


def robot_shapes(robot: robots.Robot) -> list[CarriedBody]:
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


def arm_meshes(robot: robots.Robot) -> Iterator[tuple[range, list[Drawn]]]:
    """Yield for each part with a file its rows of `Robot.frames`, and its meshes with the row that moves each."""
    if isinstance(robot, robots.TreeRobot) and robot.placed_links is not None:
        yield range(len(robot.joints.kind)), placed_shapes(robot.placed_links)
        return
    for first, below, part in _chains(robot):
        bare = part.bare if isinstance(part, robots.SerialArm) and part.bare is not None else part
        if isinstance(bare, robots.SerialArm) and bare.urdf is not None:
            found = urdf_shapes(*bare.urdf, bare)
        elif isinstance(bare, robots.Robot) and bare.placed_links is not None:
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


def chain_rows(robot: robots.Robot) -> list[range]:
    """Return the rows of `Robot.frames` of each arm, or of a whole tree of one file."""
    if isinstance(robot, robots.TreeRobot) and not isinstance(robot, robots.TwoArms):
        return [range(len(robot.joints.kind))]
    return [
        range(first, first + part.configuration_size)
        for first, _, part in _chains(robot)
        if isinstance(part, robots.SerialArm)
    ]


def _chains(robot: robots.Robot) -> Iterator[tuple[int, int, robots.Robot | Mover]]:
    """Yield the chains of a robot, each with its first row of `Robot.frames` and the row that carries it."""
    if isinstance(robot, robots.TwoArms):
        first, below = 0, -1
        for part in (robot.base, robot.left, robot.right):
            if part is None:
                continue
            for at, each in parts_with_offsets(part.parts if isinstance(part, robots.WholeBody) else [part]):
                yield first + at, first + at - 1 if at else below, each
            first += part.configuration_size
            below = first - 1 if part is robot.base else below
        return
    for first, part in parts_with_offsets(robot.parts if isinstance(robot, robots.WholeBody) else [robot]):
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


def _rods(robot: robots.Robot, own: set[int]) -> Iterator[tuple[int, Surface, Colour]]:
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
            on_floor = i == 0 and np.linalg.norm(points[0]) < radii[0]
            below = 0.0 if on_floor else 1.0
            yield i, rod(*_along_z(-1.02 * below * radii[i], 1.02 * radii[i]), 1.15 * radii[i]), SHELL
            yield i, rod(*_along_z(-1.12 * below * radii[i], 1.12 * radii[i]), 0.7 * radii[i]), JOINT


def _rail(robot: robots.Robot, i: int, radius: float) -> Iterator[tuple[int, Surface, Colour]]:
    """Yield the way along which joint i slides, if it has ends."""
    way = joint_range(robot, i) + robot.joint_offsets[i]
    if np.isfinite(way).all() and np.ptp(way) > 0:
        along = algebra.matrix_from_rotation(robot.chain[i, :4])[:, 2]
        start, end = robot.chain[i, 4:7] + way[:, None] * along
        yield int(robot.parents[i]), rod(start, end, radius, round_ends=True), DARK


def _chassis(robot: robots.Robot) -> Iterator[tuple[int, Surface, Colour]]:
    """Yield the bases; the wheels of the k-th differential drive are carried by rows n + 1 + 2 k and one more."""
    row = robot.configuration_size + 1
    for first, part in parts_with_offsets(robot.parts if isinstance(robot, robots.WholeBody) else ()):
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
            if not isinstance(part, robots.DifferentialDrive):
                yield carrier, _front(part.wheelbase, radius, 0.15 * track), DARK
                for y in (-track, track) if isinstance(part, robots.CarLikeBase) else (0.0,):
                    ends = np.array([[part.wheelbase, y + w, radius] for w in (-0.012, 0.012)])
                    yield carrier, rod(ends[0], ends[1], radius), TYRE
        elif isinstance(part, robots.HolonomicBase):
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


def wheel_angles(robot: robots.Robot, q: Array) -> Array:
    """Return how far the right and the left wheel of each drive have rolled since the first sample, (N, 2 k), rad.

    Each rolls without slipping: dθ = (ds ± b dφ)/r with ds the step along the mean heading. [S17 4.25]
    """
    angles = np.zeros((len(q), 2 * len(robot.drives)))
    for j, (first, _, radius, half_track, *_) in enumerate(robot.drives):
        x, y, heading = np.nan_to_num(q[:, int(first) : int(first) + 3]).T
        turn, middle = np.diff(heading), (heading[1:] + heading[:-1]) / 2
        ahead = np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)
        for side, sign in enumerate((1.0, -1.0)):
            angles[1:, 2 * j + side] = np.cumsum(ahead + sign * half_track * turn) / radius
    return angles
