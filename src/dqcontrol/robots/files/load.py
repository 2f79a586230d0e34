"""Robots by name or file."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from dqcontrol.errors import (
    FileFormatError,
    MissingExtraError,
    ShapeError,
    UnknownNameError,
    ValueRangeError,
    suggest,
    unknown_name,
)
from dqcontrol.files.input_file import read_text
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.robots.files import MODELS, robot_names
from dqcontrol.robots.files.robot_file import arm_from, with_tool
from dqcontrol.robots.files.urdf_xml import MJCF, URDF, XACRO
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.serial_arm import SerialArm

if TYPE_CHECKING:
    from dqcontrol.robots.bases import DriveKind
    from dqcontrol.robots.files.link_tree import LinkTree
    from dqcontrol.robots.tree_robot import TreeRobot
    from dqcontrol.robots.whole_body import WholeBody


EXAMPLES = "example-robot-data"
MENAGERIE = "menagerie"
_NAMES_SHOWN = 100  # of a package's files in a message


def installed_file(source: str) -> Path | None:
    """Return the robot file that ``PACKAGE:PATH`` or ``menagerie:NAME`` names; None for any other source.

    Of a path inside a package its end is enough, as much of it as tells it from others.

    Raises
    ------
    MissingExtraError
        If the package is not installed, or Menagerie's model not on this computer.
    UnknownNameError
        If it brings no such file, or several.
    """
    package, colon, inner = source.partition(":")
    if not colon or len(package) < 2 or Path(source).exists():  # one letter: a drive
        return None
    return _menagerie_file(inner) if package == MENAGERIE else _package_file(package, inner)


def package_files(package: str) -> dict[str, Path]:
    """Return the robot files of an installed package by their paths below the folder that holds them all.

    Raises
    ------
    MissingExtraError
        If the package is not installed.
    """
    try:
        found = importlib.metadata.distribution(package)
    except (importlib.metadata.PackageNotFoundError, ValueError):
        extra = "'dqcontrol[robots]'" if package == EXAMPLES else package
        raise MissingExtraError(
            f"{package}: is not installed; install it with: pip install {extra}"
        ) from None
    return _by_places(_robot_files(found))


def installed_robot_files() -> Iterator[tuple[str, Path]]:
    """Yield the source and the path of each robot file that installed packages bring, and Menagerie's on this computer.

    Examples
    --------
    >>> from dqcontrol.robots.files.load import installed_robot_files
    >>> all(path.is_file() for _, path in installed_robot_files())
    True
    """
    found = {each.metadata["Name"]: each for each in importlib.metadata.distributions()}
    for name in sorted(filter(None, found), key=str.lower):
        for inner, path in _by_places(_robot_files(found[name])).items():
            yield f"{name}:{inner}", path
    try:
        registry = _menagerie()
    except MissingExtraError:
        return
    for name in registry.names():
        path = _menagerie_path(registry, name)
        if path is not None:
            yield f"{MENAGERIE}:{name}", path


def _robot_files(distribution: importlib.metadata.Distribution) -> list[Path]:
    named = [file for file in distribution.files or () if file.suffix.lower() in (URDF, XACRO, MJCF)]
    paths = [Path(str(file.locate())) for file in named]
    return [path for path in paths if path.suffix.lower() != MJCF or _is_mjcf(path)]


def _is_mjcf(path: Path) -> bool:
    """Return whether an XML file is a model of MuJoCo that moves, by itself or by what it includes."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:  # listed, but removed since
        return False
    return "<mujoco" in text and "<worldbody" in text and any(tag in text for tag in _MOVING)


_MOVING = ("<joint", "<freejoint", "<include")


def _by_places(paths: list[Path]) -> dict[str, Path]:
    """Return paths by their places below the innermost folder that holds all of them."""
    top = os.path.commonpath([path.parent for path in paths]) if paths else ""
    return {path.relative_to(top).as_posix(): path for path in sorted(paths)}


