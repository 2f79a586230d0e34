"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

BaseLink = Annotated[str | None, Parameter(help="Start of the chain in a URDF file.")]
TipLink = Annotated[str | None, Parameter(help="End of the chain in a URDF file.")]
Out = Annotated[Path | None, Parameter(name=["--out", "-o"])]
Force = Annotated[bool, Parameter(negative=())]
Port = Annotated[int, Parameter(validator=validators.Number(gte=1024, lte=65535))]
