"""The meshes that robot files name, and which of them are not found."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from dqcontrol.robots.files.package_folders import WHERE, package_folders
from dqcontrol.robots.files.urdf_xml import CheckedXml

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
