"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

Out = Annotated[Path | None, Parameter(name=["--out", "-o"])]
Force = Annotated[bool, Parameter(negative=())]
