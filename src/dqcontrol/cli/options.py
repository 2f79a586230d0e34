"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

Out = Annotated[Path | None, Parameter(name=["--out", "-o"], help="New folder for the results.")]
Force = Annotated[bool, Parameter(negative=(), help="Replace an earlier folder of results.")]