def _package_file(package: str, inner: str) -> Path:
    known = package_files(package)
    parts = tuple(part for part in inner.split("/") if part)
    same = [path for path in known.values() if parts and path.parts[-len(parts) :] == parts]
    if len(same) == 1:
        return same[0]
    if same:
        ends = ", ".join(end for end, path in known.items() if path in same)
        raise UnknownNameError(f"{package}: '{inner}' may be each of {ends}; give one of these")
    stem = Path(inner).stem.lower()
    near = next((end for end in known if stem and stem in end.lower()), None)
    hint = f"; did you mean '{near}'?" if near else suggest(inner, known)
    names = sorted(known)
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    allowed = f"allowed: {', '.join(names[:_NAMES_SHOWN])}{more}" if names else "it brings no robot files"
    raise UnknownNameError(f"{package}: unknown file '{inner}'{hint} ({allowed})")


def _menagerie() -> Any:
    """Return the registry of the package mujoco-menagerie."""
    try:
        return importlib.import_module("mujoco_menagerie").bundled()
    except ImportError as error:
        raise MissingExtraError(
            f"{MENAGERIE}: models are named by mujoco-menagerie, which cannot be imported ({error}); "
            "pip install mujoco-menagerie"
        ) from None


def _menagerie_path(registry: Any, name: str) -> Path | None:
    """Return the file of a model's robot, without a scene, if it is on this computer: nothing is downloaded here."""
    robot, cache = registry.get(name), importlib.import_module("mujoco_menagerie").Cache()
    if cache.root is not None:
        folder = Path(cache.root) / name
    elif cache.is_cached(robot):
        folder = cache.model_path(robot)
    else:
        return None
    path = folder / robot.entry(robot.default_model).file
    return path if path.is_file() else None


def _menagerie_file(name: str) -> Path:
    registry = _menagerie()
    if name not in registry.names():
        raise unknown_name(MENAGERIE, name, registry.names())
    path = _menagerie_path(registry, name)
    if path is None:
        root = os.environ.get("MENAGERIE_ROOT")
        if root:
            raise FileFormatError(f"{MENAGERIE}: '{name}' is not in MENAGERIE_ROOT={root}")
        raise MissingExtraError(
            f"{MENAGERIE}: '{name}' is not on this computer yet; fetch it with: mujoco-menagerie prefetch {name}; "
            "or let MENAGERIE_ROOT name a copy of MuJoCo Menagerie"
        )
    return path


_SEVERAL = {"parts": "a whole body", "frames": "a tree"}  # by keys of their files


