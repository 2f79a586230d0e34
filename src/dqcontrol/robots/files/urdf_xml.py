"""URDF files as XML: refused if unsafe or malformed; where each link and joint is, for messages."""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from dqcontrol.errors import FileFormatError, MissingExtraError, suggest
from dqcontrol.files.input_file import read_whole

URDF = ".urdf"
XACRO = ".xacro"  # expanded to URDF first
MJCF = ".xml"


PACKAGES = "DQCONTROL_PACKAGE_PATH"  # of the environment: folders that ``--package`` names
WHERE = (
    "beside the robot's file or one of the folders above it, or in a folder of ROS_PACKAGE_PATH, "
    "or name its folder: --package FOLDER"
)


def add_packages(folders: Iterable[str]) -> None:
    """Let this process and those that it starts look for packages in some folders first.

    Parameters
    ----------
    folders
        Packages, or folders that hold them.

    Raises
    ------
    FileFormatError
        If one is no folder.
    """
    found = []
    for folder in folders:
        if not Path(folder).is_dir():
            raise FileFormatError(
                f"--package: '{folder}' is no folder; give that of a package, or one that holds packages"
            )
        found.append(str(Path(folder).resolve()))
    if found:
        os.environ[PACKAGES] = os.pathsep.join([*found, *filter(None, [os.environ.get(PACKAGES)])])


def package_folders(package: str, near: Path) -> Iterator[Path]:
    """Yield the folders that may be a package for a file: existing ones, the likeliest first.

    A package is what `add_packages` named, or a folder in that; a folder above the file or beside one of those, as its
    name or its ``package.xml`` says; or in AMENT_PREFIX_PATH or ROS_PACKAGE_PATH.
    """
    above, given = list(near.resolve().parents), _listed(PACKAGES)
    first = [*(folder for folder in given if _is(folder, package)), *(folder / package for folder in given)]
    named = [folder for folder in above if _is(folder, package)]
    beside = [folder / package for folder in above]
    ament = [folder / "share" / package for folder in _listed("AMENT_PREFIX_PATH")]
    ros = _listed("ROS_PACKAGE_PATH")
    here = [folder for folder in ros if folder.name == package]
    places = *first, *named, *beside, *ament, *here, *(folder / package for folder in ros)
    yield from (folder for folder in places if folder.is_dir())


def _listed(name: str) -> list[Path]:
    """Return the folders of a variable of the environment."""
    return [Path(each) for each in os.environ.get(name, "").split(os.pathsep) if each]


def _is(folder: Path, package: str) -> bool:
    return folder.name == package or _package_name(folder) == package


def _package_name(folder: Path) -> str:
    try:
        text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")[:100_000]
    except OSError:
        return ""
    return text.partition("<name>")[2].partition("</name>")[0].strip()


_MOST_SECONDS = 20.0  # a robot takes tenths of a second, on a busy machine some seconds
_MOST_MEMORY = 4 << 30  # bytes: what a robot takes is Python's 50 MB


def expand_xacro(path: str | Path) -> bytes:
    """Return the URDF text of a xacro file, with the defaults of its arguments.

    Raises
    ------
    MissingExtraError
        If xacro is not installed.
    FileFormatError
        If the file, or one that it includes, is missing or malformed, or a package is not found: it is named;
        or its expressions have no end.
    """
    try:
        import_module("xacro")
    except ImportError as error:
        raise MissingExtraError(
            f"{path}: is a xacro file, which needs xacro, and that cannot be imported ({error}); "
            f"pip install 'dqcontrol[xacro]', or expand it where ROS is: xacro {Path(path).name} > robot.urdf"
        ) from None
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__, str(path)],
            capture_output=True,
            timeout=_MOST_SECONDS,
            check=False,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
    except subprocess.TimeoutExpired:
        raise FileFormatError(f"{path}: xacro does not come to an end within {_MOST_SECONDS:g} s") from None
    if done.returncode:
        why = done.stderr.decode(errors="replace").strip() or f"xacro ended with {done.returncode}"
        raise FileFormatError(why)
    return done.stdout


def _expanded(path: str) -> bytes:
    """Do what `expand_xacro` does in a process of its own: expressions are Python, and may take any time and memory."""
    xacro = import_module("xacro")
    try:
        with (
            _packages_without_ros(Path(path)),
            contextlib.redirect_stderr(io.StringIO()),
        ):  # it prints what it raises
            return xacro.process_file(path).toxml(encoding="utf-8")
    except FileFormatError:
        raise
    except Exception as error:  # readers of damaged files raise anything
        if isinstance(error.__context__, FileFormatError):
            raise error.__context__ from None
        raise FileFormatError(f"{path}: xacro cannot expand it: {_words(error)}") from None


