"""MJCF files, read by MuJoCo: bodies and joints as a tree, gains of actuators as servo parameters."""

from __future__ import annotations

import logging
import math
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra.conversions import matrix_from_pose, pose
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, FileFormatError, from_extra, unreadable
from dqcontrol.robots.files.link_tree import LinkBody, LinkJoint, LinkTree, Mimic, RoundLink
from dqcontrol.robots.poses import compose, inverse7, shift, z_onto

_FREE, _BALL, _SLIDE, _HINGE = range(4)  # mjtJoint
_CONNECT, _WELD, _JOINT, _TENDON = range(4)  # mjtEq
_TO_JOINT = (0, 1)  # mjtTrn: joint, joint in parent


@dataclass(frozen=True)
class ServoGains:
    """What an MJCF file says of the servo of a joint, as `plants.MujocoPlant` takes it.

    Attributes
    ----------
    stiffness, damping
        k_p and k_d of a position actuator: N·m/rad and N·m·s/rad, or N/m and N·s/m.
    effort
        Largest torque or force, N·m or N.
    armature
        Rotor inertia seen at the joint, kg m² or kg.
    """

    stiffness: float
    damping: float
    effort: float
    armature: float


def import_mujoco(what: str = "physics and models of MuJoCo") -> Any:
    """Return the mujoco package.

    Raises
    ------
    MissingExtraError
        If it is not installed; ``what``, in the plural, needs it.
    """
    mujoco = from_extra("mujoco", "physics", what)
    if mujoco.get_mju_user_warning() is None:  # by default MuJoCo writes a log file to the working folder
        mujoco.set_mju_user_warning(logging.getLogger("dqcontrol.mujoco").info)
    return mujoco


def mjcf_tree(path: str | Path) -> LinkTree:
    """Read an MJCF file, with its includes, defaults and assets, as MuJoCo does.

    Bodies become links, named as there; joints between them are hinges and slides. Sites are links that mark a place
    on others. Equalities of two joints become mimic joints. Ball joints, and those that other equalities tie, as in
    the loops of a gripper, stay where the file has them: a chain or tree that needs one of them is refused.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed.
    FileFormatError
        If MuJoCo cannot read it.
    """
    return MjcfFile(path).tree()


def mjcf_servos(path: str | Path) -> dict[str, ServoGains]:
    """Return the gains of the position actuators of an MJCF file by their joints.

    Raises
    ------
    MissingExtraError, FileFormatError
        As for `mjcf_tree`.
    """
    reader = MjcfFile(path)
    model, found = reader.model, {}
    for i in range(model.nu):
        kp, bias = float(model.actuator_gainprm[i, 0]), model.actuator_biasprm[i]
        if int(model.actuator_trntype[i]) not in _TO_JOINT or not kp > 0 or bias[1] != -kp:
            continue
        joint = int(model.actuator_trnid[i, 0])
        gear = float(model.actuator_gear[i, 0])
        force = float(model.actuator_forcerange[i, 1]) if model.actuator_forcelimited[i] else math.inf
        dof = int(model.jnt_dofadr[joint])
        found[reader.joint_name(joint)] = ServoGains(
            kp * gear * gear, -float(bias[2]) * gear * gear, force * abs(gear), float(model.dof_armature[dof])
        )
    return found


def mjcf_round_links(path: str | Path) -> dict[str, RoundLink]:
    """Return the largest cylinder, sphere, ellipsoid or mesh of each body of an MJCF file, by the bodies' names.

    The radius of a mesh is half the second largest extent of its box: a wheel is as high as it is long.

    Raises
    ------
    MissingExtraError, FileFormatError
        As for `mjcf_tree`.
    """
    reader = MjcfFile(path)
    model, kinds, found = reader.model, reader.mujoco.mjtGeom, {}
    for i in range(model.ngeom):
        kind, size = kinds(int(model.geom_type[i])), model.geom_size[i]
        if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_SPHERE):
            radius = float(size[0])
        elif kind in (kinds.mjGEOM_ELLIPSOID, kinds.mjGEOM_MESH):
            radius = float(np.sort(model.geom_aabb[i, 3:])[1])
        else:
            continue
        body = reader.name("BODY", int(model.geom_bodyid[i]))
        if body not in found or found[body].radius < radius:
            found[body] = RoundLink(radius, model.geom_pos[i].copy())
    return found


