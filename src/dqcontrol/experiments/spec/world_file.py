"""Worlds in files of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import msgspec
import numpy as np

from dqcontrol import algebra
from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, FileFormatError, ShapeError, ValueRangeError, error_prefix
from dqcontrol.experiments.spec.key_types import (
    kinds_of,
    numbers_for_quantities,
    quantities_for_numbers,
)
from dqcontrol.experiments.spec.reference_spec import AnyReference
from dqcontrol.files.input_file import read_text
from dqcontrol.files.output_file import yaml_text
from dqcontrol.files.yaml_file import convert
from dqcontrol.geometry import Box, Capsule, Cylinder, Hull, Plane, Shape, Sphere
from dqcontrol.plants.mujoco.world_model import add_world
from dqcontrol.references import position_path
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.world import Body, Solid, World
from dqcontrol.world.world import Bodies, plain_world

# What a format does not know is refused in words, or said in its own way: containers and maps become boxes, a
# capsule in URDF a cylinder with two balls. Motions that a body makes by itself are in none of them.

_MUJOCO = "world: "  # before the names of bodies in MuJoCo's files
_TIMESTEP = 0.002  # s, of contacts in MJCF files


def read_foreign(path: Path) -> dict[str, Any] | None:
    """Return the plain data of a world in another program's file; None of a file that is none by its suffix.

    Raises
    ------
    FileFormatError
        If it cannot be read, or has what no body of a world is: meshes, ellipsoids, or chains of joints.
    MissingExtraError
        If it takes mujoco, which reads MJCF and URDF, and that is not installed.
    """
    reader = _READERS.get(path.suffix.lower())
    return None if reader is None else reader(path)


# MJCF and URDF, which MuJoCo reads


def _read_mujoco(path: Path) -> dict[str, Any]:
    mujoco = import_mujoco("worlds in MJCF and URDF")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # links keep their names
        model = spec.compile()
    except ValueError as error:
        said = " ".join(str(error).split())
        raise FileFormatError(f"{path}: {said}") from None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found: dict[str, Any] = {}
    moved: dict[int, list[int]] = {}
    for geom in range(model.ngeom):
        if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            continue  # only for pictures
        body = int(model.geom_bodyid[geom])
        moved.setdefault(int(model.body_weldid[body]) or -1 - (body or -1 - geom), []).append(geom)
    for key, geoms in moved.items():
        root = max(key, 0)
        body = root or int(model.geom_bodyid[geoms[0]])
        own = model.body(body).name if body else model.geom(geoms[0]).name
        name = str(own or f"body_{len(found) + 1}").removeprefix(_MUJOCO).removesuffix(" pad")
        with error_prefix(f"{path}: {name}"):
            found[name] = _body_of(mujoco, model, data, root, geoms)
    return found


def _body_of(mujoco: Any, model: Any, data: Any, root: int, geoms: list[int]) -> dict[str, Any]:
    """Return what a world says of the geoms of one rigid body; ``root`` is 0 of one that stands."""
    poses = [_geom_pose(mujoco, data, geom) for geom in geoms]
    found = _placed([_solid_of(mujoco, model, geom) for geom in geoms], poses)
    if not root:
        return found
    if model.body_weldid[model.body_parentid[root]]:
        raise ValueRangeError(
            "hangs on a body that moves; a world has no chains of joints: load it as a robot"
        )
    found["friction"] = float(model.geom_friction[geoms[0], 0])
    first, count = int(model.body_jntadr[root]), int(model.body_jntnum[root])
    kinds = mujoco.mjtJoint
    joints = [int(kind) for kind in model.jnt_type[first : first + count]]
    dof = int(model.jnt_dofadr[first])
    damping = float(np.ravel(model.dof_damping[dof])[0])
    if joints == [int(kinds.mjJNT_SLIDE)] * 3:
        stiffness = float(np.ravel(model.jnt_stiffness[first])[0])
        return found | {"stiffness": stiffness, "damping": damping}
    found["mass"] = float(model.body_subtreemass[root])
    if joints == [int(kinds.mjJNT_FREE)]:
        return found
    if count != 1 or joints[0] not in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)):
        raise ValueRangeError("moves on joints that are neither one hinge, one slide, nor free")
    turn = algebra.matrix_from_pose(poses[0])[:3, :3]
    joint: dict[str, Any] = {
        "axis": (turn.T @ data.xaxis[first]).tolist(),
        "damping": damping,
        "friction": float(model.dof_frictionloss[dof]),
    }
    if model.jnt_limited[first]:
        joint["range"] = model.jnt_range[first].tolist()
    if joints[0] == int(kinds.mjJNT_SLIDE):
        return found | {"slide": joint}
    at = turn.T @ (data.xanchor[first] - algebra.translation(poses[0]))
    return found | {"hinge": joint | {"at": at.tolist()}}


def _geom_pose(mujoco: Any, data: Any, geom: int) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, data.geom_xmat[geom])
    return algebra.pose(quaternion, data.geom_xpos[geom])


def _solid_of(mujoco: Any, model: Any, geom: int) -> dict[str, Any]:
    kinds, size = mujoco.mjtGeom, model.geom_size[geom].tolist()
    match int(model.geom_type[geom]):
        case kinds.mjGEOM_BOX:
            return {"box": [2 * each for each in size]}
        case kinds.mjGEOM_SPHERE:
            return {"sphere": size[0]}
        case kinds.mjGEOM_CAPSULE:
            return {"capsule": [size[0], 2 * size[1]]}
        case kinds.mjGEOM_CYLINDER:
            return {"cylinder": [size[0], 2 * size[1]]}
        case kinds.mjGEOM_PLANE:
            return {"plane": [0.0, 0.0, 1.0]}
    raise ValueRangeError(
        "has a shape that is no box, sphere, capsule, cylinder or plane; give a mesh its file: mesh: FILE.stl"
    )


def _mjcf(world: World) -> str:
    spec = import_mujoco().MjSpec()
    spec.modelname = "world"
    spec.compiler.degree, spec.compiler.autolimits = False, True
    add_world(spec, world.bodies, _TIMESTEP)
    spec.compile()
    return str(spec.to_xml())


def _urdf(world: World) -> str:
    robot = ElementTree.Element("robot", name="world")
    ElementTree.SubElement(robot, "link", name="world")
    for name, body in world.bodies.items():
        with error_prefix(f"world.{name}"):
            if body.role in ("moving", "springy"):
                raise ValueRangeError("URDF has no word for what moves as it says or gives way")
            _add_link(robot, name, body)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: ElementTree.Element, name: str, body: Body) -> None:
    link = ElementTree.SubElement(robot, "link", name=name)
    shapes = body.own_shapes
    joint = body.hinge or body.slide
    at = np.array(body.hinge.at if body.hinge else np.zeros(3))  # a link's frame lies on its axis
    if body.mass is not None or joint is not None:
        mass, inertial = body.mass or 1.0, ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=_text(-at), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=_text([mass]))
        moment = _text([mass * max(float(np.abs(shape.row).max()) for shape in shapes) ** 2 / 10])
        zero = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
        ElementTree.SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, **zero)
    for shape in shapes:
        for kind, size, pose in _urdf_shapes(shape):
            part = ElementTree.SubElement(link, "collision")
            place = algebra.translation(pose) - at
            rpy = algebra.rpy_from_rotation(algebra.rotation(pose))
            ElementTree.SubElement(part, "origin", xyz=_text(place), rpy=_text(rpy))
            ElementTree.SubElement(ElementTree.SubElement(part, "geometry"), kind, size)
    kind = "revolute" if body.hinge else "prismatic" if body.slide else "floating" if body.mass else "fixed"
    if body.hinge is not None and body.hinge.range is None:
        kind = "continuous"
    limits = (-1e3, 1e3) if joint is None or joint.range is None else joint.range
    fixed = ElementTree.SubElement(robot, "joint", name=f"world to {name}", type=kind)
    ElementTree.SubElement(fixed, "parent", link="world")
    ElementTree.SubElement(fixed, "child", link=name)
    turn = algebra.matrix_from_pose(body.pose)
    ElementTree.SubElement(
        fixed, "origin", xyz=_text(turn[:3, 3] + turn[:3, :3] @ at), rpy=_text(np.array(body.rpy))
    )
    if joint is not None:
        axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
        ElementTree.SubElement(fixed, "axis", xyz=_text(axis))
        ElementTree.SubElement(
            fixed, "dynamics", damping=_text([joint.damping]), friction=_text([joint.friction])
        )
        ElementTree.SubElement(
            fixed, "limit", lower=_text([limits[0]]), upper=_text([limits[1]]), effort="1e3", velocity="1e3"
        )


def _urdf_shapes(shape: Shape) -> Iterator[tuple[str, dict[str, str], Array]]:
    """Yield element, attributes and pose of what stands for a shape."""
    if isinstance(shape, Capsule):
        yield from _urdf_shapes(Cylinder(shape.start, shape.end, shape.radius))
        for end in (shape.start, shape.end):
            yield "sphere", {"radius": _text([shape.radius])}, algebra.pose([1, 0, 0, 0], end)
        return
    kind, numbers, pose = _primitive(shape)
    names = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length")}[kind]
    values = [_text(numbers)] if kind == "box" else [_text([each]) for each in numbers]
    yield kind, dict(zip(names, values, strict=True)), pose


# MoveIt's text scenes


def _read_scene(path: Path) -> dict[str, Any]:
    """Return the objects of a scene: of `moveit::PlanningScene::saveGeometryToStream`, with or without object poses."""
    lines = iter(read_text(str(path)).splitlines()[1:])
    found: dict[str, Any] = {}
    try:
        for line in lines:
            if line.strip() == ".":
                return found
            name = line.strip().removeprefix("*").strip()
            with error_prefix(f"{path}: {name}"):
                found[name] = _scene_object(lines)
    except Error:
        raise
    except (StopIteration, ValueError, IndexError) as error:
        raise FileFormatError(f"{path}: is no scene of MoveIt's: {error or 'ends in an object'}") from None
    return found


def _scene_object(lines: Iterator[str]) -> dict[str, Any]:
    here, first = algebra.pose([1, 0, 0, 0], [0, 0, 0]), _numbers(next(lines))
    has_pose = len(first) == 3
    if has_pose:
        here = _pose_of(first, _numbers(next(lines)))
        first = _numbers(next(lines))
    solids, poses = [], []
    for _ in range(int(first[0])):
        kind = next(lines).strip()
        size = _numbers(next(lines))
        if kind not in ("box", "sphere", "cylinder"):
            raise ValueRangeError(f"has a {kind}; boxes, spheres and cylinders are read")
        solids.append({kind: size[0] if kind == "sphere" else size})
        poses.append(algebra.multiply(here, _pose_of(_numbers(next(lines)), _numbers(next(lines)))))
        next(lines)  # its colour
    if has_pose:
        for _ in range(3 * int(_numbers(next(lines))[0])):  # subframes: name and pose
            next(lines)
    if not solids:
        raise ValueRangeError("has no shape")
    return _placed(solids, poses)


def _scene(world: World) -> str:
    lines = ["world"]
    for name, body in world.bodies.items():
        with error_prefix(f"world.{name}"):
            shapes = [_primitive(shape) for shape in body.own_shapes]
        lines += [f"* {name}", *_pose_lines(body.pose), str(len(shapes))]
        for kind, size, pose in shapes:
            lines += [kind, _text(size), *_pose_lines(pose), "0 0 0 0"]
        lines.append("0")
    return "\n".join([*lines, ".", ""])


def _primitive(shape: Shape) -> tuple[str, Array, Array]:
    """Return kind, size and pose of a shape that most programs know."""
    if isinstance(shape, Box):
        return "box", shape.size, shape.pose
    if isinstance(shape, Sphere):
        return "sphere", np.array([shape.radius]), algebra.pose([1, 0, 0, 0], shape.center)
    if isinstance(shape, Cylinder):
        along, middle = shape.end - shape.start, 0.5 * (shape.start + shape.end)
        length = float(np.linalg.norm(along))
        plane = Plane(along / length, 0.0)
        turn = algebra.rotation_from_matrix(plane.axes)
        return "cylinder", np.array([shape.radius, length]), algebra.pose(turn, middle)
    kind = "mesh" if isinstance(shape, Hull) else type(shape).__name__.lower()
    raise ValueRangeError(f"this format has no {kind}")


def _pose_of(position: list[float], quaternion: list[float]) -> Array:
    turn = np.array([quaternion[3], *quaternion[:3]])
    return algebra.pose(turn / np.linalg.norm(turn), position)


def _pose_lines(pose: Array) -> list[str]:
    turn = algebra.rotation(pose)
    return [_text(algebra.translation(pose)), _text([*turn[1:], turn[0]])]


def _placed(solids: list[dict[str, Any]], poses: list[Array]) -> dict[str, Any]:
    """Return what a world says of solids that are one body."""
    back, further = algebra.conjugate(poses[0]), zip(solids[1:], poses[1:], strict=True)
    parts = [solid | _place(algebra.multiply(back, pose)) for solid, pose in further]
    return solids[0] | _place(poses[0]) | ({"parts": parts} if parts else {})


def _place(pose: Array) -> dict[str, list[float]]:
    """Return what a world says of a pose."""
    position = algebra.translation(pose)
    return {"position": position.tolist(), "rpy": algebra.rpy_from_rotation(algebra.rotation(pose)).tolist()}


def _numbers(line: str) -> list[float]:
    return [float(each) for each in line.split()]


def _text(numbers: Any) -> str:
    return " ".join(f"{float(each):.17g}" for each in np.ravel(numbers))


_READERS = {".xml": _read_mujoco, ".mjcf": _read_mujoco, ".urdf": _read_mujoco, ".scene": _read_scene}


_AWAY = 1e-6  # m
_OF_ROBOTS = ("drive-to", "follow", "plan-to")


def load_world(path: str | Path) -> World:
    r"""Return the world of a file, as the ``world`` of a spec: YAML, MJCF, URDF, or a scene of MoveIt's.

    Raises
    ------
    FileFormatError
        If the file cannot be read or says something else.

    Examples
    --------
    >>> import pathlib, tempfile, dqcontrol as dqc
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "shelf.yaml"
    >>> _ = file.write_text("floor: true\nball: {sphere: 60 mm, position: [0.8, 0.1, 0.5]}")
    >>> list(dqc.load_world(file).bodies)
    ['floor', 'ball']
    """
    data = numbers_for_quantities(str(path), said_world(str(path), Path()), list(kinds_of(Bodies)))
    return World(bodies=convert(path, data, Bodies))


def said_world(given: Any, folder: Path) -> Any:
    """Return the plain data of what a spec says of its world, which may be the name of a file; see `plain_world`.

    References by which bodies move are paths there.
    """
    if isinstance(given, str) and (read := read_foreign((folder / given).resolve())) is not None:
        return read
    found = plain_world(given, folder)
    if isinstance(found, dict):
        folder = (folder / given).resolve().parent if isinstance(given, str) else folder
        for name, body in found.items():
            moves = body.get("moves") if isinstance(body, dict) else None
            if isinstance(moves, dict) and "reference" in moves:
                found[name] = {**body, "moves": _on_path(f"world.{name}", body, moves, folder)}
    return found


def _on_path(where: str, body: dict[str, Any], moves: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return how a body moves by a reference from where it is, as a path."""
    field = f"{where}.moves.reference"
    if "path" in moves or "velocity" in moves:
        raise ShapeError(f"{field}: it has a path or velocity already; give one of them")
    place = {key: body[key] for key in ("position", "rpy") if key in body}
    pose = convert(where, numbers_for_quantities(where, place, list(kinds_of(Solid))), Solid).pose
    numbers = numbers_for_quantities(field, moves["reference"], list(kinds_of(AnyReference)))
    given = convert(field, numbers, AnyReference)
    if (kind := given.__struct_config__.tag) in _OF_ROBOTS:
        raise ValueRangeError(f"{field}: {kind} is made for a robot; a body moves by a motion of its own")
    reference = given.build(pose, folder, field)
    with error_prefix(field):
        path = position_path(reference)
        away = float(np.linalg.norm(translation(reference.samples([0.0])[0, :8]) - translation(pose)))
        if away > _AWAY:
            raise ValueRangeError(
                f"begins {1e3 * away:.3g} mm from where the body is; leave 'start' and 'offset' out, or place the body"
            )
    kept = {key: value for key, value in moves.items() if key != "reference"}
    return {**kept, "path": path.tolist()}