@contextlib.contextmanager
def _packages_without_ros(path: Path) -> Iterator[None]:
    """Let ``$(find PACKAGE)`` look where meshes are looked for, too; xacro itself asks ROS, and offers no other way."""
    substitution: Any = import_module("xacro.substitution_args")
    original = substitution._eval_find

    def find(package: str) -> str:
        folder = next(package_folders(package, path), None)
        if folder is None:
            raise FileFormatError(
                f"{path}: needs the package '{package}', which is not found; put it {WHERE}"
            )
        return str(folder)

    substitution._eval_find = find
    try:
        yield
    finally:
        substitution._eval_find = original


def _words(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    if "undefined substitution argument" in text.lower():
        text += (
            "; arguments have no values here: write a xacro file that sets them and includes this one, "
            "or expand it with them: xacro FILE NAME:=VALUE > robot.urdf"
        )
    return f"{text:.400}"


def _bound_memory() -> None:
    """Let an expression that is too large fail; where the system knows no such bound, time is the only one."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        resource = import_module("resource")
        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))


if __name__ == "__main__":
    _bound_memory()
    try:
        sys.stdout.buffer.write(_expanded(sys.argv[1]))
    except FileFormatError as error:
        sys.exit(str(error))


_DEEPEST = 50  # elements; URDF nests six, and Python's own stack ends at a thousand calls
_LARGEST = 20_000_000  # bytes; the largest that robots come with have one million
_JOINT_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_NUMBERS = {  # element: attributes that hold numbers, and how many
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "velocity": 1, "effort": 1},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
}
_REQUIRED = {"mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}


class CheckedXml:
    """The bytes of a URDF file that is safe to parse, and where in it everything is.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If the file cannot be read, declares a document type or entities (which could make a parser read other
        files or fill the memory), is no well-formed XML, or has something that no robot description has:
        ``path:line: …``.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.lines: dict[tuple[str, str], int] = {}
        self.data: bytes = read_whole(path, _LARGEST)
        self._refuse_declarations()
        if Path(path).suffix.lower() == XACRO or _has_macros(self.data):
            self.data = expand_xacro(path)
            self._refuse_declarations()
        self._stack: list[str] = []
        self._parser = expat.ParserCreate(namespace_separator=" ")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._doctype
        try:
            self._parser.Parse(self.data, True)
        except expat.ExpatError as error:
            text = expat.ErrorString(error.code)
            if not self.data.strip():
                text = "is empty"
            raise FileFormatError(f"{path}:{error.lineno}: not well-formed XML: {text}") from None
        except FileFormatError:
            raise
        except (ValueError, LookupError) as error:  # an encoding that expat does not know
            raise FileFormatError(f"{path}:1: not well-formed XML: {error}") from None
        for kind in ("parent", "child"):
            for (tag, name), line in self.lines.items():
                if tag == "joint" and (kind, name) not in self.lines:
                    raise FileFormatError(f"{path}:{line}: joint '{name}': missing <{kind} link=…>")

    def error(self, tag: str, name: str, text: str) -> FileFormatError:
        """Return an error about a link or joint, with its line."""
        return FileFormatError(f"{self.path}:{self.lines.get((tag, name), 1)}: {tag} '{name}': {text}")

    def _refuse_declarations(self) -> None:
        plain = self.data.replace(b"\0", b"").upper()  # so that UTF-16 and UTF-32 read like ASCII
        for word in (b"<!DOCTYPE", b"<!ENTITY"):
            if word in plain:
                line = plain[: plain.index(word)].count(b"\n") + 1
                raise FileFormatError(f"{self.path}:{line}: {_NO_DOCTYPE}")

    def _doctype(self, *_: object) -> None:
        raise self._fault(_NO_DOCTYPE)

    def _fault(self, text: str) -> FileFormatError:
        return FileFormatError(f"{self.path}:{self._parser.CurrentLineNumber}: {text}")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        depth = len(self._stack)
        if depth > _DEEPEST:
            raise self._fault(f"more than {_DEEPEST} elements inside each other")
        self._stack.append(tag)
        if depth == 0:
            if tag != "robot":
                raise self._fault(f"expected <robot>, got <{tag}>")
            self._need(tag, attributes, "name")
        elif depth == 1 and tag in ("link", "joint"):
            self._link_or_joint(tag, attributes)
        elif depth == 2 and self._stack[1] == "joint" and tag in ("parent", "child"):
            self._need(tag, attributes, "link")
            self.lines[tag, self._name] = self._parser.CurrentLineNumber
        if depth >= 2 and self._stack[1] in ("link", "joint") and "visual" not in self._stack:
            self._numbers(tag, attributes)

    def _end(self, _: str) -> None:
        self._stack.pop()

    def _need(self, tag: str, attributes: dict[str, str], key: str) -> None:
        if not attributes.get(key):
            raise self._fault(f"<{tag}> misses its attribute '{key}'")

    def _link_or_joint(self, tag: str, attributes: dict[str, str]) -> None:
        self._need(tag, attributes, "name")
        self._name = attributes["name"]
        if (tag, self._name) in self.lines:
            raise self._fault(
                f"{tag} '{self._name}' is already defined on line {self.lines[tag, self._name]}"
            )
        self.lines[tag, self._name] = self._parser.CurrentLineNumber
        kind = attributes.get("type", "")
        if tag == "joint" and kind not in _JOINT_KINDS:
            near = suggest(kind, _JOINT_KINDS)
            raise self._fault(
                f"joint '{self._name}': unknown type '{kind}'{near} (allowed: {', '.join(_JOINT_KINDS)})"
            )

    def _numbers(self, tag: str, attributes: dict[str, str]) -> None:
        where = f"{self._stack[1]} '{self._name}': <{tag}>"
        for key in _REQUIRED.get(tag, ()):
            if key not in attributes:
                raise self._fault(f"{where} misses its attribute '{key}'")
        for key, count in _NUMBERS.get(tag, {}).items():
            if key not in attributes:
                continue
            try:
                numbers = [float(word) for word in attributes[key].split()]
            except ValueError:
                numbers = []
            unlimited = tag == "limit" and math.inf in map(abs, numbers)
            if len(numbers) != count or not (unlimited or all(map(math.isfinite, numbers))):
                wanted = "a finite number" if count == 1 else f"{count} finite numbers"
                raise self._fault(f"{where} {key}: expected {wanted}, got '{attributes[key]}'")


def _has_macros(data: bytes) -> bool:
    """Return whether a file is xacro whatever its name: some packages call theirs .urdf."""
    return b"<xacro:" in re.sub(rb"<!--.*?-->", b"", data, flags=re.DOTALL)


_NO_DOCTYPE = (
    "declares a document type or entities; robot descriptions need none, and they are refused for safety"
)


_SCHEMES = ("package://", "model://")  # the second is Gazebo's


def mesh_file(urdf: Path, name: str) -> Path:
    """Return the file that a URDF file names: ``package://``, ``file://`` or a path from its folder.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    """
    scheme = next((scheme for scheme in _SCHEMES if name.startswith(scheme)), "")
    if scheme:
        package, _, inner = name.removeprefix(scheme).partition("/")
        places = [folder / inner for folder in package_folders(package, urdf)]
    else:
        places = [urdf.parent / name.removeprefix("file://")]
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(name)


def mesh_names(urdf: Path) -> list[str]:
    """Return the names of all meshes that a URDF or xacro file shows its links with, each once.

    Raises
    ------
    FileFormatError
        If the file cannot be read.
    """
    root = ElementTree.fromstring(CheckedXml(urdf).data)
    found = (mesh.get("filename", "") for mesh in root.iterfind("link/visual/geometry/mesh"))
    return list(dict.fromkeys(name for name in found if name))


def missing_meshes(urdf: Path) -> list[str]:
    """Return the names of those meshes of a URDF or xacro file that are not found; see `mesh_file`."""

    def is_missing(name: str) -> bool:
        try:
            mesh_file(urdf, name)
        except FileNotFoundError:
            return True
        return False

    return list(filter(is_missing, mesh_names(urdf)))


def missing_note(urdf: Path) -> str:
    """Return which meshes of a file are not found and how to help, in a line; empty if none is missing."""
    if not (missing := missing_meshes(urdf)):
        return ""
    packages = {name.partition("://")[2].partition("/")[0] for name in missing if name.startswith(_SCHEMES)}
    more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
    if packages:
        names = ", ".join(f"'{name}'" for name in sorted(packages))
        several = len(packages) > 1
        how = f"put the package{'s' * several} {names} {WHERE}"
    else:
        how = f"put {'them' if more else 'it'} where the file says, from its own folder"
    count = f"{len(missing)} meshes are" if len(missing) > 1 else "a mesh is"
    return f"{urdf.name}: {count} not found ({missing[0]}{more}), so plain shapes are drawn: {how}"