@overload
def load_robot(source: str | Path, base_link: str | None = None, tip_link: str | None = None) -> Robot: ...
@overload
def load_robot(
    source: str | Path,
    base_link: str | None = None,
    *,
    tips: Sequence[str] | Literal["all"],
    floating: bool = False,
) -> TreeRobot: ...
@overload
def load_robot(
    source: str | Path,
    *,
    tip_link: str | None = None,
    drive: DriveKind | Literal["found"],
    wheel_radius: float | None = None,
    track: float | None = None,
    steering_limit: float | None = None,
) -> WholeBody: ...
def load_robot(
    source: str | Path,
    base_link: str | None = None,
    tip_link: str | None = None,
    *,
    tips: Sequence[str] | Literal["all"] | None = None,
    floating: bool = False,
    drive: DriveKind | Literal["found"] | None = None,
    wheel_radius: float | None = None,
    track: float | None = None,
    steering_limit: float | None = None,
) -> Robot:
    """Load a robot by name or from a file: a chain; with ``tips`` all that moves them, with ``drive`` what has wheels.

    Parameters
    ----------
    source
        One of `robot_names`; or a ``.yaml`` or ``.yml`` file in one of our formats (`RobotFile`, `WholeBodyFile`,
        `TwoArmsFile`, `TreeFile`); or a ``.urdf`` or ``.xacro`` file, or an ``.xml`` file of MuJoCo (MJCF); or
        ``example-robot-data:panda_description/urdf/panda.urdf``, a file of that installed package, of which the end of
        the path is enough; or ``menagerie:NAME``, a model of MuJoCo Menagerie that mujoco-menagerie has fetched.
    base_link, tip_link
        Ends of the chain, for URDF and MJCF files only; see `load_urdf`. Of a tree the link in whose frame the task's
        pose is given, of a mobile robot the link whose frame is the end effector.
    tips
        Of URDF and MJCF files: links that are to be driven. Only the joints above them are kept, and the first is the
        task; ``"all"`` keeps all joints.
    floating
        Whether the root of a tree moves freely, by x, y, z, yaw, pitch and roll before all others.
    drive
        Of URDF and MJCF files of mobile robots: ``"found"`` by their wheels; or where these do not tell,
        ``"differential"``, ``"mecanum"``, ``"omni"``, ``"car-like"`` or ``"tricycle"``.
    wheel_radius, track, steering_limit
        m, m and rad, of a drive; where the file does not tell, or in place of what it says.

    Returns
    -------
    SerialArm, WholeBody, TreeRobot or TwoArms
        A whole body if the source is a file with ``parts`` or a ``drive`` is asked for, two arms if it is one with
        ``left`` and ``right``. In a tree every link is a named frame; joints that follow others (mimic) have no
        coordinate of their own.

    Raises
    ------
    UnknownNameError
        If there is no such robot or link, or if there are several arms on wheels and no ``tip_link``.
    FileFormatError
        If the file is missing or malformed, holds what no tree of hinges and slides can, or its wheels do not tell what
        is needed: it is said what to give.
    MissingExtraError
        If the source is in a package that is not installed.
    ShapeError
        If what is asked for is of two kinds of robots.

    Notes
    -----
    Wheels are joints without limits about a level axis, with a round link or a name like a wheel's, at the height of
    the lowest; those that turn freely about an upright axis are casters, those that do so within limits are steered.
    Their number and axles tell the drive: two on an axle a differential drive, two and one or two steered ones a
    tricycle or a car, four with rollers mecanum wheels, three or more around the middle omni wheels. Radius and track
    are those of the wheels, the rims' limit is that of their joints. The arm is the longest chain of joints, without
    gripper.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> dqc.load_robot("iiwa7").configuration_size
    7
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "fork.urdf"
    >>> _ = path.write_text('''<robot name="fork"><link name="base"/><link name="left"/><link name="right"/>
    ... <joint name="a" type="continuous"><parent link="base"/><child link="left"/></joint>
    ... <joint name="b" type="continuous"><origin xyz="0 1 0"/><parent link="base"/><child link="right"/></joint>
    ... </robot>''')
    >>> fork = dqc.load_robot(path, tips="all")
    >>> fork.joint_names, fork.frame_names
    (('a', 'b'), ('base', 'left', 'right'))
    >>> abs(dqc.DualQuaternion(fork.fkm([0.1, 0.2], frame="right")).translation).round(9).tolist()
    [0.0, 1.0, 0.0]
    >>> def wheel(side, y):
    ...     shape = '<collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>'
    ...     place = f'<origin xyz="0 {y} 0.1" rpy="-1.5708 0 0"/><axis xyz="0 0 1"/>'
    ...     return (f'<link name="{side}_wheel">{shape}</link><joint name="{side}" type="continuous">{place}'
    ...             f'<parent link="base"/><child link="{side}_wheel"/></joint>')
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cart.urdf"
    >>> _ = path.write_text(f'<robot name="cart"><link name="base"/>{wheel("left", 0.2)}{wheel("right", -0.2)}</robot>')
    >>> dqc.load_robot(path, drive="found").parts[0].half_track
    0.2
    """
    wheels = {"wheel_radius": wheel_radius, "track": track, "steering_limit": steering_limit}
    if drive is not None:
        if tips is not None or floating or base_link is not None:
            raise ShapeError("drive: makes a base on wheels; leave out 'tips', 'floating' and 'base_link'")
        # as other readers: when a file needs it
        from dqcontrol.robots.files.mobile_robot_file import DriveHints, mobile_robot_from

        hints = DriveHints(None if drive == "found" else drive, **wheels)
        return mobile_robot_from(file_of(source), tip_link, hints)
    if given := [name for name, value in wheels.items() if value is not None]:
        raise ShapeError(f"{given[0]}: is that of a drive; give drive='found' beside it")
    text = str(source)
    place = str(Path(text).resolve()) if Path(text).is_file() else text
    if tips is not None:
        if tip_link is not None:
            raise ShapeError("tips: make a tree and 'tip_link' a chain; give one of them")
        if not tips or (isinstance(tips, str) and tips != "all"):
            raise ShapeError(f"tips: expected 'all' or a list of links, got {tips!r}")
        chosen = None if tips == "all" else tips
        tree = _links(source).tree(chosen, base_link, floating=floating)
        tree.tips, tree.origin = tuple(chosen or ()), (place, None, None)
        return tree
    if floating:
        raise ShapeError("floating: is the root of a tree; give 'tips' beside it, as tips='all'")
    found = _read(source, base_link, tip_link)
    robot = found if isinstance(found, SerialArm) else robot_from(*found)
    robot.origin = place, base_link, tip_link
    return robot


