"""Robots by name or file, and what to print about one."""

from __future__ import annotations

import importlib.metadata
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dqcontrol.errors import (
    FileFormatError,
    MissingExtraError,
    ShapeError,
    UnknownNameError,
    suggest,
    unknown_name,
)
from dqcontrol.robots.robot_file import load_robot_file
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.urdf import load_urdf

EXAMPLES = "example-robot-data"

_MODELS = Path(__file__).parent / "models"


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots that come with dqcontrol."""
    return tuple(sorted(path.stem for path in _MODELS.glob("*.yaml")))


def load_robot(source: str | Path, base_link: str | None = None, tip_link: str | None = None) -> SerialArm:
    """Load an arm by name or from a file.

    Parameters
    ----------
    source
        One of `robot_names`; or a ``.yaml`` or ``.yml`` file in our format (`RobotFile`); or a ``.urdf``
        file; or ``example-robot-data:panda_description/urdf/panda.urdf``, a URDF file of that package.
    base_link, tip_link
        Ends of the chain, for URDF files only; see `load_urdf`.

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
    return load_robot_file(text if suffix in (".yaml", ".yml") else _MODELS / f"{text}.yaml")


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
    """One joint in a table: limits in degrees or m, velocity in degrees/s or m/s, effort in N·m or N."""

    name: str
    type: str
    lower: float
    upper: float
    velocity: float
    effort: float


@dataclass(frozen=True)
class Description:
    """What to print about an arm.

    Attributes
    ----------
    name
        The arm's name.
    joints
        One row a joint.
    reach
        Length of the stretched arm in m, from the first axis to the tool: nothing beyond can be reached.
    mass
        Mass of all moving bodies in kg; None if unknown.
    """

    name: str
    joints: tuple[JointRow, ...]
    reach: float
    mass: float | None


def describe(robot: SerialArm) -> Description:
    """Return what to print about an arm.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> from dqcontrol.robots import describe
    >>> round(describe(dqc.load_robot("iiwa7")).reach, 3)
    0.926
    """
    limits = robot.limits
    rows = []
    for i, (name, kind) in enumerate(zip(robot.joint_names, robot.joint_types, strict=True)):
        unit = np.pi / 180 if kind == "revolute" else 1.0
        lower, upper, velocity = (float(v[i] / unit) for v in (limits.lower, limits.upper, limits.velocity))
        rows.append(JointRow(name, kind, lower, upper, velocity, float(limits.effort[i])))
    mass = float(robot.inertia.mass.sum()) if robot.inertia is not None else None
    return Description(robot.name, tuple(rows), _reach(robot), mass)


def _reach(robot: SerialArm) -> float:
    """Return the sum of the largest distances between neighbouring joint frames."""
    total = 0.0
    for i, kind in enumerate(robot.joint_types):
        step = robot.chain[i + 1, 4:7].copy()
        if kind == "prismatic":
            ends = (robot.limits.lower[i], robot.limits.upper[i])
            total += max(math.hypot(step[0], step[1], step[2] + q) for q in ends)
            continue
        if i == 0:
            step[2] = 0.0  # along the first axis: measured from the point nearest to the next joint
        total += float(np.linalg.norm(step))
    return total
