"""Lists of robots: the bundled ones, and the files that installed packages bring."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dqcontrol.arrays import Array
from dqcontrol.cli.screen import print_table
from dqcontrol.errors import Error, ExistsError, FileFormatError, NoteWarning, ShapeError
from dqcontrol.files.output_file import whole_file
from dqcontrol.geometry import Box, Capsule, Sphere
from dqcontrol.robots import LinkShape, LinkShapes, Robot, SerialArm, describe, load_robot, robot_names
from dqcontrol.robots.collision_shapes import FittedShape, SampledPair, collision_shapes, kept, sampled_pairs
from dqcontrol.robots.files.load import file_of, installed_robot_files
from dqcontrol.robots.files.mobile_robot_file import DriveHints, base_of_file
from dqcontrol.robots.files.robot_file import plain_arm
from dqcontrol.tables.tables import Cell, Column, Table

_PICTURES = (".png", ".pdf", ".svg")
_DPI = 150


def list_shapes(
    source: str,
    base_link: str | None,
    tip_link: str | None,
    write: Path | None,
    picture: Path | None,
    *,
    every_pair: bool,
) -> None:
    """Print, check and draw the shapes of a robot and its pairs; write an arm's robot file with them."""
    for target in (write, picture):
        if target is not None and target.exists():
            raise ExistsError(f"{target}: exists already; choose another name or remove it")
    if picture is not None and picture.suffix not in _PICTURES:
        raise FileFormatError(f"{picture}: must end in {', '.join(_PICTURES)}, got '{picture.suffix}'")
    robot = load_robot(source, base_link, tip_link)
    fitted: list[FittedShape] = []
    has_file = robot.placed_links is not None or (isinstance(robot, SerialArm) and robot.urdf is not None)
    if robot.shapes is None and has_file:
        fitted = collision_shapes(robot)
    known = tuple(each.shape for each in fitted) if fitted else robot.shapes.shapes if robot.shapes else ()
    if not known:
        raise ShapeError(
            f"{robot.name}: has no shapes; only URDF and MJCF files, and robot files with 'shapes' have some"
        )
    made_of = [f"{each.made_of}, {each.overhead:.2f} × its volume" for each in fitted] or [""] * len(known)
    joints = ("stands still", *robot.joint_names)
    rows = [
        [each.name, joints[each.frame], *_size(each), origin]
        for each, origin in zip(known, made_of, strict=True)
    ]
    columns = [Column("shape"), Column("moved by"), Column("kind"), Column("size", "mm"), Column("made of")]
    print_table(Table(columns if fitted else columns[:-1], rows if fitted else [row[:-1] for row in rows]))
    found = sampled_pairs(robot, known)
    chosen = tuple(kept(found)) if fitted else robot.shapes.pairs if robot.shapes else ()
    if every_pair:
        columns = [Column("pair"), Column("nearest", "mm", ".1f"), Column("overlap", "%", ".1f")]
        rows = [
            [
                f"{known[each.a].name}, {known[each.b].name}",
                1e3 * each.least,
                100 * each.colliding,
                "yes" if (each.a, each.b) in chosen else each.reason or "no",
            ]
            for each in found
        ]
        print_table(Table([*columns, Column("kept apart")], rows))
    print(f"{robot.name}: {len(known)} shapes, {len(chosen)} of {len(found)} pairs kept apart")
    for line in _doubts(robot, known, found, chosen):
        print(line)
    if picture is not None:
        from dqcontrol.figures.robots import shapes_picture  # only now: it loads Matplotlib

        with whole_file(picture) as draft:
            drawn = shapes_picture(robot, known, _middle(robot))
            drawn.savefig(draft, format=picture.suffix[1:], dpi=_DPI)
        print(f"wrote {picture}")
    if write is not None:
        if not isinstance(robot, SerialArm):
            raise ShapeError(f"{robot.name}: is a whole body; write the shapes of its arms")
        robot.shapes = LinkShapes(known, chosen)
        text = yaml.safe_dump(plain_arm(robot), sort_keys=False, default_flow_style=None, width=120)
        with whole_file(write) as draft:
            draft.write_text(text, encoding="utf-8")
        print(f"wrote {write}")


def _middle(robot: Robot) -> Array:
    """Return the middle of the joints' ranges, shape (n,), rad or m; 0 for those that turn or go further."""
    lower, upper = robot.limits.lower, robot.limits.upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    return np.where(bounded, 0.5 * (np.where(bounded, lower, 0) + np.where(bounded, upper, 0)), 0.0)


def _doubts(
    robot: Robot, known: tuple[LinkShape, ...], found: list[SampledPair], chosen: tuple[tuple[int, int], ...]
) -> Iterator[str]:
    """Yield what is to be looked at: joints that move no shape, pairs kept apart in vain, pairs left out."""
    carrying = {each.frame for each in known}
    for first, _ in robot.bases:  # whose three coordinates move the same shapes
        of_base = {first + 1, first + 2, first + 3}
        carrying |= of_base if of_base & carrying else set()
    bare = [name for k, name in enumerate(robot.joint_names, start=1) if k not in carrying]
    if bare:
        yield f"no shape moves with: {', '.join(bare)}"
    asked = {frozenset(pair) for pair in chosen}
    for each in found:
        pair = f"{known[each.a].name}, {known[each.b].name}"
        if frozenset((each.a, each.b)) in asked:
            if each.colliding > 0.5:
                yield f"kept apart, but they overlap in {100 * each.colliding:.0f} % of samples: {pair}"
        elif not each.reason:
            yield f"not kept apart, but they overlap in {100 * each.colliding:.1f} % of samples: {pair}"