def file_of(source: str | Path, what: str = "which could have wheels") -> Path:
    """Return the URDF, xacro or MJCF file that a source names.

    Raises
    ------
    UnknownNameError
        If it names none.
    """
    path = installed_file(str(source)) or Path(source)
    if path.suffix.lower() not in (URDF, XACRO, MJCF):
        raise UnknownNameError(f"robot: '{source}' is no .urdf, .xacro or .xml (MJCF) file, {what}")
    return path


def _links(source: str | Path) -> LinkTree:
    path = file_of(source, "whose links form a tree")
    if path.suffix.lower() == MJCF:
        from dqcontrol.robots.files.mjcf import mjcf_tree

        return mjcf_tree(path)
    from dqcontrol.robots.files.urdf import urdf_tree

    return urdf_tree(path)


def robot_from(path: str | Path, data: Any) -> Robot:
    """Make a robot of the plain data of one of our files; ``path`` is for the messages and the places of others."""
    if isinstance(data, dict) and "parts" in data:
        from dqcontrol.robots.files.whole_body_file import whole_body_from

        return whole_body_from(path, data, _load_arm, load_robot)
    if isinstance(data, dict) and "frames" in data:
        from dqcontrol.robots.files.tree_file import tree_from

        return tree_from(path, data)
    if isinstance(data, dict) and ("left" in data or "right" in data):
        from dqcontrol.robots.files.tree_file import two_arms_from

        return two_arms_from(path, data, load_robot)
    return arm_from(path, _with_its_arm(path, data))


def _load_arm(source: str | Path, base_link: str | None, tip_link: str | None) -> SerialArm:
    """Load an arm; others are refused, so that no file can be a part of itself."""
    found = _read(source, base_link, tip_link)
    if not isinstance(found, SerialArm):
        what = next((text for key, text in _SEVERAL.items() if key in found[1]), "two arms")
        raise ValueRangeError(f"robot: '{source}' is {what}, not an arm; list its parts instead")
    return found


def _read(source: str | Path, base_link: str | None, tip_link: str | None) -> SerialArm | tuple[Path, Any]:
    """Return an arm, or the file of a whole body or of two arms and its plain data."""
    text = str(installed_file(str(source)) or source)
    suffix = Path(text).suffix.lower()
    if suffix in (URDF, XACRO):
        from dqcontrol.robots.files.urdf import load_urdf

        return load_urdf(text, base_link, tip_link)
    if suffix == MJCF:
        return _links(text).chain(base_link, tip_link)
    if suffix not in (".yaml", ".yml") and text not in robot_names():
        near = [name for name, path in installed_robot_files() if text and text.lower() in path.stem.lower()]
        installed = f"; installed: {', '.join(near[:3])}" if near else ""  # three fit in a line
        raise UnknownNameError(
            f"{unknown_name('robot', text, robot_names())}{installed}; or give the path of a "
            f".yaml, .urdf, .xacro or .xml (MJCF) file, or {EXAMPLES}:PATH.urdf, PACKAGE:PATH or {MENAGERIE}:NAME"
        )
    for field, link in (("base_link", base_link), ("tip_link", tip_link)):
        if link is not None:
            raise ShapeError(
                f"{field}: only URDF and MJCF files have links to choose from; '{text}' has none, got '{link}'"
            )
    path = Path(text) if suffix in (".yaml", ".yml") else MODELS / f"{text}.yaml"
    data = parse_yaml(path, read_text(path))
    several = isinstance(data, dict) and any(key in data for key in ("parts", "left", "right", "frames"))
    return (path, data) if several else arm_from(path, _with_its_arm(path, data))


def _with_its_arm(path: str | Path, data: Any) -> Any:
    """Return the plain data of an arm's file; of one that is another arm with a tool those of both."""
    if not isinstance(data, dict) or "joints" in data or not isinstance(source := data.get("robot"), str):
        return data
    file = MODELS / f"{source}.yaml" if source in robot_names() else Path(path).parent / source
    if file.suffix not in (".yaml", ".yml") or "joints" not in (arm := parse_yaml(file, read_text(file))):
        raise FileFormatError(
            f"{path}: robot: '{source}' is no robot file with joints, which could have a tool"
        )
    return with_tool(path, data, arm)