class MjcfFile:
    """A compiled MJCF file, and where in it everything is."""

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.mujoco: Any = import_mujoco(f"robots in MJCF, as {path},")
        if not Path(path).is_file():
            raise unreadable(path, FileNotFoundError())
        try:
            with warnings.catch_warnings():  # on attributes that MuJoCo will drop
                warnings.simplefilter("ignore")
                self.spec: Any = self.mujoco.MjSpec.from_file(str(path))
                self.model: Any = self.spec.compile()
        except (ValueError, RuntimeError, OSError) as error:
            raise FileFormatError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None

    def name(self, kind: str, index: int) -> str:
        """Return the name of an object, or its kind and number."""
        found = self.mujoco.mj_id2name(self.model, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}"), index)
        return found or f"{kind.lower()}_{index}"

    @property
    def body_names(self) -> list[str]:
        """Names of the bodies, by their numbers."""
        return ["world", *(self.name("BODY", b) for b in range(1, self.model.nbody))]

    def joint_name(self, index: int) -> str:
        """Return the name of a joint."""
        return self.name("JOINT", index)

    def refuse(self, what: str, text: str, element: Any = None) -> FileFormatError:
        """Return an error about an element, with its line."""
        info = re.search(r"line (\d+)", getattr(element, "info", "") or "")
        line = f":{info[1]}" if info and info[1] != "0" else ""
        return FileFormatError(f"{self.path}{line}: {what}: {text}")

    def tree(self) -> LinkTree:
        """Return its bodies and joints, and its sites."""
        model, names = self.model, self.body_names
        follows, held = self._equalities()
        joints: list[LinkJoint] = []
        for body in range(1, model.nbody):
            joints += self._body_joints(body, names, follows)
        sites = list(self._sites(names))
        bodies = {
            names[b]: LinkBody(
                float(model.body_mass[b]),
                model.body_ipos[b].copy(),
                _rotated(model.body_iquat[b], model.body_inertia[b]),
            )
            for b in range(1, model.nbody)
            if model.body_mass[b] > 0
        }

        def error(joint: str, text: str) -> Error:
            return self.refuse(f"joint '{joint}'", text, self.spec.joint(joint))

        ball = "is a ball joint; a tree of screws has hinges and slides only"
        held |= {joint.name: error(joint.name, ball) for joint in joints if joint.kind == "other"}
        stem = self.spec.modelname or Path(self.path).stem
        name = Path(self.path).stem if stem == "MuJoCo Model" else stem
        marks = frozenset(site.child for site in sites)
        return LinkTree(name, str(self.path), "world", (*joints, *sites), bodies, error, held, marks)

    def _sites(self, names: list[str]) -> Iterator[LinkJoint]:
        """Yield the sites that have a name, fixed to their bodies; one that is named as a body is called a site."""
        model = self.model
        for i in range(model.nsite):
            name = self.mujoco.mj_id2name(model, self.mujoco.mjtObj.mjOBJ_SITE, i)
            if name:
                place = np.concatenate([model.site_quat[i], model.site_pos[i]])
                child = f"{name} site" if name in names else name
                yield LinkJoint(f"{child} fixed", "fixed", names[int(model.site_bodyid[i])], child, place)

    def _body_joints(self, body: int, names: list[str], follows: dict[int, Mimic]) -> Iterator[LinkJoint]:
        """Yield the joints of a body, one after the other, or that which fixes it to its parent."""
        model, parent = self.model, names[int(self.model.body_parentid[body])]
        place = np.concatenate([model.body_quat[body], model.body_pos[body]])
        count, first = int(model.body_jntnum[body]), int(model.body_jntadr[body])
        if model.body_mocapid[body] >= 0 or count == 0:
            yield LinkJoint(f"{names[body]} fixed", "fixed", parent, names[body], place)
            return
        if int(model.jnt_type[first]) == _FREE:
            adr = int(model.jnt_qposadr[first])
            place = model.qpos0[[*range(adr + 3, adr + 7), *range(adr, adr + 3)]].copy()
            yield LinkJoint(self.joint_name(first), "floating", parent, names[body], place)
            return
        for j in range(first, first + count):
            name = self.joint_name(j)
            kind = int(model.jnt_type[j])
            child = names[body] if j == first + count - 1 else f"{names[body]} after {name}"
            if kind == _BALL:
                yield LinkJoint(name, "other", parent, child, place)
                parent, place = child, shift()
                continue
            anchor = compose(shift(*model.jnt_pos[j]), z_onto(model.jnt_axis[j]))
            frames = compose(place, anchor), inverse7(anchor)
            moves = "revolute" if kind == _HINGE else "prismatic"
            start = float(model.qpos0[model.jnt_qposadr[j]])
            yield LinkJoint(name, moves, parent, child, *frames, *self._limits(j), follows.get(j), -start)
            parent, place = child, shift()

    def _limits(self, joint: int) -> tuple[float, float, float, float]:
        """Return lower and upper limit, velocity and effort: a joint's own, and of what its actuators may be told.

        With gain g and bias b of an actuator (f = g u + b₁ q + b₂ q̇, by MuJoCo's documentation) its u is a torque where
        b = 0, a position where b₁ = −g, a velocity where b₂ = −g and b₁ = 0; gears scale all.
        """
        model = self.model
        lower, upper = model.jnt_range[joint] if model.jnt_limited[joint] else (-math.inf, math.inf)
        velocity = effort = math.inf
        if model.jnt_actfrclimited[joint] and model.jnt_actfrcrange[joint, 1] > 0:
            effort = float(model.jnt_actfrcrange[joint, 1])
        for i in range(model.nu):
            if int(model.actuator_trntype[i]) not in _TO_JOINT or int(model.actuator_trnid[i, 0]) != joint:
                continue
            gear = float(model.actuator_gear[i, 0])
            if model.actuator_forcelimited[i] and model.actuator_forcerange[i, 1] > 0:
                effort = min(effort, float(model.actuator_forcerange[i, 1]) * abs(gear))
            gain, bias = float(model.actuator_gainprm[i, 0]), model.actuator_biasprm[i]
            # fixed, none
            simple = int(model.actuator_gaintype[i]) == 0 and int(model.actuator_dyntype[i]) == 0
            if not (model.actuator_ctrllimited[i] and simple and gear and gain > 0):
                continue
            low, high = model.actuator_ctrlrange[i]
            largest = max(-low, high)
            if int(model.actuator_biastype[i]) == 0 and largest > 0:
                effort = min(effort, largest * gain * abs(gear))
            elif bias[1] == 0 and bias[2] == -gain and largest > 0:
                velocity = min(velocity, largest / abs(gear))
            elif bias[1] == -gain and not model.jnt_limited[joint]:
                lower, upper = sorted((low / gear, high / gear))
        return float(lower), float(upper), float(velocity), float(effort)

    def _equalities(self) -> tuple[dict[int, Mimic], dict[str, Error]]:
        """Return what joints follow, by their numbers, and what else ties joints, by their names."""
        model, follows = self.model, dict[int, Mimic]()
        held = dict[str, Error]()
        placed = set[int]()  # free joints that an equality places: a second one closes a loop
        for i in range(model.neq):
            if not model.eq_active0[i]:
                continue
            kind = int(model.eq_type[i])
            if kind in (_CONNECT, _WELD):
                bodies = self._bodies(i)
                if kind == _WELD and not self._ties_sites(i) and (model.body_mocapid[bodies] >= 0).any():
                    continue  # what drags a body about from outside
                tied = self._between(bodies)
                free = {j for j in tied if int(model.jnt_type[j]) == _FREE} - placed
                if free:
                    placed.add(min(free))
                    continue  # what is free goes where it is tied to
                pair = " and ".join(f"'{name}'" for name in self._tied_names(i))
                text = f"{'connects' if kind == _CONNECT else 'welds'} {pair}: that closes a loop, and a tree has none"
            elif kind == _JOINT:
                text, tied = self._tie(i, follows)
            elif kind == _TENDON:
                text, tied = "ties tendons, which a tree of joints cannot hold", self._tendon_joints(i)
            else:
                text, tied = "is of a kind, which a tree of joints cannot hold", set(range(model.njnt))
            what = f"equality '{self.name('EQUALITY', i)}'"
            error = self.refuse(what, f"{text}; a tip above it leaves it out", self.spec.equalities[i])
            held |= {self.joint_name(j): error for j in sorted(tied)}
        return follows, held

    def _tie(self, equality: int, follows: dict[int, Mimic]) -> tuple[str, set[int]]:
        """Note a joint that follows another; or return which does so in another way, and what to say."""
        model = self.model
        first, second = self._ends(equality)
        poly, name = model.eq_data[equality, :5], self.joint_name(first)
        if second < 0:
            return f"holds joint '{name}' at a value; make it a fixed body", {first}
        if np.abs(poly[2:]).max() > 0:
            other = self.joint_name(second)
            return (
                f"ties joint '{name}' to '{other}' by a polynomial; only multiplier and offset are possible",
                {first},
            )
        start = model.qpos0[model.jnt_qposadr[first]], model.qpos0[model.jnt_qposadr[second]]
        follows[first] = Mimic(
            self.joint_name(second), float(poly[1]), float(start[0] + poly[0] - poly[1] * start[1])
        )
        return "", set()

    def _ends(self, equality: int) -> tuple[int, int]:
        return int(self.model.eq_obj1id[equality]), int(self.model.eq_obj2id[equality])

    def _ties_sites(self, equality: int) -> bool:
        return int(self.model.eq_objtype[equality]) == int(self.mujoco.mjtObj.mjOBJ_SITE)

    def _bodies(self, equality: int) -> list[int]:
        """Return the bodies that an equality of bodies or sites ties."""
        sites, ends = self._ties_sites(equality), self._ends(equality)
        return [int(self.model.site_bodyid[each]) if sites else each for each in ends]

    def _tied_names(self, equality: int) -> list[str]:
        kind = "SITE" if self._ties_sites(equality) else "BODY"
        return [self.name(kind, each) if each else "world" for each in self._ends(equality)]

    def _between(self, bodies: Iterable[int]) -> set[int]:
        """Return the joints that move some of some bodies against others."""
        above = [self._above(body) for body in bodies]
        return set[int]().union(*above) - set[int].intersection(*above)

    def _above(self, body: int) -> set[int]:
        """Return the joints that move a body."""
        model, found = self.model, set[int]()
        while body:
            first = int(model.body_jntadr[body])
            found |= set(range(first, first + int(model.body_jntnum[body])))
            body = int(model.body_parentid[body])
        return found

    def _tendon_joints(self, equality: int) -> set[int]:
        """Return the joints that the tendons of an equality pull at."""
        model, wraps = self.model, self.mujoco.mjtWrap
        tied, bodies = set[int](), list[int]()
        for tendon in self._ends(equality):
            if tendon < 0:
                continue
            first = int(model.tendon_adr[tendon])
            for w in range(first, first + int(model.tendon_num[tendon])):
                kind, index = int(model.wrap_type[w]), int(model.wrap_objid[w])
                if kind == int(wraps.mjWRAP_JOINT):
                    tied.add(index)
                elif kind == int(wraps.mjWRAP_SITE):
                    bodies.append(int(model.site_bodyid[index]))
        return tied | self._between(bodies) if bodies else tied


