"""A mobile manipulator from its URDF or MJCF file: the base that its wheels make, and the arm on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import UnknownNameError
from dqcontrol.robots.files.default_tip import longest_arms, shared, ways_down
from dqcontrol.robots.files.link_tree import LinkTree, moves_alone
from dqcontrol.robots.files.mjcf import mjcf_round_links, mjcf_tree
from dqcontrol.robots.files.urdf import UrdfTree, load_urdf, origin_matrix, urdf_tree
from dqcontrol.robots.files.urdf_xml import MJCF, CheckedXml, mesh_file
from dqcontrol.robots.inverse.found_base import DriveKind, FoundBase, RoundLink, find_base, is_named_wheel
from dqcontrol.robots.poses import compose, inverse7
from dqcontrol.robots.robot import NamedFrame, PlacedLinks
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.whole_body import WholeBody


def mobile_robot_from(
    path: str | Path,
    tip_link: str | None = None,
    *,
    drive: DriveKind | None = None,
    wheel_radius: float | None = None,
    track: float | None = None,
    steering_limit: float | None = None,
) -> WholeBody:
    """Return the whole body of a URDF, xacro or MJCF file with wheels; see `load_robot`."""
    tree, found = base_of_file(path, drive, wheel_radius, track, steering_limit)
    stand = inverse7(found.place)
    parts: list[object] = [found.base, _pose8(stand)]
    tip = tip_link or _hand(tree, found)
    if tip is not None:
        parts.append(_arm(path, tree, found.root, tip))
    body = WholeBody(parts, tree.name)  # pyright: ignore[reportArgumentType]
    heading = found.base.configuration_size - 1  # the row that carries what stands on the base
    links = tree.placed_links(body.joint_names[heading + 1 :], found.root)
    frames = {
        link: NamedFrame(heading, compose(stand, pose)) if row < 0 else NamedFrame(heading + 1 + row, pose)
        for link, (row, pose) in links.frames.items()
    }
    body.placed_links = PlacedLinks(Path(path), frames)
    return body


def base_of_file(
    path: str | Path,
    drive: DriveKind | None = None,
    wheel_radius: float | None = None,
    track: float | None = None,
    steering_limit: float | None = None,
) -> tuple[LinkTree, FoundBase]:
    """Return all links of a file, and the base that its wheels make; see `load_robot`."""
    is_mjcf = Path(path).suffix.lower() == MJCF
    tree = mjcf_tree(path) if is_mjcf else urdf_tree(path)
    shapes = mjcf_round_links(path) if is_mjcf else _round_links(path)
    found = find_base(
        tree,
        shapes,
        drive=drive,
        wheel_radius=wheel_radius,
        track=track,
        steering_limit=steering_limit,
    )
    return tree, found


def _arm(path: str | Path, tree: LinkTree, root: str, tip: str) -> SerialArm:
    if Path(path).suffix.lower() == MJCF:
        return tree.chain(root, tip)
    return load_urdf(path, root, tip)


def _pose8(pose: Array) -> Array:
    return algebra.pose(pose[:4], pose[4:])


def _round_links(path: str | Path) -> dict[str, RoundLink]:
    """Return the round shape of each link of a URDF file that has one: how it collides, else how it looks.

    A mesh counts for a link with the name of a wheel, if its file is found.
    """
    found = {}
    for name, link in UrdfTree(CheckedXml(path)).links.items():
        for part in [*link.collisions, *link.visuals]:
            shape = part.geometry.cylinder or part.geometry.sphere
            if shape is not None:
                found[name] = RoundLink(float(shape.radius), np.array(origin_matrix(part)[:3, 3]))
            elif part.geometry.mesh is not None and is_named_wheel(name):
                found.update((name, each) for each in _round_mesh(Path(path), part))
            if name in found:
                break
    return found


def _round_mesh(path: Path, part: Any) -> list[RoundLink]:
    """Return radius and middle of the mesh of a wheel, which is as high as it is long; none if its file is missing."""
    try:
        file = mesh_file(path, part.geometry.mesh.filename)
    except FileNotFoundError:
        return []
    import trimesh

    scale = np.ones(3) if part.geometry.mesh.scale is None else np.asarray(part.geometry.mesh.scale)
    lower, upper = trimesh.load(file, force="mesh").bounds * scale
    middle = origin_matrix(part) @ [*(0.5 * (lower + upper)), 1.0]
    return [RoundLink(float(0.5 * np.sort(np.abs(upper - lower))[1]), middle[:3])]


def _hand(tree: LinkTree, found: FoundBase) -> str | None:
    """Return the link that carries all the fingers of the longest chain of joints; None if there is no arm.

    Raises
    ------
    UnknownNameError
        If there are several arms.
    """
    rolling = {name for w in (*found.wheels, *found.casters) for name in (w.joint, w.steering)}
    ways = ways_down((joint for joint in tree.joints if joint.child not in tree.marks), found.root)
    most, best = longest_arms(
        (way for way in ways if rolling.isdisjoint(each.name for each in way)), moves_alone, tree.is_held
    )
    if most == 0:
        return None
    common = shared([way.arm for way in best])
    if 2 * sum(map(moves_alone, common)) < most:
        ends = ", ".join(way.arm[-1].child for way in best)
        raise UnknownNameError(
            f"tip_link: must be given for {tree.where}; it has several arms, which end at {ends}"
        )
    return common[-1].child
