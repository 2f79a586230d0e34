"""Tools on a force sensor, and the files that describe them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar

import msgspec
from msgspec import Meta

from dqcontrol.files.yaml_file import read_yaml
from dqcontrol.named_fields import NamedFields, Three


class Tool(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What hangs beyond a force sensor, and what the sensor shows without it, as `identify_tool` finds them.

    One type for all that take a weight off a measured wrench: `ForceSensor` and a supervisor's ``payload``. In specs
    it may be the name of a file that ``dqcontrol identify tool`` wrote.

    Parameters
    ----------
    mass, center
        kg, and m in the sensor's axes.
    force_bias, torque_bias
        N and N·m.
    tared
        Day on which the bias was measured, as ``2026-11-27``: `dqcontrol check` says how old it is.
    """

    spec_key: ClassVar[str] = "tool"
    mass: Annotated[float, Meta(ge=0, le=1e4, description="kg")] = 0.0
    center: Annotated[Three, Meta(description="m")] = (0.0, 0.0, 0.0)
    force_bias: Annotated[Three, Meta(description="N")] = (0.0, 0.0, 0.0)
    torque_bias: Annotated[Three, Meta(description="N·m")] = (0.0, 0.0, 0.0)
    tared: Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\d$", description="YYYY-MM-DD")] | None = None


class _ToolFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    tool: Tool
    identified: dict[str, Any] = {}


def load_tool(path: str | Path) -> Tool:
    """Return the tool that a file holds.

    Parameters
    ----------
    path
        A YAML file with the mapping ``tool`` and perhaps ``identified``: where its numbers are from.

    Raises
    ------
    FileFormatError
        If it cannot be read or holds something else.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "my_pen.yaml"
    >>> _ = file.write_text("tool: {mass: 0.3, center: [0, 0, 0.04]}")
    >>> load_tool(file).mass
    0.3
    """
    return read_yaml(path, _ToolFile).tool
