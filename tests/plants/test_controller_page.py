"""The page of controller files says of every key what the reader of such files says."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct

from dqcontrol.plants.compliant.controller_file import ControllerFile, JointControl

PAGE = (Path(__file__).parents[2] / "docs/controller-files.md").read_text(encoding="utf-8")


def number(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e6 else f"{value:g}".replace("e+0", "e")


def allowed(meta: Meta) -> str:
    bounds = (("> ", meta.gt), ("≥ ", meta.ge), ("≤ ", meta.le))
    return ", ".join(sign + number(bound) for sign, bound in bounds if bound is not None)


def rows(struct: type[Struct], path: str = "") -> Iterator[str]:
    """Give the table's rows, those of parts with the part's name before."""
    hints: dict[str, Any] = get_type_hints(struct, include_extras=True)
    for field in msgspec.structs.fields(struct):
        name, hint = path + field.encode_name, hints[field.name]
        if isinstance(hint, type) and issubclass(hint, Struct):
            yield from rows(hint, f"{name}.")
            continue
        assert get_origin(hint) is Annotated, f"{name} has no description"
        (meta,) = (part for part in get_args(hint) if isinstance(part, Meta))
        assert meta.description, name
        yield f"| `{name}` | {allowed(meta)} | {'yes' if field.required else ''} | {meta.description} |"


def test_every_key_stands_there_with_its_bounds_and_its_meaning():
    shown = [line for line in PAGE.splitlines() if line.startswith("| `")]
    assert shown == [*rows(ControllerFile), *rows(JointControl)]