def world_text(world: World, suffix: str) -> str:
    """Return a world as a file says it: YAML, ``.xml`` (MJCF), ``.urdf`` or ``.scene`` (MoveIt).

    Raises
    ------
    Error
        If the format has no word for a body.
    """
    writers: dict[str, Callable[[World], str]] = {".xml": _mjcf, ".urdf": _urdf, ".scene": _scene}
    if suffix in (".yaml", ".yml"):
        plain = {name: _said(body) for name, body in world.bodies.items()}
        return yaml_text(quantities_for_numbers(plain, list(kinds_of(Bodies))))
    if suffix.lower() not in writers:
        raise FileFormatError(f"a world is written as .yaml, {', '.join(writers)}, got '{suffix}'")
    return writers[suffix.lower()](world)


def _said(part: msgspec.Struct) -> dict[str, Any]:
    """Return what a body says that is not so by itself."""
    out = {}
    for each in msgspec.structs.fields(part):
        value = getattr(part, each.name)
        if value == each.default or (isinstance(value, list) and not value):
            continue
        if isinstance(value, list) and isinstance(value[0], Solid):
            value = [_said(one) for one in value]
        out[each.encode_name] = _said(value) if isinstance(value, msgspec.Struct) else value
    return msgspec.to_builtins(out)