def _rotated(quaternion: Array, moments: Array) -> Array:
    """Return the tensor of principal moments whose axes are turned by a quaternion."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return turn @ np.diag(moments) @ turn.T


GeomKind: TypeAlias = Literal["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]

_FIRST_HIDDEN = 3  # group, from which on MuJoCo's viewer shows nothing unless asked
_PLAIN = (200, 203, 208)


@dataclass(frozen=True)
class Geom:
    """A geom of a body.

    Attributes
    ----------
    body, name
        Of what it is, and its own; ``BODY.2`` for the second without one.
    kind
        Planes and height fields are left out: they are surroundings.
    size
        As MuJoCo has it: radius; radius and half length; half axes; half edges; of a mesh nothing.
    place
        Of its frame in the body's, shape (4, 4).
    vertices, faces
        Of a mesh, in its own frame.
    colour
        Red, green and blue, 0 … 255.
    group
        From 3 on it is not shown by default.
    collides
        Whether it touches anything at all.
    """

    body: str
    name: str
    kind: GeomKind
    size: Array
    place: Array
    vertices: Array
    faces: NDArray[np.int64]
    colour: tuple[int, int, int]
    group: int
    collides: bool


def mjcf_geoms(path: str | Path) -> list[Geom]:
    """Return the geoms of all bodies of an MJCF file, as MuJoCo has compiled them.

    Raises
    ------
    MissingExtraError, FileFormatError
        As for `mjcf_tree`.
    """
    file = MjcfFile(path)
    return list(_geoms(file.mujoco, file.model, file.body_names))


def shown_geoms(path: str | Path) -> list[Geom]:
    """Return the geoms that are to be seen: those that MuJoCo's viewer shows, or all where it shows none."""
    every = mjcf_geoms(path)
    return [geom for geom in every if geom.group < _FIRST_HIDDEN] or every


