"""What a YAML file may hold for the parameters of references: the types of their constructors, and their bounds."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from msgspec import Meta

Positive = Annotated[float, Meta(gt=0)]
Metres = Annotated[float, Meta(gt=0, description="m")]
Seconds = Annotated[float, Meta(gt=0, description="s")]
Vector = tuple[float, float, float]


class Yaml(NamedTuple):
    """Annotates a parameter that takes arrays in Python: what a file may hold for it."""

    form: Any
