"""Robots by name or file, and what to print about one."""

from __future__ import annotations

import importlib.metadata
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.errors import (
    FileFormatError,
    MissingExtraError,
    ShapeError,
    UnknownNameError,
    ValueRangeError,
    suggest,
    unknown_name,
)
from dqcontrol.files.yaml_file import parse_yaml, read_text
from dqcontrol.robots.bases import DifferentialDrive, HolonomicBase
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.robot_file import arm_from
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.urdf import load_urdf
from dqcontrol.robots.whole_body import WholeBody, placed
from dqcontrol.robots.whole_body_file import whole_body_from

EXAMPLES = "example-robot-data"

_MODELS = Path(__file__).parent / "models"


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots that come with dqcontrol."""
    return tuple(sorted(path.stem for path in _MODELS.glob("*.yaml")))


def load_robot(source: str | Path, base_link: str | None = None, tip_link: str | None = None) -> Robot:
    """Load a robot by name or from a file.

    Parameters
    ----------
    source
        One of `robot_names`; or a ``.yaml`` or ``.yml`` file in one of our formats (`RobotFile`, `WholeBodyFile`); or a
        ``.urdf`` file; or ``example-robot-data:panda_description/urdf/panda.urdf``, a URDF file of that package.
    base_link, tip_link
        Ends of the chain, for URDF files only; see `load_urdf`.

    Returns
    -------
    SerialArm or WholeBody
        A whole body if the source is a file with ``parts``.

    Raises
    ------
    UnknownNameError
        If there is no such robot or link.
    FileFormatError
        If the file is missing or malformed.
    MissingExtraError
        If the source is in example-robot-data, and that is not installed.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> dqc.load_robot("iiwa7").configuration_size
    7
    """
    found = _read(source, base_link, tip_link)
    return found if isinstance(found, SerialArm) else whole_body_from(*found, _load_arm)


def _load_arm(source: str | Path, base_link: str | None, tip_link: str | None) -> SerialArm:
    """Load an arm; a whole body is refused, so that no file can be a part of itself."""
    found = _read(source, base_link, tip_link)
    if not isinstance(found, SerialArm):
        raise ValueRangeError(f"robot: '{source}' is a whole body, not an arm; list its parts instead")
    return found


def _read(source: str | Path, base_link: str | None, tip_link: str | None) -> SerialArm | tuple[Path, Any]:
    """Return an arm, or the file of a whole body and its plain data."""
    text = str(source)
    package, colon, inner = text.partition(":")
    suffix = Path(text).suffix.lower()
    if package == EXAMPLES and colon:
        return load_urdf(_example(inner), base_link, tip_link)
    if suffix == ".urdf":
        return load_urdf(text, base_link, tip_link)
    if suffix == ".xacro":
        raise FileFormatError(f"{text}: is a xacro file; expand it first: xacro {text} > robot.urdf")
    if suffix not in (".yaml", ".yml") and text not in robot_names():
        raise UnknownNameError(
            f"{unknown_name('robot', text, robot_names())}; or give the path of a .yaml or .urdf file, "
            f"or {EXAMPLES}:PATH.urdf"
        )
    for field, link in (("base_link", base_link), ("tip_link", tip_link)):
        if link is not None:
            raise ShapeError(
                f"{field}: only URDF files have links to choose from; '{text}' has none, got '{link}'"
            )
    path = Path(text) if suffix in (".yaml", ".yml") else _MODELS / f"{text}.yaml"
    data = parse_yaml(path, read_text(path))
    return (path, data) if isinstance(data, dict) and "parts" in data else arm_from(path, data)


def example_urdfs() -> dict[str, Path]:
    """Return the URDF files of the installed example-robot-data package by their short names.

    Raises
    ------
    MissingExtraError
        If the package is not installed.
    """
    try:
        files = importlib.metadata.distribution(EXAMPLES).files or []
    except importlib.metadata.PackageNotFoundError:
        raise MissingExtraError(
            f"{EXAMPLES}: is not installed; install it with: pip install 'dqcontrol[robots]'"
        ) from None
    marker = f"share/{EXAMPLES}/robots/"
    return {
        str(file).split(marker)[1]: Path(str(file.locate()))
        for file in files
        if file.suffix == ".urdf" and marker in str(file)
    }


def _example(inner: str) -> Path:
    known = example_urdfs()
    if inner not in known:
        stem = Path(inner).stem.lower()
        same = [path for path in known if stem and stem in path.lower()]
        near = f"; did you mean '{same[0]}'?" if same else suggest(inner, known)
        raise UnknownNameError(
            f"{EXAMPLES}: unknown file '{inner}'{near} (allowed: {', '.join(sorted(known))})"
        )
    return known[inner]


@dataclass(frozen=True)
class JointRow:
    """One coordinate in a table: limits in degrees or m, velocity in degrees/s or m/s, effort in N·m or N.

    ``input`` names the input that moves it; velocity and effort are that input's, None where there is none.
    """

    name: str
    type: str
    lower: float
    upper: float
    input: str
    velocity: float | None
    effort: float | None


@dataclass(frozen=True)
class Description:
    """What to print about a robot.

    Attributes
    ----------
    name
        The robot's name.
    bases
        Its mobile bases, ``"differential drive"`` or ``"holonomic"``, joined by ``+``; empty without.
    joints
        One row a coordinate.
    reach
        Length of the stretched arm in m, from its first axis (that of the part after the last base) to the tool:
        nothing beyond can be reached.
    mass
        Mass of all moving bodies in kg; None if unknown.
    """

    name: str
    bases: str
    joints: tuple[JointRow, ...]
    reach: float
    mass: float | None


def describe(robot: Robot) -> Description:
    """Return what to print about a robot.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> from dqcontrol.robots import describe
    >>> round(describe(dqc.load_robot("iiwa7")).reach, 3)
    0.926
    """
    limits = robot.limits
    inputs = {int(i): j for j, i in enumerate(robot.input_coordinates)}
    rows = []
    for i, (name, kind) in enumerate(zip(robot.joint_names, robot.joint_types, strict=True)):
        unit = np.pi / 180 if kind == "revolute" else 1.0
        lower, upper, j = float(limits.lower[i] / unit), float(limits.upper[i] / unit), inputs.get(i)
        if j is None:
            rows.append(JointRow(name, kind, lower, upper, "", None, None))
            continue
        velocity, effort = float(limits.velocity[j] / unit), float(limits.effort[j])
        rows.append(JointRow(name, kind, lower, upper, robot.input_names[j], velocity, effort))
    mass = float(robot.inertia.mass.sum()) if robot.inertia is not None else None
    bases = " + ".join(kind for _, kind in _bases(robot))
    return Description(robot.name, bases, tuple(rows), _reach(robot), mass)


_BASES = {DifferentialDrive: "differential drive", HolonomicBase: "holonomic"}


def _bases(robot: Robot) -> list[tuple[int, str]]:
    """Return the index of each base's first coordinate, and its kind."""
    parts = robot.parts if isinstance(robot, WholeBody) else ()
    return [(first, _BASES[type(part)]) for first, part in placed(parts) if not isinstance(part, SerialArm)]


def _reach(robot: Robot) -> float:
    """Return the sum of the largest distances between neighbouring joint frames, from the first joint on."""
    total, first = 0.0, max((first + 3 for first, _ in _bases(robot)), default=0)
    for i in range(first, robot.configuration_size):
        step = robot.chain[i + 1, 4:7].copy()
        if robot.joint_types[i] == "prismatic":
            ends = (robot.limits.lower[i], robot.limits.upper[i])
            total += max(math.hypot(step[0], step[1], step[2] + q) for q in ends)
            continue
        if i == first:
            step[2] = 0.0  # along the first axis: measured from the point nearest to the next joint
        total += float(np.linalg.norm(step))
    return total
