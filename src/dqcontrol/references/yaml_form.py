"""Parameters of references in YAML files: their types with bounds, and the start of a reference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError

Positive = Annotated[float, Meta(gt=0)]
Metres = Annotated[float, Meta(gt=0, description="m")]
Seconds = Annotated[float, Meta(gt=0, description="s")]
Vector = tuple[float, float, float]
FileName = Annotated[str, Meta(min_length=1, description="path, relative to the spec")]


class Yaml(NamedTuple):
    """Annotates a parameter that takes arrays in Python: what a file may hold for it."""

    form: Any


@dataclass(frozen=True)
class SpecStart:
    """Where a reference of a spec starts; see `Reference.from_spec`.

    Attributes
    ----------
    pose
        Unit dual quaternion, shape (8,), inertial frame, m.
    folder
        Where relative file names start.
    place
        The reference's field in the spec, for messages.
    position_keys, orientation_keys
        Keys of the spec that say where, and how turned, it starts.
    """

    pose: Array
    folder: Path
    place: str
    position_keys: tuple[str, ...] = ()
    orientation_keys: tuple[str, ...] = ()

    def refuse_position(self, file: Path) -> None:
        """Refuse keys for the position, because a file says it."""
        self._refuse(self.position_keys, f"{file} says itself where it starts")

    def refuse_orientation(self, file: Path) -> None:
        """Refuse keys for the orientation, because a file says it."""
        self._refuse(self.orientation_keys, f"{file} says itself how the hand is turned")

    def _refuse(self, keys: tuple[str, ...], why: str) -> None:
        for key in keys:
            raise ValueRangeError(f"{self.place}.{key}: {why}: leave it out, or use 'transform'")
