"""List the laws, references, plants and robots that experiments may name."""

from __future__ import annotations

import re
from typing import Any, get_args

import msgspec
from cyclopts import App

from dqcontrol.cli.screen import print_table

_SOURCE = re.compile(r"\.? \[(P16|S17|[^]]*\d{4})[^]]*\]")  # where a formula comes from
_SHARED = {
    "null_space",
    "inverse",
    "start",
    "offset",
    "repeat",
    "ramp",
    "corner_stops",
    "jerk_limits",
    "transform",
}


kinds: App = App(name="list", help="List the laws, references, plants and robots that experiments may name.")


@kinds.command
def laws() -> None:
    """List the kinds of laws for the key law of an experiment; docs/laws.md has their formulas."""
    from dqcontrol.experiments.spec import AnyLaw

    _print_kinds("law", AnyLaw)


@kinds.command
def references() -> None:
    """List the kinds of motions for the key reference of an experiment."""
    from dqcontrol.experiments.spec.reference_spec import AnyReference

    _print_kinds("reference", AnyReference, hidden="object")


@kinds.command
def plants() -> None:
    """List the kinds of plants for the key plant of an experiment."""
    from dqcontrol.experiments.spec import AnyPlant

    _print_kinds("plant", AnyPlant)


@kinds.command
def robots() -> None:
    """List the bundled robots; dqcontrol robots list --installed has those of other packages."""
    from dqcontrol.cli.robots_listing import list_bundled

    list_bundled()


def _print_kinds(title: str, union: Any, hidden: str = "") -> None:
    from dqcontrol.tables.tables import Cell, Column, Table

    rows: dict[str, list[list[Cell]]] = {}
    for kind in get_args(union):
        tag = str(kind.__struct_config__.tag)
        keys = [each for each in msgspec.structs.fields(kind) if each.encode_name not in _SHARED]
        needed = [each.encode_name for each in keys if each.required]
        if tag != hidden:
            row: list[Cell] = [tag, _first_sentence(kind), ", ".join(needed)]
            rows.setdefault(kind.__module__.partition(".")[0], []).append(row)
    columns = [Column("kind"), Column("what it is"), Column("needs")]
    for package in sorted(rows, key=lambda name: name != "dqcontrol"):
        origin = "" if package == "dqcontrol" else f", of {package}"
        print_table(Table(columns, rows[package], f"{title}: {{kind: …}}{origin}"))


def _first_sentence(kind: type) -> str:
    """Return the first line of a class' docstring, without what refers to sources."""
    line = (kind.__doc__ or "").strip().splitlines()[0]
    return _SOURCE.sub("", line).partition("; see `")[0].replace("`", "").rstrip(".")