def _size(each: LinkShape) -> list[str]:
    """Return kind and size of a shape."""
    shape = each.shape
    if isinstance(shape, Sphere):
        return ["sphere", f"radius {1e3 * shape.radius:.1f}"]
    if isinstance(shape, Capsule):
        length = float(((shape.end - shape.start) ** 2).sum() ** 0.5)
        return ["capsule", f"radius {1e3 * shape.radius:.1f}, length {1e3 * length:.1f}"]
    assert isinstance(shape, Box)
    return ["box", " × ".join(f"{1e3 * edge:.1f}" for edge in shape.size)]


_LENGTHS = ("wheel_radius", "half_track", "half_wheelbase", "wheelbase", "wheel_distance")
_NUMBERS = (*_LENGTHS, "steering_limit", "rim_speed")


def list_wheels(source: str, drive: Any, wheel_radius: float | None, track: float | None) -> None:
    """Print the wheels and casters of a file, and the base that they make."""
    tree, found = base_of_file(file_of(source), DriveHints(drive, wheel_radius, track))
    rows = []
    for role, wheels in (("wheel", found.wheels), ("caster", found.casters)):
        for wheel in wheels:
            what = "steered wheel" if wheel.steering and role == "wheel" else role
            rows.append([wheel.joint, what, *wheel.middle, wheel.radius, wheel.speed])
    lengths = (Column(name, "m", ".4f") for name in ("x", "y", "z", "radius"))
    print_table(Table([Column("joint"), Column("is"), *lengths, Column("speed", "rad/s")], rows))
    base = found.base
    said = [f"{name} {getattr(base, name):.4g}" for name in _NUMBERS if hasattr(base, name)]
    print(f"{tree.name}: {base.kind}, {', '.join(said)}")


def list_bundled() -> None:
    """Print the robots that come with dqcontrol."""
    rows = []
    for name in robot_names():
        about = describe(load_robot(name))
        rows.append([name, about.bases or None, len(about.joints), about.reach, about.mass])
    names = {"robot": "", "base": "", "coordinates": "", "reach": "m", "moving mass": "kg"}
    print_table(Table([Column(name, unit) for name, unit in names.items()], rows))


def list_installed() -> None:
    """Load the robot files of all installed packages, and print for each what it is or why it is refused."""
    columns = [Column(name) for name in ("robot", "loads as", "joints", "ends at", "note")]
    counts = {"arm": 0, "tree": 0, "refused": 0}
    found = groupby(installed_robot_files(), key=lambda each: each[0].partition(":")[0])
    for package, files in found:
        rows = [loaded_row(source) for source, _ in files]
        for row in rows:
            counts[str(row[1])] += 1
        print_table(Table(columns, rows, package))
    total = sum(counts.values())
    if not total:
        print("no installed package brings robot files; pip install 'dqcontrol[robots]' gets some")
        return
    print(f"{total} files: {counts['arm']} arms, {counts['tree']} trees, {counts['refused']} refused")


def loaded_row(source: str) -> list[Cell]:
    """Return the row of a robot file: an arm if it has one longest chain, else a tree, else why it is refused."""
    notes: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", NoteWarning)
        try:
            robot = load_robot(source)
        except Error as no_arm:
            notes.append(_short(no_arm))
            try:
                robot = load_robot(source, tips="all")
            except Error as no_tree:
                tip = re.search(r"\(--tip-link (.+?)[;)]", str(no_arm))
                try:
                    robot = load_robot(source, tip_link=tip[1] if tip else None)
                except Error:
                    return [source, "refused", None, None, _short(no_tree if tip else no_arm)]
    arm = isinstance(robot, SerialArm)
    notes += [_short(each.message) for each in caught if issubclass(each.category, NoteWarning)]
    missing, count = sum(map(math.isinf, robot.limits.velocity)), len(robot.limits.velocity)
    if missing:
        notes.append(f"no velocity limit of {f'{missing} of its' if missing < count else 'its'} joints")
    end = robot.links[-1] if arm and robot.links else None
    said = "; ".join(dict.fromkeys(notes)) or None
    return [source, "arm" if arm else "tree", robot.configuration_size, end, said]


def _short(message: object) -> str:
    """Return what a message says, without the file and the hints that the row itself gives."""
    text = re.sub(r"(?<![\w<])/\S*/", "", " ".join(str(message).split()))  # folders
    text = re.sub(r"^tip_link: must be given for \S+; ", "", text)
    text = re.sub(r"^.*?, (?=without the joints of its gripper)", "", text)
    return text.partition(" (--tip-link")[0].partition("; for another end")[0]
