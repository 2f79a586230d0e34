"""What a search or learning is about: a spec, and the block in it that says what is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from dqcontrol.experiments.spec import Spec

Block = TypeVar("Block")


@dataclass(frozen=True)
class SpecWithBlock(Generic[Block]):
    """A spec with a block of its own.

    Attributes
    ----------
    where
        Name for messages.
    data
        The spec as plain data with absolute file names, without the block.
    folder
        Where its relative file names start.
    spec, block
        The same, typed.
    identified
        The plant file that the spec names, or the block for its model, if one does.
    """

    where: str
    data: dict[str, Any]
    folder: Path
    spec: Spec
    block: Block
    identified: Path | None