def geom_mesh(geom: Geom) -> Any:
    """Return a geom as a mesh (trimesh) in its body's frame."""
    import trimesh

    size = geom.size
    if geom.kind == "mesh":
        mesh = trimesh.Trimesh(geom.vertices, geom.faces)
    elif geom.kind == "box":
        mesh = trimesh.creation.box(2 * size)
    elif geom.kind == "cylinder":
        mesh = trimesh.creation.cylinder(size[0], 2 * size[1], sections=40)
    elif geom.kind == "capsule":
        mesh = trimesh.creation.capsule(2 * size[1], size[0], count=[24, 24])
        mesh.apply_translation([0, 0, -mesh.bounds.mean(axis=0)[2]])
    else:
        mesh = trimesh.creation.icosphere(3, 1.0)
        mesh.apply_scale(size[0] if geom.kind == "sphere" else size)
    return mesh.apply_transform(geom.place)


def _geoms(mujoco: Any, model: Any, bodies: list[str]) -> Iterator[Geom]:
    kinds = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")): kind for kind in GeomKind.__args__}
    counts: dict[str, int] = {}
    for g in range(model.ngeom):
        kind, body = kinds.get(int(model.geom_type[g])), bodies[int(model.geom_bodyid[g])]
        if kind is None:
            continue
        counts[body] = counts.get(body, 0) + 1
        own = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, g)
        vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        if kind == "mesh":
            data = int(model.geom_dataid[g])
            first, count = int(model.mesh_vertadr[data]), int(model.mesh_vertnum[data])
            vertices = np.array(model.mesh_vert[first : first + count], np.float64)
            first, count = int(model.mesh_faceadr[data]), int(model.mesh_facenum[data])
            faces = np.array(model.mesh_face[first : first + count], np.int64)
        yield Geom(
            body,
            own or (body if counts[body] == 1 else f"{body}.{counts[body]}"),
            kind,
            model.geom_size[g].copy(),
            matrix_from_pose(pose(model.geom_quat[g], model.geom_pos[g])),
            vertices,
            faces,
            _colour(model, g),
            int(model.geom_group[g]),
            bool(model.geom_contype[g] or model.geom_conaffinity[g]),
        )


def _colour(model: Any, geom: int) -> tuple[int, int, int]:
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    if material < 0 and np.allclose(rgba, [0.5, 0.5, 0.5, 1.0]):  # MuJoCo's default
        return _PLAIN
    red, green, blue = (round(255 * float(part)) for part in rgba[:3])
    return red, green, blue
